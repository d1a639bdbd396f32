"""Figures of a calibration by matplotlib, for papers and notebooks (the extra `plots`).

`residuals` and `distortion` draw into Axes of yours, and `scene` returns a figure of its own.
`write_figures` writes all figures of a report as PNG.
"""

from calib.errors import InputError
from calib.extras import how_to_install

try:
    import matplotlib  # noqa: F401
except ImportError as error:
    raise InputError(f"Pictures of figures need matplotlib: {how_to_install('plots')}") from error

from calib.plots.figures import plot_distortion as distortion
from calib.plots.figures import plot_residuals as residuals
from calib.plots.figures import plot_scene as scene
from calib.plots.figures import write_figures

__all__ = ["distortion", "residuals", "scene", "write_figures"]
