"""The forms that a calibration is written in, and the lens models that each of them has. Nothing slow is imported here."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ExportLens:
    """A distortion model, by the name that the format gives it."""

    name: str
    coefficients: int
    """How many it has: 4, 5, 8 or 12, in OpenCV's order; two for each knot of a splined model, 0 before it is fitted."""
    fisheye: bool = False
    """Whether it is the equidistant model of cv2.fisheye, with its 4, for wide lenses."""
    knots: tuple[int, int, float] | None = None
    """Of a splined model: how many along x and y, and how far apart in stereographic coordinates."""


@dataclass(frozen=True, slots=True)
class Format:
    """One value of `calib export --format`."""

    name: str
    lenses: tuple[ExportLens, ...] = ()
    """Those of a central camera, the simplest first. None: the format holds maps, which are exact at their depth."""


OPENCV = (ExportLens("4", 4), ExportLens("5", 5), ExportLens("8", 8), ExportLens("12", 12), ExportLens("fisheye", 4, fisheye=True))
SPLINED = ExportLens("SPLINED", 0)

FORMATS: tuple[Format, ...] = (
    Format("npz"),
    Format("opencv", OPENCV),
    Format("opencv-xml", OPENCV),
    Format("ros", (ExportLens("plumb_bob", 5), ExportLens("rational_polynomial", 8), ExportLens("equidistant", 4, fisheye=True))),
    Format("kalibr", (ExportLens("radtan", 4), ExportLens("equidistant", 4, fisheye=True))),
    Format("colmap", (ExportLens("OPENCV", 4), ExportLens("FULL_OPENCV", 8), ExportLens("OPENCV_FISHEYE", 4, fisheye=True))),
    Format("mrcal", (ExportLens("OPENCV4", 4), ExportLens("OPENCV5", 5), ExportLens("OPENCV8", 8), ExportLens("OPENCV12", 12), SPLINED)),
    Format("stmap"),
    Format("stmap-exr"),
)
"""In the order of the help."""
