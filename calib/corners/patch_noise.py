"""How the noise of a picture's pixels spreads the places fitted to them: by as much as the fit's own residuals show.

Least squares knows the spread of independent noise of one size. Real noise is none of it: a JPEG smooths flat parts and rings along edges,
a camera sharpens, and where a model lacks something, its residuals run along the edge. So what moves a corner is summed over chunks of an
edge, within which noise may be alike in any way, and compared with what white noise would have left in the same residuals.
"""

import numpy as np
from numpy.typing import NDArray

CHUNK = 12  # places along an edge, half of them to either side of the corner
FEWEST = 6  # chunks: what is summed over a whole patch, the fit has made zero


def inflation(jacobian: NDArray[np.float32], residuals: NDArray[np.float32], inverse: NDArray[np.float64], half_width: int) -> float:
    """Grey levels^2, by which the unit covariances of a picture's corners are to be multiplied.

    Args:
        jacobian: (N, k, P) of the light; the first two parameters are the place.
        residuals: (N, P) grey levels, in the order along the edges.
        inverse: (N, k, k) of the normal matrices.
        half_width: px to both sides of an edge.
    """
    count, parameters, pixels = jacobian.shape
    size = min(CHUNK * (2 * half_width + 1), -(-pixels // FEWEST))
    chunks = -(-pixels // size)
    padding = chunks * size - pixels
    by_chunk = np.pad(jacobian, ((0, 0), (0, 0), (0, padding))).reshape(count, parameters, chunks, size).swapaxes(1, 2)  # (N, C, k, size)
    left = np.pad(residuals, ((0, 0), (0, padding))).reshape(count, chunks, size, 1)
    place = inverse[:, None, :2].astype(np.float32)  # (N, 1, 2, k)
    moved = np.matmul(place, np.matmul(by_chunk, left))  # (N, C, 2, 1) px
    normal = np.matmul(by_chunk, by_chunk.swapaxes(2, 3))  # (N, C, k, k)
    carried = np.matmul(place, normal)  # (N, C, 2, k)
    white = np.matmul(carried, place.swapaxes(2, 3)).trace(axis1=2, axis2=3)
    absorbed = np.matmul(np.matmul(carried, inverse[:, None].astype(np.float32)), carried.swapaxes(2, 3)).trace(axis1=2, axis2=3)
    return float((moved.astype(np.float64) ** 2).sum() / (white - absorbed).astype(np.float64).sum())
