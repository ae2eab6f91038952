"""sensor_msgs/Image to a picture, without ROS."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from usvnet_ros.images import ENCODINGS, picture_from_image

V, U = np.mgrid[:24, :32]
PICTURE = np.stack([8 * U, 10 * V, 250 - 8 * U], -1).astype(np.uint8)
GREY = cv2.cvtColor(PICTURE, cv2.COLOR_RGB2GRAY)
COLOUR_AT = {"r": 0, "g": 1, "b": 2}


def image(pixels, encoding, padding=0):
    rows = np.pad(pixels.reshape(len(pixels), -1), ((0, 0), (0, padding)), constant_values=7)
    fields = {"height": len(pixels), "width": pixels.shape[1], "step": rows.shape[1], "data": rows.tobytes()}
    return SimpleNamespace(encoding=encoding, **fields)


def mosaic(pattern):
    """What a sensor with this pattern of filters, from the top left pixel on, records."""
    recorded = np.zeros(GREY.shape, np.uint8)
    for place, colour in enumerate(pattern):
        rows, columns = slice(place // 2, None, 2), slice(place % 2, None, 2)
        recorded[rows, columns] = PICTURE[rows, columns, COLOUR_AT[colour]]
    return recorded


def yuv(order):
    """4:2:2 of a grey picture: 128 is no colour."""
    luma, chroma = GREY, np.full_like(GREY, 128)
    return np.stack([luma, chroma] if order == "yuyv" else [chroma, luma], -1)


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("rgb8", PICTURE, PICTURE),
        ("bgr8", PICTURE[..., ::-1], PICTURE),
        ("8UC3", PICTURE[..., ::-1], PICTURE),
        ("rgba8", np.dstack([PICTURE, GREY]), PICTURE),
        ("bgra8", np.dstack([PICTURE[..., ::-1], GREY]), PICTURE),
        ("mono8", GREY, np.dstack([GREY] * 3)),
        ("8UC1", GREY, np.dstack([GREY] * 3)),
    ],
)
def test_colours_come_as_rgb_and_padding_is_left_out(encoding, pixels, expected, padding):
    np.testing.assert_array_equal(picture_from_image(image(pixels, encoding, padding)), expected)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_are_named_by_their_top_left_pixels(pattern):
    picture = picture_from_image(image(mosaic(pattern), f"bayer_{pattern}8"))
    np.testing.assert_allclose(picture[4:-4, 4:-4].astype(int), PICTURE[4:-4, 4:-4], atol=4)


@pytest.mark.parametrize(("encoding", "order"), [("yuv422", "uyvy"), ("uyvy", "uyvy"), ("yuv422_yuy2", "yuyv")])
def test_yuv(encoding, order):
    full = (GREY.astype(float) - 16) * 255 / 219  # video levels
    expected = np.clip(full, 0, 255)[..., None].repeat(3, -1)
    np.testing.assert_allclose(picture_from_image(image(yuv(order), encoding)).astype(int), expected, atol=2)


def test_what_cannot_be_a_picture_is_refused():
    with pytest.raises(ValueError, match="Image: encoding is '16UC1', expected one of rgb8, bgr8"):
        picture_from_image(image(PICTURE, "16UC1"))
    short = image(PICTURE, "rgb8")
    short.data = short.data[:-1]
    with pytest.raises(ValueError, match="Image: 32 x 24 rgb8 in rows of 96 bytes, got 2303 bytes"):
        picture_from_image(short)
    assert all(channels in (1, 2, 3, 4) for channels, _ in ENCODINGS.values())
