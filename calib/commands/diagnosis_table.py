"""The diagnosis as text and tables on the terminal."""

from collections.abc import Iterator

from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.diagnosis.effect_description import describe_estimates
from calib.diagnosis.finding import Candidate, Diagnosis
from calib.effects.description import describe_effect
from calib.errors import harmless
from calib.table import board_error

LONGEST_TITLE = 38
"""The longest title in the line of its numbers."""
EXPLANATION = (
    "Held out: the error without → with the effect. Gain: its fall, 95 % range.",
    "This table weights corners by their noise; the first table does not.",
)
"""The meaning of the columns, and why they differ from the errors of the first table."""


def print_diagnosis(finding: Diagnosis, better: Calibration) -> None:
    """Print the accepted effects of the better calibration, then the errors, all candidates, and
    the remarks.
    """
    console = Console()
    console.print(finding.headline, style="bold")
    console.print(_errors(finding))
    accepted = better.history.diagnosis.accepted if better.history.diagnosis else ()
    effects = {effect.name: effect for effect in accepted}
    for candidate in finding.candidates:
        if candidate.accepted:
            estimates = "; ".join(describe_estimates(effects[candidate.effect], better))
            what = describe_effect(candidate.effect, candidate.varies)
            console.print(
                f"{candidate.title}: {what} {estimates}",
                markup=False,
                highlight=False,
                soft_wrap=True,
            )
    for line in _candidate_lines(finding):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    for remark in finding.remarks:
        console.print(harmless(f"Note: {remark}"), markup=False, highlight=False, soft_wrap=True)


def _errors(finding: Diagnosis) -> Table:
    table = Table(
        "",
        "fitted views",
        "on the board",
        "held-out views",
        title=f"{'Before and after' if finding.added else 'Error'} (root mean square)",
    )
    for column in table.columns[1:]:
        column.justify = "right"
    if (given_px := finding.given_held_out_px) is not None:
        table.add_row("as given (calib evaluate)", "", "", f"{given_px:.3f} px")
    before, after = finding.base_quality, finding.final_quality
    first = "before" if finding.earlier else "before, with a flat board"
    rows = [(first, before), ("after, with those found", after)]
    for name, quality in rows if finding.added else [("of the calibration", before)]:
        table.add_row(
            name,
            f"{quality.rms_px:.3f} px",
            board_error(quality.rmse_cm),
            f"{quality.held_out_px:.3f} px",
        )
    noise = finding.noise_px
    table.add_row("noise", "unknown" if noise is None else f"{noise:.3f} px", "", "")
    return table


def _candidate_lines(finding: Diagnosis) -> Iterator[str]:
    """Yield a heading for each outcome, and below it a line for each candidate with this outcome.
    No line is longer than 80 characters.
    """
    groups: dict[str, list[Candidate]] = {}
    for candidate in sorted(
        finding.candidates, key=lambda c: (not c.accepted, c.held_out_px_after is None, c.p_value)
    ):
        groups.setdefault(candidate.outcome, []).append(candidate)
    columns = f"{'held out, px':>18}{'gain, px':>18}"
    is_measured = any(candidate.held_out_px_after is not None for candidate in finding.candidates)
    yield f"{'What was considered':<41}{columns if is_measured else ''}".rstrip()
    yield "─" * 77
    for outcome, group in groups.items():
        yield f"{outcome}:"
        yield from map(_line, group)
    if is_measured:
        yield from EXPLANATION


def _line(candidate: Candidate) -> str:
    held_out = (
        f"{candidate.held_out_px_before:.3f} → {candidate.held_out_px_after:.3f}"
        if candidate.held_out_px_after is not None
        else ""
    )
    gain = candidate.gain_ci95
    interval = f"{gain[0]:.3f} to {gain[1]:.3f}" if gain else ""
    title = candidate.title
    if len(title) > LONGEST_TITLE:
        title = f"{title}\n{'':<41}"
    row = f"  {title:<39}{held_out:>18}{interval:>18}"
    return row.rstrip()
