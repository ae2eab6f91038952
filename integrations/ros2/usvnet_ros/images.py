"""From sensor_msgs/Image to a picture, without cv_bridge, whose OpenCV need not be usvnet's."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

ENCODINGS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
    "8UC1": (1, cv2.COLOR_GRAY2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2RGB),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUY2),
}
"""Bytes of a pixel, and how OpenCV makes RGB of it."""


def picture_from_image(image: Any) -> NDArray[np.uint8]:
    """The picture (H, W, 3), RGB, of a sensor_msgs/Image of 8 bits a channel; rows may be padded.

    Raises:
        ValueError: an encoding that is not among ENCODINGS, or fewer bytes than it needs.
    """
    if image.encoding not in ENCODINGS:
        raise ValueError(f"Image: encoding is {image.encoding!r}, expected one of {', '.join(ENCODINGS)}")
    channels, conversion = ENCODINGS[image.encoding]
    height, width, step = int(image.height), int(image.width), int(image.step)
    data = np.frombuffer(image.data, np.uint8)
    if min(height, width) < 1 or step < width * channels or data.size < height * step:
        raise ValueError(f"Image: {width} x {height} {image.encoding} in rows of {step} bytes, got {data.size} bytes")
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    pixels = rows.reshape(height, width, channels) if channels > 1 else rows
    pixels = np.ascontiguousarray(pixels)
    return pixels if conversion is None else np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)
