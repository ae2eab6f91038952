"""Small symmetric systems, solved with what every runtime has: ONNX knows neither Cholesky nor an inverse."""

import torch
from torch import Tensor


def solve_positive(matrix: Tensor, right: Tensor) -> Tensor:
    """Solve ``matrix`` x = ``right`` by Gauss-Jordan elimination, which needs no pivoting here.

    Elementwise, and so in full precision under autocast; each of the n rounds costs a handful of operations, however
    many systems there are.

    Args:
        matrix: (..., n, n) symmetric and positive definite.
        right: (..., n, m).

    Returns:
        (..., n, m)
    """
    n = matrix.shape[-1]
    unit = torch.eye(n, dtype=matrix.dtype, device=matrix.device)
    left = torch.cat([matrix, right], -1)
    for i in range(n):
        row = left[..., i : i + 1, :]
        pivot = row / row[..., i : i + 1]
        left = left - (left[..., i : i + 1] - unit[:, i : i + 1]) * pivot  # its column i is now that of a unit matrix
    return left[..., n:]
