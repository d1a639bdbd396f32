"""Check: the same numbers hold in all views."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

from calib.calibration import Calibration
from calib.effects.description import describe_media
from calib.effects.fine_surface import FineSurface
from calib.effects.varying import MANNERS, VARYING_NUMBERS, CameraOfView, Varying
from calib.estimation.noise import is_stated_noise
from calib.fitting.differing import ADVICE, Differing
from calib.inference.effect_context import effect_context
from calib.inference.score_test import score_tests
from calib.verdict.case import Case, averaged_optimum_of
from calib.verdict.residual import beyond_noise, likely_scores
from calib.verdict.thresholds import AGREED
from calib.verdict.verdict import Reason

BUMP = (
    "there may be a small bump on the glass, such as a drop or a speck of dust, or a scratch: clean"
    " the glass, and record again."
)

HALF_TURN = (
    "the two principal points mirror each other in the middle of the picture: some pictures may be"
    " turned by 180 degrees. Turn them back, and fit again."
)

WITHOUT_COVER = (
    "if the camera looks through glass or plastic, describe its cover first (try {cover})."
    " Otherwise "
)


def settled_notes(calibration: Calibration) -> Iterator[str]:
    """Yield a note on numbers that are those at the end of the session."""
    for added in calibration.effects:
        if isinstance(added.effect, Varying) and added.effect.is_medium:
            yield describe_media(added.effect, [view.name for view in calibration.views])
        elif isinstance(added.effect, Varying) and added.effect.settled:
            yield (
                f"the maps are of {added.effect.plain_numbers} at the end of the session:"
                " do not use them for pictures before the change."
            )


def differing_views(case: Case) -> Iterator[Reason]:
    """Name what differs from view to view beside everything that all views share. An effect that
    they share has to be found first: nothing is named where one that is scored is more probable.
    A window that nobody declared cannot be scored. So without a cover, nothing is named before a
    diagnosis where much more than noise is left.
    """
    for added in case.calibration.effects:
        effect = added.effect
        if isinstance(effect, CameraOfView) or (isinstance(effect, Varying) and not effect.settled):
            members = _family_of(case.calibration, effect.name)
            yield Reason(_of_the_mean(effect, members), case.next.capture(), members)
        if isinstance(effect, Varying):
            camera = case.calibration.camera
            if effect.is_half_turn(case.calibration.model()[1], camera.width, camera.height):
                yield Reason(HALF_TURN, case.next.fit(), (effect.name,))
    diagnosed = case.calibration.history.diagnosis is not None
    window_possible = not diagnosed and not case.calibration.model()[0].cover
    if not case.at_optimum or (window_possible and beyond_noise(case)):
        return
    if is_stated_noise(case.calibration.board, case.left_px, case.calibration.noise_px):
        return
    scores = likely_scores(case)
    shared = max((test.chi2 / 2 for test in scores if not test.effect.per_view), default=0.0)
    differing = find_differing(case.calibration)
    gain = differing.first.gain if differing and differing.first.gain > shared else 0.0
    command = case.next.report() if diagnosed else case.next.diagnose()
    if gain or beyond_noise(case):
        rival = max([gain, *(test.chi2 / 2 for test in scores)])
        if _bump_gain(case.calibration) > rival:
            yield Reason(BUMP, command, (FineSurface.name,))
            return
    if differing and gain:
        groups = (variation.group for variation in differing.variations)
        suspects = tuple(group.name for group in groups if group.has_cause)
        asks = window_possible and not case.tried_all_shapes
        glass = WITHOUT_COVER.format(cover=case.next.unknown_cover) if asks else ""
        yield Reason(f"{glass}{differing}", command, suspects)


def _family_of(calibration: Calibration, name: str) -> tuple[str, ...]:
    """Return the names of the effects that may be present in place of an accepted one, the most
    probable first; its own name alone without a family.
    """
    diagnosis = calibration.history.diagnosis
    families = diagnosis.families if diagnosis else ()
    return next((tuple(f.members) for f in families if name in f.members), (name,))


def _of_the_mean(effect: CameraOfView | Varying, members: Sequence[str]) -> str:
    """Return the sentence on numbers of which the maps have the mean, and on the other members of
    their family.
    """
    numbers, manner = effect.plain_numbers, MANNERS[effect.varies]
    likeliest = members[0]
    if likeliest == effect.name:
        doubt = "most likely " if len(members) > 1 else ""
        return f"{doubt}{numbers} {manner}, and the maps are of the mean: {ADVICE[effect.name]}."
    first = VARYING_NUMBERS.get(likeliest, likeliest)
    advice = f" If it is the first, {ADVICE[likeliest]}." if likeliest in ADVICE else ""
    return (
        f"something differs from view to view: most likely {first}, else {numbers}, which {manner}"
        f" in this calibration. The maps are of the mean.{advice}"
    )


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def _bump_gain(calibration: Calibration) -> float:
    """Return the increase of the log evidence by one small bump on the glass, at most; 0 if the
    views do not agree on one. Where it is seen, it looks as if something differed from view to
    view.
    """
    fitted = averaged_optimum_of(calibration)
    context = effect_context(fitted, calibration.board, calibration.camera, locate=True)
    tests = score_tests(fitted, FineSurface.propose(context)[-1:])
    return max((test.chi2 / 2 for test in tests if test.p_value < AGREED), default=0.0)


@lru_cache(maxsize=1)
def find_differing(calibration: Calibration) -> Differing | None:
    """Return what differs from view to view in a calibration; None if nothing does."""
    fitted = averaged_optimum_of(calibration).some_views()
    return Differing.of(
        fitted,
        effect_context(fitted, calibration.board, calibration.camera, locate=False),
    )
