"""Intel Open Image Denoise: clean radiance from few light paths."""

import functools
from typing import Any

import numpy as np
import pyoidn
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def denoise(radiance: Floats, albedo: Floats, normals: Floats, fast: bool) -> Floats:
    """Remove the noise of too few light paths from ``radiance`` (H, W, 3), guided by the surfaces (H, W, 3)."""
    pictures = {
        pyoidn.OIDN_IMAGE_COLOR: np.ascontiguousarray(radiance, np.float32),
        pyoidn.OIDN_IMAGE_ALBEDO: np.ascontiguousarray(np.clip(albedo, 0, 1), np.float32),
        pyoidn.OIDN_IMAGE_NORMAL: np.ascontiguousarray(normals, np.float32),
        pyoidn.OIDN_IMAGE_OUTPUT: np.zeros(radiance.shape, np.float32),
    }
    task = pyoidn.Filter(_device(), pyoidn.OIDN_FILTER_TYPE_RT)
    for name, picture in pictures.items():
        task.set_image(name, picture, pyoidn.OIDN_FORMAT_FLOAT3)
    task.set_bool("hdr", True)
    task.set_quality(pyoidn.OIDN_QUALITY_FAST if fast else pyoidn.OIDN_QUALITY_HIGH)
    task.commit()
    task.execute()
    return pictures[pyoidn.OIDN_IMAGE_OUTPUT]


@functools.cache
def _device() -> Any:
    device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
    device.commit()
    return device
