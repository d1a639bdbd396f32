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
    pixels = jacobian.shape[2]
    size = min(CHUNK * (2 * half_width + 1), -(-pixels // FEWEST))
    by_pixel = np.matmul(inverse[:, :2].astype(np.float32), jacobian)  # (N, 2, P) px for each grey level
    moved = by_pixel * residuals[:, None]
    found, white, absorbed = 0.0, float((by_pixel.astype(np.float64) ** 2).sum()), 0.0
    for begin in range(0, pixels, size):
        chunk = slice(begin, begin + size)
        found += float((moved[..., chunk].sum(-1, dtype=np.float64) ** 2).sum())
        carried = np.matmul(by_pixel[..., chunk], jacobian[..., chunk].swapaxes(1, 2)).astype(np.float64)  # (N, 2, k)
        absorbed += float((np.matmul(carried, inverse) * carried).sum())
    return found / (white - absorbed)
