"""Figure: the board errors of the corners, without and with the model (the paper's Fig. 6)."""

import numpy as np
from matplotlib.figure import Figure

from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import FAINT, draw_svg, hues, side_by_side

SIDE = 2.6
"""The side of a panel, in inches."""


def board_errors(evidence: Evidence) -> Drawing:
    covered = evidence.calibration.cover.shape != "none"
    left_out = "the cover" if covered else "lens distortion"
    with_model = 1e3 * evidence.residuals.board.numpy()
    panels = [("with the model", with_model, _reach(with_model))]
    if evidence.bare_residuals:
        without = 1e3 * evidence.bare_residuals.board.numpy()
        reach = _reach(without)
        closer = reach / panels[0][2]
        panels = [(f"without {left_out}", without, reach), ("with the model", with_model, reach)]
        if closer > 2:
            panels.append((f"the same, {closer:.0f} times closer", with_model, reach / closer))

    def paint(figure: Figure) -> None:
        colours = hues(len(evidence.calibration.views))[evidence.view]
        for axes, (name, errors, reach) in zip(
            side_by_side(figure, [SIDE] * len(panels), [0.65] * len(panels)), panels, strict=True
        ):
            axes.axhline(0, color=FAINT, linewidth=0.6)
            axes.axvline(0, color=FAINT, linewidth=0.6)
            axes.scatter(
                errors[:, 0],
                errors[:, 1],
                s=5,
                c=colours,
                alpha=0.75,
                linewidths=0,
                rasterized=True,
            )
            rms = float(np.sqrt(np.nanmean((errors**2).sum(-1))))
            axes.set(
                xlim=(-reach, reach),
                ylim=(reach, -reach),
                aspect="equal",
                xlabel="x (mm)",
                title=f"{name}: {rms:.2g} mm RMS",
            )
            axes.locator_params(nbins=4)
        figure.axes[0].set_ylabel("y (mm)")

    return Drawing(
        "board-errors",
        "Corner errors on the board",
        draw_svg("board-errors", (SIDE, SIDE), paint),
        "For each detected corner, the point where its ray meets the board minus the true corner,"
        " in board coordinates. Each view has a colour, shown beside its name below. Noise alone"
        " gives a small round cloud around zero; a view whose dots lie to one side has an error of"
        " its own. One dot in two hundred may lie outside the panel.",
    )


def _reach(errors: Array) -> float:
    """Return the axis limit in mm that holds 99.5 % of the errors in both directions."""
    return float(1.15 * np.nanquantile(np.abs(errors).max(-1), 0.995) + 1e-9)
