"""Checks: the depths of the views, and of the requested maps."""

from collections.abc import Iterator

from calib.fitting.supported_depths import describe_trusted, untrusted_depths
from calib.verdict.case import Case
from calib.verdict.thresholds import ONE_DEPTH
from calib.verdict.verdict import Reason


def one_depth(case: Case) -> Iterator[Reason]:
    """Check that corners lie at several depths."""
    near, far = case.reach
    if case.calibration.model()[0].cover and far < ONE_DEPTH * near:
        sentence = (
            f"all corners are {near:.2g} to {far:.2g} m away: nearer and farther views show how the"
            " cover acts with depth."
        )
        yield Reason(sentence, case.next.capture())


def requested_depths(case: Case) -> Iterator[Reason]:
    """Check that the requested depths are near those of the corners."""
    untrusted = untrusted_depths(case.depths, *case.reach)
    if untrusted and case.calibration.model()[0].cover:
        near, far = case.reach
        sentence = (
            f"maps are wanted for {', '.join(f'{depth:g} m' for depth in untrusted)}, and corners"
            f" were seen at {near:.2g} to {far:.2g} m, which supports"
            f" {describe_trusted(near, far)}: take views there."
        )
        yield Reason(sentence, case.next.capture())
