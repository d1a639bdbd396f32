"""A diagnosis on the terminal."""

from collections.abc import Iterator

from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.diagnosis.effect_description import describe_estimates
from calib.diagnosis.finding import Candidate, Diagnosis
from calib.effects.description import describe_effect
from calib.errors import harmless


def print_diagnosis(finding: Diagnosis, better: Calibration) -> None:
    """What was found first and is in the better calibration, then all that was considered, then
    what is left.
    """
    console = Console()
    if finding.accepted:
        console.print(f"[bold]Found: {', '.join(finding.accepted)}[/bold]")
    else:
        console.print(
            "[bold]Nothing found:[/bold] no effect that is known here improves held-out views"
            " beyond chance."
        )
    console.print(_errors(finding))
    for candidate in finding.candidates:
        if candidate.accepted:
            said = "; ".join(describe_estimates(candidate.effect, better, candidate.parameters))
            console.print(
                f"{candidate.title}: {describe_effect(candidate.effect)} {said}",
                markup=False,
                highlight=False,
                soft_wrap=True,
            )
    for line in _considered(finding):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    for remark in finding.remarks:
        console.print(harmless(f"Note: {remark}"), markup=False, highlight=False, soft_wrap=True)


def _errors(finding: Diagnosis) -> Table:
    table = Table(
        "",
        "fitted views",
        "on the board",
        "held-out views",
        title="Before and after (root mean square)",
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for name, one in (("before", finding.before), ("after", finding.after)):
        table.add_row(
            name, f"{one.rms_px:.3f} px", f"{one.rmse_cm:.4f} cm", f"{one.held_out_px:.3f} px"
        )
    table.add_row("noise", f"{finding.noise_px:.3f} px", "", "")
    return table


def _considered(finding: Diagnosis) -> Iterator[str]:
    """A heading for each thing that became of candidates, and below it those of which it did; no
    line is longer than 80 characters.
    """
    groups: dict[str, list[Candidate]] = {}
    for one in sorted(
        finding.candidates, key=lambda c: (not c.accepted, c.held_out_px_after is None, c.p_value)
    ):
        groups.setdefault(one.outcome, []).append(one)
    yield f"{'What was considered':<22}{'chi²':>11}{'p':>8}{'held out, px':>18}{'gain, 95 %':>18}"
    yield "─" * 77
    for outcome, group in groups.items():
        yield f"{outcome}:"
        yield from map(_line, group)


def _line(one: Candidate) -> str:
    held = (
        f"{one.held_out_px_before:.3f} → {one.held_out_px_after:.3f}"
        if one.held_out_px_after is not None
        else ""
    )
    gain = f"{one.gain_ci95[0]:.3f} to {one.gain_ci95[1]:.3f}" if one.gain_ci95 else ""
    score = f"{one.chi2:.0f}/{one.dof}"
    row = f"  {one.title:<20}{score:>11}{_small(one.p_value):>8}{held:>18}{gain:>18}"
    return row.rstrip()


def _small(p_value: float) -> str:
    return "<1e-99" if p_value < 1e-99 else f"{p_value:.1g}"
