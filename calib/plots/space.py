"""Camera, cover and boards in space."""

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from calib.plots.style import BLUE, ERRORS, FAINT, INK, STYLE
from calib.report.chart import border_pixels
from calib.report.evidence import Array, Evidence
from calib.report.scene import surface_meshes, ways

SIZE = (7.0, 6.0)
"""Width and height in inches."""
POINT_SIZE = 3.0
"""Points^2, of a point of a target that is not flat."""


def space_figure(evidence: Evidence) -> Figure:
    """Draw the camera, its cover, and every board, or the points of a target that is not flat, in
    the colour of its error. Axes are x to the right, z ahead and y down, m.
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        figure = Figure(SIZE, layout="constrained")
        axes: Axes3D = figure.add_subplot(projection="3d")
        errors = evidence.rms_by_view
        colours = ScalarMappable(Normalize(float(errors.min()), float(errors.max())), ERRORS)
        outlines = board_outlines(evidence)
        if evidence.calibration.board.is_flat:
            boards = Poly3DCollection(
                _turned(outlines), facecolors=colours.to_rgba(errors, alpha=0.85), edgecolors=INK
            )
            boards.set_linewidth(0.5)
            axes.add_collection3d(boards)
        else:
            outlines = evidence.points
            inks = colours.to_rgba(errors)[evidence.view]
            axes.scatter(*_turned(outlines).T, s=POINT_SIZE, c=inks, depthshade=False)
        for mesh in surface_meshes(evidence):
            axes.plot_surface(*np.moveaxis(_turned(mesh), -1, 0), color=BLUE, alpha=0.3)
        border = ways(evidence, border_pixels(evidence, 1))
        far = evidence.reach[1]
        ends = border.points[:, -1] + far * border.direction
        for path in _turned(np.concatenate([border.points, ends[:, None]], 1)):
            axes.plot(*path.T, color=FAINT, linewidth=0.8)
        points = np.concatenate([_turned(outlines).reshape(-1, 3), np.zeros((1, 3))])
        axes.set(xlabel="x (m)", ylabel="z (m)", zlabel="y (m)")
        axes.auto_scale_xyz(*points.T)
        axes.set_aspect("equal")
        axes.invert_zaxis()  # y is down
        axes.view_init(elev=22, azim=-60)
        figure.colorbar(colours, ax=axes, label="error (px)", shrink=0.6)
    return figure


def board_outlines(evidence: Evidence) -> Array:
    """Return (V, 4, 3) m, the outer corners of the boards in the camera frame."""
    board = evidence.calibration.board
    half = [*(half + board.square for half in board.half), 1.0]
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
    return np.array(
        [square @ cv2.Rodrigues(pose[:3])[0].T + pose[3:6] for pose in evidence.calibration.poses]
    )


def _turned(points: Array) -> Array:
    """Return (..., 3) x, z, y of points x, y, z: matplotlib's third axis is upright."""
    return points[..., [0, 2, 1]]
