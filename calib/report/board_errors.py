"""Where the corners' rays land on the board, without and with the model: the paper's Fig. 6."""

import numpy as np
from matplotlib.figure import Figure

from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import FAINT, draw, hues, side_by_side

SIDE = 2.6
"""Inches, of a panel."""


def board_errors(evidence: Evidence) -> Drawing:
    covered = evidence.calibration.cover.shape != "none"
    left_out = "the cover" if covered else "lens distortion"
    with_model = 1e3 * evidence.missed.board.numpy()
    panels = [("with the model", with_model, _reach(with_model))]
    if evidence.bare_missed:
        without = 1e3 * evidence.bare_missed.board.numpy()
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
        draw("board-errors", (SIDE, SIDE), paint),
        "Where the ray of each detected corner lands on the board, less where the corner is, in"
        " board coordinates. One colour for each view, the one beside its name below. A view whose"
        " dots lie to one side is bent as a whole; what noise leaves is round and small. One dot in"
        " two hundred may lie outside.",
    )


def _reach(errors: Array) -> float:
    """mm: what holds all but one in two hundred, either way."""
    return float(1.15 * np.nanquantile(np.abs(errors).max(-1), 0.995) + 1e-9)
