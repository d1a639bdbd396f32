"""How the noise of a picture's pixels spreads the places fitted to them: by as much as the fit's
own residuals show.

Least squares knows the spread of independent noise of one size. Real noise is none of it: a JPEG
smooths flat parts and rings along edges, a camera sharpens, and where a model lacks something, its
residuals run along the edge. So what moves a corner is summed over chunks of an edge, within which
noise may be alike in any way, and compared with what white noise would have left in the same
residuals.
"""

import numpy as np
from numpy.typing import NDArray

CHUNK = 12  # places along an edge, half of them to either side of the corner
FEWEST = 6  # chunks: what is summed over all that was fitted, the fit has made zero

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


def chunks(places: int, edges: int = 1) -> list[slice]:
    """Of so many places along each of the edges that are fitted together, from the corner
    outwards.
    """
    size = min(CHUNK, -(-places * edges // FEWEST))
    return [slice(begin, begin + size) for begin in range(0, places, size)]


def inflation(
    normals: Singles, gradients: Singles, inverse: Floats, moved: Floats | None = None
) -> float:
    """Grey levels^2, by which the unit covariances of a picture's corners are to be multiplied.

    Args:
        normals: (C, N, k, k) of C chunks of each corner's pixels.
        gradients: (C, N, k) of their residuals in grey levels.
        inverse: (N, k, k) of all chunks' normal matrix.
        moved: (N, 2, 2) px of the place, for each of the first two parameters. None: they are the
            place.
    """
    rows = (inverse[:, :2] if moved is None else moved @ inverse[:, :2]).astype(
        np.float32
    )  # (N, 2, k)
    found = rows @ gradients[..., None]
    carried = rows @ normals  # (C, N, 2, k)
    white = carried.sum(0) * rows
    absorbed = (carried @ inverse.astype(np.float32)) * carried
    return float(
        (found**2).sum(dtype=np.float64)
        / (white.sum(dtype=np.float64) - absorbed.sum(dtype=np.float64))
    )
