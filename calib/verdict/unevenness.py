"""Check: the relief is possible for glass."""

from collections.abc import Iterator, Sequence

from calib.effects.wedge import Wedge
from calib.estimation.relief_heights import MAX_UNEVENNESS, height_spread
from calib.fitting.declared import comparisons
from calib.session.cover import MEDIUM
from calib.session.parameter_names import number_of
from calib.session.tolerances import GLASS_FIGURE
from calib.verdict.case import Case
from calib.verdict.medium import water_advice
from calib.verdict.residual import significant_scores, suspects_of
from calib.verdict.verdict import Reason

WEDGE = (
    " It may be a wedge: the outer surface is turned against the inner one, so the glass is thicker"
    " on one side."
)
LIKELIEST = 2
"""The largest number of suspected kinds of numbers."""


def unevenness(case: Case) -> Iterator[Reason]:
    uneven = height_spread(*case.calibration.model(), case.observations)
    if uneven <= MAX_UNEVENNESS:
        return
    held = [
        number.name
        for number in comparisons(case.calibration)
        if number.held and number_of(number.name) != MEDIUM
    ]
    which = "one that was not fitted" if held else "one that the fit keeps near what is declared"
    is_wedge = any(test.effect.name == Wedge.name for test in significant_scores(case))
    wedge = WEDGE if is_wedge else ""
    yield Reason(
        f"the glass would be uneven by {1e6 * uneven:.0f} µm (root mean square, where the corners"
        f" were seen), and cheap windows are uneven by {1e6 * GLASS_FIGURE.sigma:.0f} µm. So a"
        f" number of the cover, the camera or the board is wrong ({which}), or"
        f" {case.other_shape}.{wedge}{water_advice(case)}",
        _next_command(case, is_held=bool(held), is_wedge=is_wedge),
        (*_likeliest(case, held), *([Wedge.name] if is_wedge else [])),
    )


def _next_command(case: Case, *, is_held: bool, is_wedge: bool) -> str:
    """Return the next command. A diagnosis has done all that another one could do, and it does not
    find a wedge that uneven glass imitates: its held-out error is the same.
    """
    if is_held:
        return case.next.fit("--free", "all")
    if is_wedge:
        effects = [added.effect for added in case.calibration.effects]
        present = [effect.name for effect in effects if effect.has_cause and not effect.varies]
        return case.next.fit("--effects", ",".join((*present, Wedge.name)))
    diagnosed = case.calibration.history.diagnosis is not None
    return case.next.fit() if diagnosed or water_advice(case) else case.next.diagnose()


def _likeliest(case: Case, names: Sequence[str]) -> tuple[str, ...]:
    """Return the few of these numbers whose changes would explain most of the residual."""
    numbers = {
        test: [name for name in suspects_of(test.effect) if name in names] for test in case.scores
    }
    best = sorted(
        (test for test, names_of_test in numbers.items() if names_of_test),
        key=lambda test: -test.chi2,
    )
    return tuple(name for test in best[:LIKELIEST] for name in numbers[test])
