"""The README's picture: bent lines and straight ones, the screen that guides, how the error falls.
`python -m benchmarks.picture`.

All figures in it are of the fit of `fixtures/bumps`, as `calib fit` prints them, and are printed.
The screen is of docs/tui.gif.
"""

from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from calib.apply.undistorter import Undistorter
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.io.images import read_grey
from calib.progress import Silent
from calib.report.evidence import gather_evidence
from calib.report.straight import BoardLine, lines_across
from calib.session.session import read_session

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

MAGNIFIED = 25
"""The factor by which bends are drawn larger, before and after alike: they are of some px."""
BENT, STRAIGHT = "#e8833a", "#2f8fdd"
TITLES = {"pinhole": "camera alone", "cover": "smooth cover", "cover+rbf": "fitted cover"}
GHOST = np.array([200, 160, 0])
"""RGB, about that of the frame that shows where to hold the board."""
Array = NDArray[np.float64]


def main() -> None:
    session = read_session(Path("fixtures/bumps"))
    calibration = fit(session, Settings(), Silent())
    evidence = gather_evidence(calibration)
    view, lines = max(
        enumerate(list(lines_across(evidence, view)) for view in range(len(calibration.views))),
        key=lambda item: _bend(item[1]),
    )
    depth = float(np.median(evidence.depth[evidence.view == view]))
    frame = read_grey(session.path / "frames" / calibration.views[view].name)
    straight = Undistorter(calibration, depth, interpolation=cv2.INTER_CUBIC).undistort(frame)
    error = np.concatenate(
        [
            line.undistorted_corners - _on(line.undistorted_corners, line.undistorted)
            for line in lines
        ]
    )
    rms = float(np.sqrt((error**2).sum(-1).mean()))

    figure, panels = plt.subplots(
        2, 2, figsize=(11, 7.7), gridspec_kw={"wspace": 0.04, "hspace": 0.14}
    )
    _panel(
        panels[0, 0],
        frame,
        lines,
        f"Through the cover: lines bend by up to {_bend(lines):.1f} px",
        is_straight=False,
    )
    _panel(
        panels[0, 1],
        straight,
        lines,
        f"Undistorted for {depth:.2f} m: corners straight to {rms:.2f} px",
        is_straight=True,
    )
    panels[1, 0].imshow(_screen(), interpolation="antialiased")
    panels[1, 0].set_title("The screen guides: where to hold the board next", fontsize=12)
    for panel in panels.flat[:3]:
        panel.set_axis_off()
    _bars(panels[1, 1], [(TITLES[stage.name], stage.rms_px) for stage in calibration.stages])
    sentence = (
        f"Rows and columns of the board, continued. What they bend is drawn {MAGNIFIED} times as"
        " large, in both pictures alike."
    )
    figure.text(0.5, 0.497, sentence, ha="center", color="#64748b", fontsize=10)
    figure.savefig("docs/picture.png", dpi=110, bbox_inches="tight")
    print(
        *(f"{stage.name}: {stage.rms_px:.3f} px" for stage in calibration.stages),
        f"{calibration.views[view].name}: bend {_bend(lines):.1f} px, left {rms:.2f} px",
        sep="; ",
    )


def _panel(
    panel: Axes, picture: NDArray[Any], lines: list[BoardLine], title: str, *, is_straight: bool
) -> None:
    panel.imshow(picture, cmap="gray", vmin=0, vmax=255)
    height, width = picture.shape
    panel.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    for line in lines:
        points = line.undistorted if is_straight else line.distorted
        corners = line.undistorted_corners if is_straight else line.corners
        panel.plot(
            *_magnified(points, points).T, color=STRAIGHT if is_straight else BENT, linewidth=1.4
        )
        panel.plot(*_magnified(corners, points).T, ".", color="white", markersize=2.5)
    panel.set_title(title, fontsize=12)


def _bars(panel: Axes, errors: list[tuple[str, float]]) -> None:
    places = range(len(errors))[::-1]
    bars = panel.barh(
        places, [error for _, error in errors], color=["#b0543a", "#c9a24b", "#3f7d58"], height=0.45
    )
    panel.bar_label(bars, [f" {error:.3f} px" for _, error in errors], fontsize=13)
    for place, (name, _) in zip(places, errors, strict=True):
        panel.text(0, place + 0.27, name, fontsize=11, va="bottom")
    panel.set(xlim=(0, 1.3 * errors[0][1]), ylim=(-0.5, 2.7), xticks=[], yticks=[], box_aspect=0.6)
    panel.set_title("What is left of the error", fontsize=12)
    panel.spines[["top", "right", "bottom"]].set_visible(False)


def _bend(lines: list[BoardLine]) -> float:
    """px, the most that one of them is away from a straight line."""
    return max(
        (
            float(
                np.linalg.norm(line.distorted - _on(line.distorted, line.distorted), axis=-1).max()
            )
            for line in lines
        ),
        default=0.0,
    )


def _on(points: Array, line: Array) -> Array:
    """(n, 2) px: the feet of points on the straight line that misses a line's points least."""
    middle = line.mean(0)
    direction = np.linalg.svd(line - middle, full_matrices=False)[2][0]
    return np.asarray(middle + np.outer((points - middle) @ direction, direction))


def _magnified(points: Array, line: Array) -> Array:
    feet = _on(points, line)
    return np.asarray(feet + MAGNIFIED * (points - feet))


def _screen() -> NDArray[np.uint8]:
    """Return the picture of the film that shows most of the frame in which to hold the board."""
    with Image.open("docs/tui.gif") as film:
        pictures = []
        for number in range(getattr(film, "n_frames", 1)):
            film.seek(number)
            pictures.append(np.asarray(film.convert("RGB")))
    return max(
        pictures, key=lambda picture: int((np.abs(picture.astype(int) - GHOST).max(-1) < 60).sum())
    )


if __name__ == "__main__":
    main()
