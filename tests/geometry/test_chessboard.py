import numpy as np
import pytest
from chessboards import poses, project, render

from usvnet.geometry import chessboard
from usvnet.geometry.chessboard import DETECTORS, find_corners, find_views, parse_board

POSES = poses(2, seed=5, tilt_rad=0.5)
BLANK = np.full((360, 480), 127, np.uint8)


@pytest.fixture(scope="module")
def pictures():
    return [render(*pose, seed=i) for i, pose in enumerate(POSES)]


def misses(corners_px, pose):
    """(P, 2) corners found minus corners projected, in whichever order of counting fits."""
    return min((order - project(*pose) for order in (corners_px, corners_px[::-1])), key=lambda d: np.abs(d).sum())


@pytest.mark.parametrize(("detector", "rms_px"), [("classic", 0.1), ("sb", 0.3)])
def test_corners_are_found_where_they_are(pictures, detector, rms_px):
    for grey, pose in zip(pictures, POSES):
        corners = find_corners(grey, (9, 6), detector)
        assert np.sqrt((misses(corners, pose) ** 2).sum(-1).mean()) < rms_px


def test_a_picture_searched_at_reduced_size_gives_corners_in_its_own_pixels(pictures, monkeypatch):
    monkeypatch.setattr(chessboard, "SEARCH_SIZE_PX", 300)
    offset = misses(find_corners(pictures[0], (9, 6), "sb"), POSES[0]).mean(0)
    assert np.abs(offset).max() < 0.15  # without the half-pixel rule it is (1.6 - 1) / 2 = 0.3
    refined = misses(find_corners(pictures[0], (9, 6), "classic"), POSES[0])
    assert np.sqrt((refined**2).sum(-1).mean()) < 0.1


@pytest.mark.parametrize("detector", DETECTORS)
def test_a_picture_without_the_whole_board_has_no_corners(pictures, detector):
    assert find_corners(BLANK, (9, 6), detector) is None
    assert find_corners(pictures[0], (8, 7), detector) is None


def test_views_carry_names_and_misses_are_listed(pictures):
    named = [("a", pictures[0]), ("b", BLANK), ("c", pictures[1])]
    findings = find_views(named, (9, 6), ("classic",))
    assert [view.name for view in findings.views["classic"]] == ["a", "c"]
    assert (findings.missed, findings.num_pictures, findings.size_px) == (["b"], 3, (480, 360))


def test_a_board_that_has_not_moved_is_skipped_only_when_asked(pictures):
    named = [("a", pictures[0]), ("same", pictures[0]), ("half turn", pictures[0][::-1, ::-1]), ("c", pictures[1])]
    every = find_views(named, (9, 6), ("classic",))
    moved = find_views(named, (9, 6), ("classic",), skip_repeats=True)
    assert len(every.views["classic"]) == 4
    assert [view.name for view in moved.views["classic"]][:1] == ["a"]
    assert "same" not in [view.name for view in moved.views["classic"]]
    assert moved.num_repeated >= 1
    assert "c" in [view.name for view in moved.views["classic"]]
    assert moved.missed == []


def test_a_picture_of_another_size_is_named(pictures):
    with pytest.raises(ValueError, match=r"b is 480x300 px but a is 480x360 px"):
        find_views([("a", pictures[0]), ("b", BLANK[:300])], (9, 6), ("classic",))
    with pytest.raises(ValueError, match=r"b is 360x480 px \(turned by 90 deg\?\)"):
        find_views([("a", pictures[0]), ("b", BLANK.T)], (9, 6), ("classic",))


@pytest.mark.parametrize("text", ["9", "9x", "9x6x3", "2x6", "9.5x6", "-9x6", "", "9*6"])
def test_board_text_is_checked(text):
    with pytest.raises(ValueError, match="board must be inner corners as COLUMNSxROWS"):
        parse_board(text)


def test_board_text_is_columns_by_rows():
    assert parse_board("9x6") == parse_board("9X6") == (9, 6)
