"""The picture of docs/pose.md: tags placed in a rendered picture, and the error over depth.

`python -m benchmarks.pose_picture`.
"""

import matplotlib as mpl
import numpy as np

from benchmarks.pose import Placed, pictures
from calib.calibration import Calibration
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views
from calib.io.images import read_grey
from calib.progress import Silent
from calib.session.session import read_session
from fixtures.rays import FIXTURES
from fixtures.tag_errors import Central, TagTruth, aligned

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

SHOWN = "april-050-0300.jpg"
AXES = (("x", "#b0543a"), ("y", "#3f7d58"), ("z", "#2f6db5"))
WAYS = (("calib pose", "#3f7d58", "o-"), ("OpenCV's best central camera", "#b0543a", "s-"))


def main() -> None:
    calibration, truth = (
        fit(read_session(FIXTURES / "bumps")),
        TagTruth.of(FIXTURES / "bumps" / "tags"),
    )
    held, _ = read_views(read_session(FIXTURES / "bumps" / "holdout"), Silent())
    camera = calibration.camera
    assert camera.intrinsics
    central = Central.best(
        calibration.views, held, calibration.board, (camera.width, camera.height), camera.intrinsics
    )
    placed = pictures(calibration, central, truth)
    figure, (left_axes, right) = plt.subplots(
        1, 2, figsize=(13, 4.6), layout="constrained", width_ratios=(1.25, 1)
    )
    _draw(
        left_axes,
        calibration,
        [item for item in placed if truth.names[item.picture] == SHOWN],
        truth,
    )
    _chart(right, placed, truth)
    figure.savefig("docs/pose.png", dpi=80)


def _draw(panel: Axes, calibration: Calibration, placed: list[Placed], truth: TagTruth) -> None:
    panel.imshow(read_grey(truth.folder / SHOWN), cmap="gray")
    for item in placed:
        pose, side = item.tag.poses[0], truth.sides[item.picture]
        ends = calibration.project(
            pose.position
            + np.concatenate([np.zeros((1, 3)), 0.8 * side * pose.turn.T * [[1], [1], [-1]]])
        )
        for end, (_, colour) in zip(ends[1:], AXES, strict=True):
            panel.plot(*np.stack([ends[0], end], -1), color=colour, lw=3)
        x, y, z = 1000 * pose.position
        at_x, at_y = float(item.tag.corners[:, 0].mean()), float(item.tag.corners[:, 1].max()) + 45
        panel.text(
            at_x,
            at_y,
            f"{x:.2f}, {y:.2f}, {z:.2f}",
            ha="center",
            va="top",
            fontsize=9,
            color="white",
        )
    panel.set_title(
        "tags of 50 mm, 0.3 m away, behind the uneven cone: x red, y green, -z blue; mm"
    )
    panel.set_axis_off()


def _chart(panel: Axes, placed: list[Placed], truth: TagTruth) -> None:
    true = np.array([item.true for item in placed])
    side = np.array([truth.sides[item.picture] for item in placed])
    depth = np.array([truth.depths[item.picture] for item in placed])
    places = (
        np.array([item.tag.poses[0].position for item in placed]),
        np.array([item.opencv for item in placed]),
    )
    for (name, colour, mark), positions in zip(WAYS, places, strict=True):
        error = 1000 * np.linalg.norm(aligned(positions, true), axis=-1)
        for size in np.unique(side).tolist():
            at = np.unique(depth[side == size])
            rms = [np.sqrt((error[(side == size) & (depth == item)] ** 2).mean()) for item in at]
            small = size == side.min()
            label, face = f"{name}, {1000 * size:.0f} mm", colour if small else "white"
            panel.plot(
                at,
                rms,
                mark,
                color=colour,
                label=label,
                markerfacecolor=face,
                alpha=1 if small else 0.7,
            )
    panel.set(
        xscale="log",
        yscale="log",
        ylim=(0.003, 30),
        xlabel="depth, m",
        ylabel="error of the place, mm RMS",
    )
    panel.set_title("the same pictures, the same corners")
    panel.set_xticks([0.2, 0.3, 0.5, 0.75, 1, 1.5], ["0.2", "0.3", "0.5", "0.75", "1", "1.5"])
    panel.minorticks_off()
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(alpha=0.3)
    panel.legend(frameon=False)


if __name__ == "__main__":
    main()
