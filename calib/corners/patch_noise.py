"""Estimate from a fit's own residuals how the noise of a picture's pixels spreads the fitted
places.

The covariance of least squares assumes independent noise of one size. Real noise is neither: a JPEG
smooths flat areas and rings along edges, a camera sharpens, and where the model lacks something,
its residuals run along the edge. So the contributions that move a corner are summed over chunks of
an edge, within which the noise may be correlated in any way, and compared with what white noise
would have left in the same residuals.
"""

import numpy as np
from numpy.typing import NDArray

CHUNK = 12  # places along an edge, half of them to either side of the corner
MIN_CHUNKS = 6  # the sum over all fitted pixels is zero: the fit has made it so

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


def split_chunks(places: int, edges: int = 1) -> list[slice]:
    """Split the places along each of the edges that are fitted together into chunks, from the
    corner outwards.
    """
    size = min(CHUNK, -(-places * edges // MIN_CHUNKS))
    return [slice(start, start + size) for start in range(0, places, size)]


def noise_inflation(
    normals: Singles, gradients: Singles, inverse: Floats, place_jacobian: Floats | None = None
) -> float:
    """Return the factor for the unit covariances of a picture's corners, grey levels^2.

    Args:
        normals: (C, N, k, k), the normal matrices of C chunks of each corner's pixels.
        gradients: (C, N, k), those of the chunks' residuals in grey levels.
        inverse: (N, k, k), the inverse normal matrix of all chunks.
        place_jacobian: (N, 2, 2) px of the place per unit of the first two parameters. None: they
            are the place.
    """
    place_rows = inverse[:, :2] if place_jacobian is None else place_jacobian @ inverse[:, :2]
    rows = place_rows.astype(np.float32)  # (N, 2, k)
    shifts = rows @ gradients[..., None]
    carried = rows @ normals  # (C, N, 2, k)
    white = carried.sum(0) * rows
    absorbed = (carried @ inverse.astype(np.float32)) * carried
    return float(
        (shifts**2).sum(dtype=np.float64)
        / (white.sum(dtype=np.float64) - absorbed.sum(dtype=np.float64))
    )
