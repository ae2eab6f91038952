"""JPEG files as a phone writes them: pixels as the sensor lies, and an EXIF orientation that says how to turn them."""

import struct
from pathlib import Path

import cv2
import numpy as np

STORED = {
    1: lambda upright: upright,
    3: lambda upright: np.rot90(upright, 2),
    6: lambda upright: np.rot90(upright),  # shown turned clockwise
    8: lambda upright: np.rot90(upright, -1),
}
"""What is stored of an upright picture, by EXIF orientation."""


def write_turned(path: Path, upright: np.ndarray, orientation: int = 6) -> None:
    """Write an upright picture (BGR or grey) so that it is shown as it is and stored turned."""
    stored = np.ascontiguousarray(STORED[orientation](upright))
    jpeg = cv2.imencode(".jpg", stored, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    entry = struct.pack("<HHIHH", 0x0112, 3, 1, orientation, 0)  # tag Orientation, one SHORT
    tiff = b"II*\0" + struct.pack("<IH", 8, 1) + entry + struct.pack("<I", 0)
    segment = b"Exif\0\0" + tiff
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + jpeg[2:])
