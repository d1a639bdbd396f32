"""The depths that the views are at, and those that maps are wanted for."""

import math
from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.thresholds import DEPTH_MARGIN, ONE_DEPTH
from calib.verdict.verdict import Reason


def one_depth(case: Case) -> Iterator[Reason]:
    near, far = case.reach
    if case.calibration.model()[0].cover and far < ONE_DEPTH * near:
        said = (
            f"all corners are {near:.2g} to {far:.2g} m away: nearer and farther views show how the"
            " cover acts with depth."
        )
        yield Reason(said, case.next.capture())


def depths_asked_for(case: Case) -> Iterator[Reason]:
    """Wanted depths that lie well outside of those that were seen."""
    nearest, farthest = trusted_depths(*case.reach)
    outside = [depth for depth in case.depths if not nearest <= depth <= farthest]
    if outside and case.calibration.model()[0].cover:
        near, far = case.reach
        said = (
            f"maps are wanted for {', '.join(f'{depth:g} m' for depth in outside)}, and corners"
            f" were seen at {near:.2g} to {far:.2g} m, which speaks for"
            f" {_reach(nearest, farthest)}: take views there."
        )
        yield Reason(said, case.next.capture())


def trusted_depths(near: float, far: float) -> tuple[float, float]:
    """m, of which depths corners from near to far speak."""
    margin = DEPTH_MARGIN * (1 / near - 1 / far)
    return 1 / (1 / near + margin), 1 / (1 / far - margin) if 1 / far > margin else math.inf


def _reach(nearest: float, farthest: float) -> str:
    return (
        f"{nearest:.2g} m and more"
        if math.isinf(farthest)
        else f"{nearest:.2g} to {farthest:.2g} m"
    )
