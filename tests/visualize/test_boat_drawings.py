import numpy as np
import pytest

from usvnet.visualize import GREEN, INK, RED, WHITE, BoatDrawing, close_up, contact_sheet, draw_boats, range_label

KEYPOINTS_PX = np.array([[120.0, 80], [110, 84], [116, 90], [118, 100], [60, 82], [64, 92], [62, 99]])
BOX_PX = np.array([56.0, 60, 124, 104])


def picture(height=240, width=320):
    return np.full((height, width, 3), 90, np.uint8)


def drawing(**changes):
    return BoatDrawing(BOX_PX, KEYPOINTS_PX, np.ones(7, bool), **changes)


def moved(right_px, down_px):
    offset = np.array([right_px, down_px])
    return drawing()._replace(box_px=BOX_PX + np.tile(offset, 2), keypoints_px=KEYPOINTS_PX + offset)


def near(image, point, colour, radius=3):
    """How near any pixel about ``point`` comes to ``colour``, as the largest difference of a channel."""
    u, v = np.round(point).astype(int)
    patch = image[v - radius : v + radius + 1, u - radius : u + radius + 1].astype(int)
    return np.abs(patch - colour).max(axis=-1).min()


@pytest.mark.parametrize(("shape", "expected"), [((240, 320), (480, 640)), ((480, 640), (480, 640))])
def test_small_pictures_are_drawn_at_twice_their_size(shape, expected):
    original = picture(*shape)
    drawn = draw_boats(original, [drawing()])
    assert drawn.shape == (*expected, 3)
    assert drawn.dtype == np.uint8
    assert (original == 90).all()


def test_port_is_red_and_starboard_green_where_the_keypoints_are():
    drawn = draw_boats(picture(), [drawing()], scale=3)
    on_canvas = 3 * (KEYPOINTS_PX + 0.5) - 0.5
    for port, starboard in ((1, 2), (4, 5)):
        assert near(drawn, on_canvas[port], RED) < 30
        assert near(drawn, on_canvas[starboard], GREEN) < 30
    assert (drawn[-60:, -60:] == 90).all()


def test_a_hidden_keypoint_is_hollow():
    seen = np.array([True, False, True, True, True, True, True])
    point = (4 * (KEYPOINTS_PX[1] + 0.5) - 0.5).round().astype(int)
    filled = draw_boats(picture(), [drawing()], scale=4)[point[1], point[0]]
    hollow = draw_boats(picture(), [drawing()._replace(seen=seen)], scale=4)[point[1], point[0]]
    assert np.abs(filled.astype(int) - RED).max() < 30
    assert np.abs(hollow.astype(int) - INK).max() < 30


def test_a_larger_covariance_draws_a_larger_ellipse():
    def changed(covariance_px2):
        with_ellipses = drawing(covariance_px2=np.tile(covariance_px2 * np.eye(2), (7, 1, 1)))
        return (draw_boats(picture(), [with_ellipses], scale=2) != draw_boats(picture(), [drawing()], scale=2)).sum()

    assert changed(100.0) > changed(9.0) > 0


def test_the_label_stays_off_the_boat_and_inside_the_picture():
    for move in (0, -55, 190):
        boat = moved(move, -58)
        bare, labelled = (
            draw_boats(picture(), [boat._replace(label=label)], scale=2)
            for label in ((), range_label(9.87, 0.12, 9.93))
        )
        rows, columns = np.nonzero((bare != labelled).any(axis=-1))
        assert len(rows) > 500
        x1, y1, x2, y2 = 2 * boat.box_px
        inside = (columns > x1) & (columns < x2) & (rows > y1) & (rows < y2)
        assert not inside.any()


def test_labels_of_two_boats_do_not_cover_each_other():
    other = moved(80, 2)
    label = range_label(9.87, 0.12, 9.93)

    def text_pixels(boats):
        return int((draw_boats(picture(), boats, scale=2) == WHITE).all(axis=-1).sum())

    both = [drawing(label=label), other._replace(label=label)]
    alone = text_pixels([drawing()])
    one_label = text_pixels([drawing(label=label)]) - alone
    assert text_pixels(both) - 2 * alone == pytest.approx(2 * one_label, abs=8)


def test_keypoints_that_are_not_finite_are_left_out():
    lost = draw_boats(picture(), [drawing()._replace(keypoints_px=np.full((7, 2), np.nan))], scale=3)
    assert not (lost == RED).all(axis=-1).any()
    far = KEYPOINTS_PX.copy()
    far[0] = 1e6
    assert draw_boats(picture(), [drawing()._replace(keypoints_px=far)]).shape == (480, 640, 3)


def test_the_label_says_range_uncertainty_and_laser():
    estimate, laser = range_label(9.868, 0.123, 9.93)
    assert estimate.startswith("9.87 m")
    assert estimate.endswith("0.12")
    assert laser == "laser 9.93 m"
    assert range_label(float("inf"), float("inf")) == ("no range",)


def test_a_close_up_enlarges_the_boat_and_shows_the_whole_picture_in_a_corner():
    original = picture()
    original[60:105, 56:125] = (200, 150, 100)
    tile = close_up(original, [drawing()], (400, 300))
    assert tile.shape == (300, 400, 3)
    colour = np.abs(tile.astype(int) - (200, 150, 100)).max(axis=-1) < 12
    assert colour.mean() > 2 * (45 * 69) / (240 * 320)
    corners = [tile[:80, :110], tile[:80, -110:], tile[-80:, :110], tile[-80:, -110:]]
    assert sum((corner > 180).all(axis=-1).any() for corner in corners) == 1


def test_a_contact_sheet_has_rows_captions_and_a_title():
    tiles = [np.full((30, 40, 3), 50 * n, np.uint8) for n in range(1, 4)]
    sheet = contact_sheet(tiles, 2, ["a", "b", "c"], "Title", gap_px=4)
    assert sheet.shape == (52 + 4 + 2 * (30 + 4 + 30), 4 + 2 * 44, 3)
    for n in range(1, 4):
        assert (sheet == 50 * n).all(axis=-1).sum() >= 30 * 40
    assert (sheet[-1, -1] == INK).all()
    with pytest.raises(ValueError, match="got pictures of 2 sizes"):
        contact_sheet([tiles[0], np.zeros((5, 5, 3), np.uint8)], 2)
