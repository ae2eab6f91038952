"""Mosaics and pasted boats: whose labels they are, and that they teach no ranges."""

import dataclasses

import numpy as np
import pytest

from usvnet.data.augmentation import AugmentationConfig, Source, View, augment
from usvnet.data.augmentation.mosaic import mosaic
from usvnet.data.augmentation.paste import MAX_HIDDEN, paste_boat
from usvnet.data.augmentation.water import horizon_row
from usvnet.data.records import Frame
from usvnet.types import NEAREST_WATERLINE

STILL = AugmentationConfig(
    **dict.fromkeys(("mirror", "translate", "roll_deg", "mosaic", "paste"), 0),
    **dict.fromkeys(("hue", "saturation", "value", "glare", "fog", "dim", "blur", "noise"), 0),
    zoom=(1, 1),
)


def dot_source(frame: Frame, level: int) -> Source:
    """A soft bright dot at bow_bottom of the first boat, on a grey level that says which picture it is."""
    width, height = frame.size_px
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    point = frame.keypoints_px[0, 3]
    dot = (250 - level) * np.exp(-((u - point[0]) ** 2 + (v - point[1]) ** 2) / 18)
    return Source((level + dot).round().astype(np.uint8)[..., None].repeat(3, -1), frame)


def test_a_mosaic_shows_four_pictures_with_their_labels_and_no_ranges(make_frame):
    sources = [dot_source(make_frame(n), 40 + 20 * n) for n in range(4)]
    rng = np.random.default_rng(0)
    seen = 0
    for _ in range(10):
        picture, frame = mosaic(sources, (160, 160), dataclasses.replace(STILL, mirror=0.5, roll_deg=5), rng)
        assert picture.shape == (160, 160, 3)
        assert frame.size_px == (160, 160)
        assert not frame.range_m.any()
        assert not frame.range_std_m.any()
        assert len(frame.boxes_px) == len(frame.reference) == 4
        for keypoints, visibility in zip(frame.keypoints_px, frame.visibility):
            u, v = keypoints[3]
            if visibility[3] > 0 and 3 < u < 156 and 3 < v < 156:
                seen += 1
                row, column = round(v), round(u)
                around = picture[row - 2 : row + 3, column - 2 : column + 3, 0]
                assert around.max() > 225  # the dot is where the label says
    assert seen > 15


def test_each_boat_of_a_mosaic_stays_in_its_own_part(make_frame):
    """Each part is one grey: a box must not reach over into another part's grey."""
    sources = [Source(np.full((120, 160, 3), 40 * (n + 1), np.uint8), make_frame(n)) for n in range(4)]
    rng = np.random.default_rng(1)
    for _ in range(10):
        picture, frame = mosaic(sources, (128, 128), dataclasses.replace(STILL, zoom=(1.5, 2.5)), rng)
        assert set(np.unique(picture)) >= {40, 80, 120, 160}
        for box in frame.boxes_px:
            x1, y1, x2, y2 = np.round(box).astype(int).clip(0, 127)
            inside = picture[y1 + 1 : y2, x1 + 1 : x2, 0]
            assert len(set(np.unique(inside)) - {114}) == 1


def views(make_frame) -> tuple[View, View]:
    """A dark picture with a boat at its left, and a light one with a boat at its right."""
    dark, light = make_frame(1), make_frame(2)
    dark = dataclasses.replace(dark, visibility=np.full((1, 7), 2))
    light = dataclasses.replace(light, visibility=np.array([[2, 1, 2, 2, 1, 2, 2]]))
    return View(np.full((120, 160, 3), 50, np.uint8), dark), View(np.full((120, 160, 3), 50, np.uint8), light)


def test_a_pasted_boat_has_a_pose_but_no_range_and_lies_on_water(make_frame):
    view, other = views(make_frame)
    x1, y1 = np.ceil(other.frame.boxes_px[0, :2]).astype(int)
    x2, y2 = np.floor(other.frame.boxes_px[0, 2:]).astype(int)
    other.picture[y1 : y2 + 1, x1 : x2 + 1] = 200
    rng = np.random.default_rng(0)
    pasted = 0
    for _ in range(20):
        picture, frame = paste_boat(view, other, rng)
        if len(frame.boxes_px) == 1:
            continue
        pasted += 1
        np.testing.assert_array_equal(frame.range_m, [view.frame.range_m[0], 0])
        assert frame.reference[1] == NEAREST_WATERLINE
        np.testing.assert_array_equal(frame.visibility[1], [2, 1, 2, 2, 1, 2, 2])
        shift = frame.boxes_px[1, :2] - other.frame.boxes_px[0, :2]
        np.testing.assert_allclose(frame.keypoints_px[1], other.frame.keypoints_px[0] + shift)
        left, top = np.round(np.array([x1, y1]) + shift).astype(int)
        assert (picture[top + 1 : top + y2 - y1, left + 1 : left + x2 - x1] > 190).all()
        assert all(v > horizon_row(frame.camera, u) for u, v in frame.keypoints_px[1, [3, 6]])
        assert (view.picture == 50).all()  # the picture that was given is left as it was
    assert pasted > 15


def test_keypoints_under_a_pasted_boat_are_hidden_and_boats_are_not_covered_whole(make_frame):
    view, other = views(make_frame)
    rng = np.random.default_rng(0)
    hidden = 0
    for _ in range(60):
        frame = paste_boat(view, other, rng).frame
        if len(frame.boxes_px) == 1:
            continue
        low, high = frame.boxes_px[1].reshape(2, 2)
        under = ((frame.keypoints_px[0] >= low) & (frame.keypoints_px[0] <= high)).all(-1)
        np.testing.assert_array_equal(frame.visibility[0], np.where(under, 1, 2))
        shared = (np.minimum(frame.boxes_px[0, 2:], high) - np.maximum(frame.boxes_px[0, :2], low)).clip(0).prod()
        area = (frame.boxes_px[0, 2:] - frame.boxes_px[0, :2]).prod()
        assert shared / area <= MAX_HIDDEN + 1e-9
        hidden += under.any()
    assert hidden > 0


def test_where_there_is_no_water_nothing_is_pasted(make_frame):
    view, other = views(make_frame)
    up = view.frame.camera._replace(pitch_rad=view.frame.camera.pitch_rad - 1.0)
    view = view._replace(frame=dataclasses.replace(view.frame, camera=up))
    assert paste_boat(view, other, np.random.default_rng(0)) is view


def test_a_boat_that_is_cut_off_is_not_pasted(make_frame):
    view, other = views(make_frame)
    other.frame.visibility[0, 0] = 0
    assert paste_boat(view, other, np.random.default_rng(0)) is view


@pytest.mark.parametrize(("name", "boats"), [("mosaic", 4), ("paste", 2)])
def test_closing_leaves_the_picture_alone(make_frame, name: str, boats: int):
    sources = [dot_source(make_frame(n), 60) for n in range(4)]
    for source in sources:
        source.frame.visibility[:] = 2
    config = dataclasses.replace(STILL, **{name: 1})

    def boats_seen(closing: bool) -> int:
        rng = np.random.default_rng(0)
        drawn = [augment(sources[0], sources.__getitem__, 4, (160, 160), config, rng, closing) for _ in range(20)]
        return max(len(view.frame.boxes_px) for view in drawn)

    assert boats_seen(closing=False) == boats
    assert boats_seen(closing=True) == 1
