"""A diagnosis on the terminal."""

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.diagnosis.finding import Diagnosis
from calib.diagnosis.found import found
from calib.errors import harmless


def print_diagnosis(finding: Diagnosis, better: Calibration) -> None:
    """What was found first and is in the better calibration, then all that was considered, then what is left."""
    console = Console()
    if finding.accepted:
        console.print(f"[bold]Found: {', '.join(finding.accepted)}[/bold]")
    else:
        console.print("[bold]Nothing found:[/bold] no effect that is known here improves held-out views beyond chance.")
    console.print(_errors(finding))
    for candidate in finding.candidates:
        if candidate.accepted:
            said = "; ".join(found(candidate.effect, better, candidate.parameters))
            console.print(f"{candidate.title}: {said}", markup=False, highlight=False, soft_wrap=True)
    console.print(_considered(finding))
    for remark in finding.remarks:
        console.print(harmless(f"Note: {remark}"), markup=False, highlight=False, soft_wrap=True)


def _errors(finding: Diagnosis) -> Table:
    table = Table("", "fitted views", "on the board", "held-out views", title="Before and after (root mean square)")
    for column in table.columns[1:]:
        column.justify = "right"
    for name, one in (("before", finding.before), ("after", finding.after)):
        table.add_row(name, f"{one.rms_px:.3f} px", f"{one.rmse_cm:.4f} cm", f"{one.held_out_px:.3f} px")
    table.add_row("noise", f"{finding.noise_px:.3f} px", "", "")
    return table


def _considered(finding: Diagnosis) -> Table:
    columns = ("effect", "chi²", "p", "held out, px", "gain, 95 %", "verdict")
    table = Table(*columns, title="What was considered", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for column in table.columns[:5]:
        column.no_wrap = True
    table.columns[5].min_width = len("confirmed")
    for column in table.columns[1:5]:
        column.justify = "right"
    for one in sorted(finding.candidates, key=lambda c: (not c.accepted, c.p_value)):
        held = f"{one.held_out_px_before:.3f} → {one.held_out_px_after:.3f}" if one.held_out_px_after is not None else ""
        gain = f"{one.gain_ci95[0]:.3f} to {one.gain_ci95[1]:.3f}" if one.gain_ci95 else ""
        table.add_row(one.title, f"{one.chi2:.0f}/{one.dof}", _small(one.p_value), held, gain, one.outcome)
    return table


def _small(p_value: float) -> str:
    return "<1e-99" if p_value < 1e-99 else f"{p_value:.1g}"
