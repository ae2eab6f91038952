"""A periodic field on the plane that can be read anywhere, smoothly: cubic B-splines over a tile of samples.

Water wants this accuracy: a picture's nearest water has many vertices to a sample of a long wave, and the water's
normals come from differences of neighbouring vertices. OpenCV's remap rounds positions to 1/32 of a sample, which such
differences show as terraces.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
CHUNK = 1 << 14
"""Points at a time, so that intermediate results stay in the processor's cache."""


class SplineTile:
    """The cubic spline through the real part of a spectrum's samples (Unser 1999), repeated for ever."""

    def __init__(self, spectrum: NDArray[np.complex128], side_m: tuple[float, float]):
        """Prepare the spline.

        Args:
            spectrum: (n, n) discrete Fourier transform; rows are frequencies along y.
            side_m: length of the tile along x and y.
        """
        self.size = len(spectrum)
        self.cells_per_m = (self.size / side_m[0], self.size / side_m[1])
        # The spline's coefficients: samples of a cubic B-spline are (1, 4, 1) / 6, undone per frequency.
        undo = 3 / (2 + np.cos(2 * np.pi * np.fft.fftfreq(self.size)))
        coefficients = np.fft.ifft2(spectrum * undo * undo[:, None]).real
        padded = np.pad(coefficients, (1, 2), mode="wrap")
        self.stride = padded.shape[1]
        self.flat = padded.astype(np.float32).ravel()

    def sample(self, x_m: NDArray, y_m: NDArray) -> Floats:
        """Value of the field at x and y of any equal shape."""
        x, y = np.ravel(x_m), np.ravel(y_m)
        values = np.empty(x.size, np.float32)
        for start in range(0, x.size, CHUNK):
            part = slice(start, start + CHUNK)
            values[part] = self._sample(x[part], y[part])
        return values.reshape(np.shape(x_m))

    def _sample(self, x_m: NDArray, y_m: NDArray) -> Floats:
        column, across = self._cell(x_m, self.cells_per_m[0])
        row, along = self._cell(y_m, self.cells_per_m[1])
        corner = row * self.stride + column
        total = np.zeros(x_m.size, np.float32)
        for j, weight in enumerate(along):
            line = np.zeros(x_m.size, np.float32)
            for i, share in enumerate(across):
                line += share * self.flat[j * self.stride + i :].take(corner, mode="clip")
            total += weight * line
        return total

    def _cell(self, position_m: NDArray, cells_per_m: float) -> tuple[NDArray[np.int64], Floats]:
        """Which cell a position is in, and the weights (4, N) of the samples around it."""
        # float64: a float32 metre hundreds of metres out has steps that near water would show
        place = np.asarray(position_m, np.float64) * cells_per_m
        whole = np.floor(place)
        t = (place - whole).astype(np.float32)
        u = 1 - t
        first, last = u * u * u / 6, t * t * t / 6
        second = np.float32(2 / 3) - t * t * (2 - t) / 2
        weights = np.stack([first, second, 1 - first - last - second, last])
        return whole.astype(np.int64) % self.size, weights.astype(np.float32, copy=False)
