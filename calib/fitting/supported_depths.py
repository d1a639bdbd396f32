"""The depths of maps that the corners of a fit support. Nothing slow is imported here."""

import math
from collections.abc import Iterable

DEPTH_MARGIN = 0.5
"""The margin on both sides of the corners' inverse depths, relative to their span. A pixel's ray is
the same at every depth, so its undistorted place is a straight line over inverse depth; the
standard deviation of a line that was fitted to evenly spread points is, half a span beyond their
ends, 1.8 times what it is at the ends.
"""
FAR = 100.0
"""m: the nearest depth that may have been meant in mm. Covered cameras look at things nearer than
that, and a map of 100 m hardly differs from that of infinity, which is written `inf`.
"""
MANY, MANY_CM = 10.0, 10.0
"""The depth over the farthest corner's, and the depth in m, from which cm may have been meant."""


def trusted_depths(near: float, far: float) -> tuple[float, float]:
    """Return the range of depths in m that corners from near to far support."""
    margin = DEPTH_MARGIN * (1 / near - 1 / far)
    return 1 / (1 / near + margin), 1 / (1 / far - margin) if 1 / far > margin else math.inf


def untrusted_depths(depths: Iterable[float], near: float, far: float) -> list[float]:
    """Return the depths, m, that corners from near to far do not support, each once."""
    nearest, farthest = trusted_depths(near, far)
    return [depth for depth in dict.fromkeys(depths) if not nearest <= depth <= farthest]


def describe_trusted(near: float, far: float) -> str:
    """Return the range of `trusted_depths` in words."""
    nearest, farthest = trusted_depths(near, far)
    return (
        f"{nearest:.2g} m and more"
        if math.isinf(farthest)
        else f"{nearest:.2g} to {farthest:.2g} m"
    )


def describe_supported(near: float, far: float) -> str:
    """Return a sentence on the range of `trusted_depths`, for corners from near to far, m."""
    nearest, farthest = trusted_depths(near, far)
    end = "any distance" if math.isinf(farthest) else f"{farthest:.2g} m"
    return (
        f"You can use maps from {nearest:.2g} m to {end}: the boards were {near:.2g} to {far:.2g} m"
        " away."
    )


def mistaken_unit(depth: float, far: float) -> tuple[str, int] | None:
    """Return the unit in which a depth may have been meant, mm or cm, and how many of it are a
    metre; None for a plausible depth. The farthest corner is at `far`, m.
    """
    for name, count, limit in (("mm", 1000, FAR), ("cm", 100, max(MANY_CM, MANY * far))):
        if limit <= depth < math.inf:
            return name, count
    return None


def doubtful_depths(depths: Iterable[float], near: float, far: float) -> list[float]:
    """Return the depths, m, that corners from near to far do not support, or that may have been
    meant in another unit.
    """
    depths = list(depths)
    untrusted = untrusted_depths(depths, near, far)
    return [depth for depth in depths if depth in untrusted or mistaken_unit(depth, far)]
