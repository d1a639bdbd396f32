"""The forms that a calibration is written in, and the lens models that each of them has.

Nothing slow is imported here.
"""

from dataclasses import dataclass
from importlib.util import find_spec

from calib.extras import how_to_install

BRIEF = 37
"""Characters, of which a list in a narrow window has room."""


@dataclass(frozen=True, slots=True)
class ExportLens:
    """A distortion model, by the name that the format gives it."""

    name: str
    coefficients: int
    """How many it has: 4, 5, 8 or 12, in OpenCV's order; two for each knot of a splined model, 0
    before it is fitted.
    """
    fisheye: bool = False
    """Whether it is the equidistant model of cv2.fisheye, with its 4, for wide lenses."""
    knots: tuple[int, int, float] | None = None
    """Of a splined model: how many along x and y, and how far apart in stereographic coordinates.
    """
    windshield: bool = False
    """Whether the lens, of 12 coefficients or of a fisheye's 4, stands behind four polynomials,
    whose coefficients follow its own.
    """


@dataclass(frozen=True, slots=True)
class Format:
    """One value of `calib export --format`."""

    name: str
    module: str
    """Of this package, with `export(wanted: Export) -> Exported`.

    It is imported when it is asked for.
    """
    summary: str
    """For the help."""
    lenses: tuple[ExportLens, ...] = ()
    """Those of a central camera, the simplest first.

    None: the format holds maps, which are exact at their depth.
    """
    needs_depth: bool = True
    """Whether its files hold for one depth."""
    needs: str = ""
    """The library that it is written with, by the name it is imported by, where refracal installs
    that only with an extra.
    """
    lacking: str = ""
    """What to do where that is absent."""
    files: tuple[str, ...] = ()
    """Names of its files: with {depth}, one for each depth; {axes} is of a ray image, {mesh} of a
    warp mesh. They are refused before the work where a file that calib did not write has the name.
    """
    brief: str = ""
    """The summary of no more than BRIEF characters, where it is longer than that."""

    @property
    def writable(self) -> bool:
        return not self.needs or find_spec(self.needs) is not None


OPENCV = (
    ExportLens("4", 4),
    ExportLens("5", 5),
    ExportLens("8", 8),
    ExportLens("12", 12),
    ExportLens("fisheye", 4, fisheye=True),
)
ROS = (
    ExportLens("plumb_bob", 5),
    ExportLens("rational_polynomial", 8),
    ExportLens("equidistant", 4, fisheye=True),
)
COLMAP = (
    ExportLens("OPENCV", 4),
    ExportLens("FULL_OPENCV", 8),
    ExportLens("OPENCV_FISHEYE", 4, fisheye=True),
)
SPLINED = ExportLens("SPLINED", 0)
MRCAL = (
    ExportLens("OPENCV4", 4),
    ExportLens("OPENCV5", 5),
    ExportLens("OPENCV8", 8),
    ExportLens("OPENCV12", 12),
    SPLINED,
)

WINDSHIELD = (
    ExportLens("opencv-pinhole", 12 + 4 * 21, windshield=True),
    ExportLens("opencv-fisheye", 4 + 4 * 21, fisheye=True, windshield=True),
)

AXES = ("opencv", "opengl")
"""Of a ray image: x right, y down, z forward, or x right, y up, z backward."""

FORMATS: tuple[Format, ...] = (
    Format(
        *(
            "npz",
            "npz",
            (
                "the ray field, from which any depth's map follows, and the maps of cv2.remap for"
                " every --depth"
            ),
        ),
        needs_depth=False,
        brief="maps for cv2.remap, and every ray",
        files=("rays.npz", "map_{depth}m.npz"),
    ),
    Format(
        *(
            "opencv",
            "opencv",
            "FileStorage YAML, and the exact maps of cv2.remap as float TIFF",
            OPENCV,
        ),
        brief="FileStorage YAML, and maps as TIFF",
        files=("camera_{depth}m.yaml", "map_x_{depth}m.tiff", "map_y_{depth}m.tiff"),
    ),
    Format(
        "opencv-xml",
        "opencv",
        "the same with FileStorage XML",
        OPENCV,
        files=("camera_{depth}m.xml", "map_x_{depth}m.tiff", "map_y_{depth}m.tiff"),
    ),
    Format("ros", "ros", "camera_info", ROS, files=("camera_info_{depth}m.yaml",)),
    Format(
        "kalibr",
        "kalibr",
        "camchain",
        (ExportLens("radtan", 4), ExportLens("equidistant", 4, fisheye=True)),
        files=("camchain_{depth}m.yaml",),
    ),
    Format("colmap", "colmap", "cameras.txt", COLMAP, files=("cameras_{depth}m.txt",)),
    Format("mrcal", "mrcal", ".cameramodel", MRCAL, files=("camera_{depth}m.cameramodel",)),
    Format(
        *(
            "windshield",
            "windshield",
            "the windshield model of NVIDIA NCore and gsplat",
            WINDSHIELD,
        ),
        brief="of NVIDIA NCore and gsplat",
        files=("windshield_{depth}m.json",),
    ),
    Format(
        "depthai", "depthai", "warp mesh of Luxonis cameras", files=("mesh_{depth}m_{mesh}.calib",)
    ),
    Format(
        *(
            "generic",
            "generic",
            (
                "NoncentralGenericModel of Schöps et al. (puzzlepaint), a line for every pixel at"
                " every depth"
            ),
        ),
        needs_depth=False,
        brief="a line for every pixel, puzzlepaint's",
        files=("intrinsics0.yaml",),
    ),
    Format(
        *(
            "calibmar",
            "calibmar",
            "a flat port or dome, for every depth, for Calibmar and COLMAP's underwater fork",
            COLMAP,
        ),
        needs_depth=False,
        brief="flat port or dome, also for COLMAP",
        files=("calibmar.yaml",),
    ),
    Format(
        *(
            "ray-image",
            "ray_image",
            (
                "origin and direction of every pixel's ray, for ray tracers: (height, width, 2, 3)"
                " float32"
            ),
        ),
        needs_depth=False,
        brief="every pixel's ray, for ray tracers",
        files=("ray_image{axes}.npy",),
    ),
    Format(
        *("stmap", "stmap", "for compositing programs: undistort and redistort, 32-bit float TIFF"),
        brief="for compositing programs, as TIFF",
        files=("stmap_undistort_{depth}m.tiff", "stmap_redistort_{depth}m.tiff"),
    ),
    Format(
        *("stmap-exr", "stmap", "the same as OpenEXR"),
        needs="OpenEXR",
        lacking=(
            f"OpenEXR is not installed: {how_to_install('exr')}, or use --format stmap, which"
            " writes TIFF."
        ),
        files=("stmap_undistort_{depth}m.exr", "stmap_redistort_{depth}m.exr"),
    ),
)
"""In the order of the help. A new format is a module of this package and a line here."""
