"""The README's picture: what the cover does to a view of a fixture, and what is left of it. `python -m benchmarks.picture`."""

from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np

from calib.apply.undistorter import Undistorter
from calib.fitting.fit import fit
from calib.fitting.stages import Settings
from calib.io.images import read_grey
from calib.progress import Silent
from calib.session.session import read_session
from calib.undistortion.depth_map import DepthMap

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

DEPTH = 0.35  # m
MAGNIFIED = 12
VIEW = "0001.jpg"


def main() -> None:
    session = read_session(Path("fixtures/bumps"))
    calibration = fit(session, Settings(), Silent())
    field = calibration.ray_field()
    made = field.map_at(DEPTH)
    frame = read_grey(session.path / "frames" / VIEW)
    figure, panels = plt.subplots(1, 3, figsize=(13, 3.9), layout="constrained")
    panels[0].imshow(frame, cmap="gray")
    _arrows(panels[0], made)
    panels[0].set_title(f"seen; arrows: distortion at {DEPTH:g} m, x{MAGNIFIED}")
    panels[1].imshow(Undistorter(calibration, DEPTH, interpolation=cv2.INTER_CUBIC).undistort(frame), cmap="gray")
    panels[1].set_title(f"undistorted for {DEPTH:g} m")
    names = [stage.name for stage in calibration.stages]
    errors = [stage.rms_px for stage in calibration.stages]
    bars = panels[2].bar(names, errors, color=["#b0543a", "#c9a24b", "#3f7d58"])
    panels[2].bar_label(bars, [f"{error:.3f} px" for error in errors])
    panels[2].set_title("reprojection error (RMS)")
    panels[2].set_ylabel("px")
    panels[2].spines[["top", "right"]].set_visible(False)
    for panel in panels[:2]:
        panel.set_axis_off()
    figure.savefig("docs/picture.png", dpi=80)


def _arrows(panel: Axes, made: DepthMap) -> None:
    v, u = np.mgrid[40 : made.x.shape[0] : 96, 40 : made.x.shape[1] : 96]
    seen = made.valid[v, u]
    at = np.stack([made.x[v, u], made.y[v, u]], -1)[seen]
    shift = np.stack([u, v], -1)[seen] - at
    panel.quiver(*at.T, *shift.T, angles="xy", scale_units="xy", scale=1 / MAGNIFIED, color="#3fa7d6", width=0.003)


if __name__ == "__main__":
    main()
