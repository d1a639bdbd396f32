"""Check: the same numbers hold in all views."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

from calib.calibration import Calibration
from calib.effects.varying import MANNERS, VARYING_NUMBERS, CameraOfView, Varying
from calib.fitting.differing import ADVICE, Differing
from calib.inference.effect_context import effect_context
from calib.verdict.case import Case, optimum_of
from calib.verdict.residual import beyond_noise, likely_scores
from calib.verdict.verdict import Reason


def differing_views(case: Case) -> Iterator[Reason]:
    """Name what differs from view to view beside everything that all views share. An effect that
    they share has to be found first: nothing is named where one that is scored is more probable.
    A window that nobody declared cannot be scored. So without a cover, nothing is named before a
    diagnosis where much more than noise is left.
    """
    for added in case.calibration.effects:
        effect = added.effect
        if isinstance(effect, CameraOfView) or (isinstance(effect, Varying) and not effect.settled):
            numbers, manner = VARYING_NUMBERS[effect.name], MANNERS[effect.varies]
            sentence = f"{numbers} {manner}, and the maps are of the mean: {ADVICE[effect.name]}."
            yield Reason(sentence, case.next.capture(), (effect.name,))
    diagnosed = case.calibration.history.diagnosis is not None
    window_possible = not diagnosed and not case.calibration.model()[0].cover
    if not case.at_optimum or (window_possible and beyond_noise(case)):
        return
    shared = (test for test in likely_scores(case) if not test.effect.per_view)
    largest = max((test.chi2 / 2 for test in shared), default=0.0)
    differing = find_differing(case.calibration)
    if differing and differing.first.gain > largest:
        groups = (variation.group for variation in differing.variations)
        suspects = tuple(group.name for group in groups if group.has_cause)
        command = case.next.report() if diagnosed else case.next.diagnose()
        yield Reason(str(differing), command, suspects)


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def find_differing(calibration: Calibration) -> Differing | None:
    """Return what differs from view to view in a calibration; None if nothing does."""
    fitted = optimum_of(calibration)
    return Differing.of(
        fitted,
        effect_context(fitted, calibration.board, calibration.camera, locate=False),
    )
