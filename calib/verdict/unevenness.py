"""Check: the relief is possible for glass."""

from collections.abc import Iterator, Sequence

from calib.estimation.relief_heights import MAX_UNEVENNESS, height_spread
from calib.fitting.declared import comparisons
from calib.session.cover import MEDIUM
from calib.session.parameter_names import number_of
from calib.session.tolerances import GLASS_FIGURE
from calib.verdict.case import Case
from calib.verdict.residual import suspects_of
from calib.verdict.verdict import Reason

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
    free = "which was not fitted" if held else "which the fit estimated near what is declared"
    yield Reason(
        f"the glass would be uneven by {1e6 * uneven:.0f} µm where the corners were seen (root mean"
        f" square), and cheap windows are by {1e6 * GLASS_FIGURE.sigma:.0f} µm: a number of the"
        f" cover, the camera or the board, {free}, is wrong, or the cover has another shape"
        f" (try {case.next.unknown_cover}).",
        case.next.fit("--free", "all") if held else case.next.diagnose(),
        _likeliest(case, held),
    )


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
