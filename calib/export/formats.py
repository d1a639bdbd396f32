"""The forms that a calibration is written in, and the lens models that each of them has. Nothing slow is imported here."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Lens:
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
    lenses: tuple[Lens, ...] = ()
    """Those of a central camera, the simplest first. None: the format holds maps, which are exact at their depth."""


OPENCV = (Lens("4", 4), Lens("5", 5), Lens("8", 8), Lens("12", 12), Lens("fisheye", 4, fisheye=True))
SPLINED = Lens("SPLINED", 0)

FORMATS: tuple[Format, ...] = (
    Format("npz"),
    Format("opencv", OPENCV),
    Format("opencv-xml", OPENCV),
    Format("ros", (Lens("plumb_bob", 5), Lens("rational_polynomial", 8), Lens("equidistant", 4, fisheye=True))),
    Format("kalibr", (Lens("radtan", 4), Lens("equidistant", 4, fisheye=True))),
    Format("colmap", (Lens("OPENCV", 4), Lens("FULL_OPENCV", 8), Lens("OPENCV_FISHEYE", 4, fisheye=True))),
    Format("mrcal", (Lens("OPENCV4", 4), Lens("OPENCV5", 5), Lens("OPENCV8", 8), Lens("OPENCV12", 12), SPLINED)),
    Format("stmap"),
    Format("stmap-exr"),
)
"""In the order of the help."""
