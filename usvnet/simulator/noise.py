"""Random fields that repeat without a seam: clouds, stone, leaves and grime are sums of these."""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def noise_tile(size: int, exponent: float, rng: np.random.Generator, lowest: int = 1, highest: int = 0) -> Floats:
    """A (size, size) tile of noise with power spectrum 1 / f**exponent, mean 0.5 and standard deviation 0.17.

    Args:
        size: of the tile, a power of two.
        exponent: 0 is white, 2 to 3 looks like clouds.
        rng: where it is drawn from.
        lowest: fewest waves across the tile.
        highest: most waves across the tile; 0 is all there is room for.
    """
    k = np.fft.fftfreq(size) * size
    wavenumber = np.hypot(k[:, None], k[None])
    wavenumber[0, 0] = 1
    amplitude = wavenumber ** (-exponent / 2)
    amplitude[wavenumber < lowest] = 0
    amplitude[0, 0] = 0
    if highest:
        amplitude[wavenumber > highest] = 0
    spectrum = amplitude * (rng.standard_normal((size, size)) + 1j * rng.standard_normal((size, size)))
    field = np.fft.ifft2(spectrum).real
    return (0.5 + 0.17 * field / field.std()).astype(np.float32)


def sample_tile(tile: Floats, x: NDArray, y: NDArray, smooth: bool = True) -> Floats:
    """The tile's value at fractional cells x (along its columns) and y of any equal shape, repeated for ever."""
    pad, width = 4, 8192
    size = len(tile)
    padded = np.pad(tile, pad, mode="wrap")
    count = x.size
    if not count:
        return np.zeros(x.shape, np.float32)
    rows = -(-count // width)  # cv2.remap wants pictures of less than 32768 a side
    at = np.zeros((2, rows * width), np.float32)
    at[0, :count], at[1, :count] = np.mod(x.ravel(), size) + pad, np.mod(y.ravel(), size) + pad
    values = cv2.remap(
        padded, at[0].reshape(rows, width), at[1].reshape(rows, width), cv2.INTER_CUBIC if smooth else cv2.INTER_LINEAR
    )
    return values.ravel()[:count].reshape(x.shape)
