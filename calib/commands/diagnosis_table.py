"""The diagnosis as text and tables on the terminal."""

from collections.abc import Iterator
from textwrap import wrap

from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.diagnosis.effect_description import describe_estimates
from calib.diagnosis.finding import Candidate, Diagnosis
from calib.effects.description import describe_effect
from calib.errors import harmless
from calib.fit_record.history import fit_names
from calib.table import board_error

TABLE_WIDTH = 55
TITLE_WIDTH = 20
"""Letters of the longest title in the line of its numbers, with its indentation."""
EXPLANATION = (
    "Held out: the error without → with the effect, in px.",
    "Gain: how far it falls (95 % range). These errors weight",
    "corners by their noise, so they differ from those above.",
)
"""The meaning of the columns, and why they differ from the errors of the first table."""


def print_diagnosis(finding: Diagnosis, better: Calibration) -> None:
    """Print the accepted effects of the better calibration, then the errors, all candidates, and
    the remarks.
    """
    console = Console()
    console.print(finding.headline, style="bold")
    console.print(_errors(finding))
    for line in _legend(finding):
        console.print(line, highlight=False)
    accepted = better.history.diagnosis.accepted if better.history.diagnosis else ()
    effects = {effect.name: effect for effect in accepted}
    for candidate in finding.candidates:
        if candidate.accepted:
            what = describe_effect(candidate.effect, candidate.varies)
            estimates = describe_estimates(effects[candidate.effect], better)
            for line in (f"{candidate.title}: {what}", *(f"  {text}" for text in estimates)):
                console.print(line, markup=False, highlight=False, soft_wrap=True)
    console.print()
    for line in _candidate_lines(finding):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    for remark in finding.remarks:
        console.print(harmless(f"Note: {remark}"), markup=False, highlight=False, soft_wrap=True)


def _errors(finding: Diagnosis) -> Table:
    """Return the table of the errors of each fit, narrow enough for a phone."""
    table = Table("", "fitted", "on the board", "held out", title="Error (root mean square)")
    for column in table.columns[1:]:
        column.justify = "right"
    if _has_given_row(finding):
        given = finding.given
        held_out_px = finding.given_held_out_px
        table.add_row(
            "given fit",
            f"{given.rms_px:.3f} px" if given else "",
            board_error(given.rmse_cm) if given else "",
            f"{held_out_px:.3f} px" if held_out_px is not None else "",
        )
    names = fit_names(had_effects=bool(finding.earlier))
    rows = list(zip(names, (finding.base_quality, finding.final_quality), strict=True))
    for name, quality in rows if finding.added else [("this fit", finding.base_quality)]:
        table.add_row(
            name,
            f"{quality.rms_px:.3f} px",
            board_error(quality.rmse_cm),
            f"{quality.held_out_px:.3f} px",
        )
    noise = finding.noise_px
    table.add_row("noise", "unknown" if noise is None else f"{noise:.3f} px", "", "")
    return table


def _has_given_row(finding: Diagnosis) -> bool:
    """Return True if the calibration as it was given is no other row of the table."""
    has_held_out = finding.given_held_out_px is not None
    return has_held_out or bool(finding.added and finding.given)


def _legend(finding: Diagnosis) -> Iterator[str]:
    """Yield the meaning of the rows of the first table."""
    if _has_given_row(finding):
        yield "Given fit: the calibration that you gave, as it is."
    if finding.added and not finding.earlier:
        yield "Plain fit: this model with a flat board and no effect."
        yield "It uses the priors of the given fit, so it may differ a"
        yield 'little from the row "fitted cover" of calib fit.'
    if not finding.added:
        yield "This fit: where the diagnosis starts, with nothing added."


def _candidate_lines(finding: Diagnosis) -> Iterator[str]:
    """Yield a heading for each outcome, and below it the candidates with this outcome: a line for
    each that was fitted, and a list of those without figures. No line is longer than TABLE_WIDTH.
    """
    groups: dict[str, list[Candidate]] = {}
    for candidate in sorted(
        finding.candidates, key=lambda c: (not c.accepted, c.held_out_px_after is None, c.p_value)
    ):
        groups.setdefault(candidate.outcome, []).append(candidate)
    columns = f"{'held out':>17}{'gain':>18}"
    is_measured = any(candidate.held_out_px_after is not None for candidate in finding.candidates)
    yield f"{'What was considered':<{TITLE_WIDTH}}{columns if is_measured else ''}".rstrip()
    yield "─" * TABLE_WIDTH
    for outcome, group in groups.items():
        yield f"{outcome}:"
        yield from (
            _line(candidate) for candidate in group if candidate.held_out_px_after is not None
        )
        names = [candidate.title for candidate in group if candidate.held_out_px_after is None]
        margin = 2 * " "
        yield from wrap(
            ", ".join(names), TABLE_WIDTH, initial_indent=margin, subsequent_indent=margin
        )
    if is_measured:
        yield from EXPLANATION


def _line(candidate: Candidate) -> str:
    """Return the line of a candidate that was fitted."""
    held_out = f"{candidate.held_out_px_before:.3f} → {candidate.held_out_px_after:.3f}"
    gain = candidate.gain_ci95
    interval = f"{gain[0]:.3f} to {gain[1]:.3f}" if gain else ""
    title = f"  {candidate.title}"
    if len(title) > TITLE_WIDTH:
        title = f"{title}\n{'':<{TITLE_WIDTH}}"
    return f"{title:<{TITLE_WIDTH}}{held_out:>17}{interval:>18}".rstrip()
