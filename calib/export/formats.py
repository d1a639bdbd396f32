"""The formats that a calibration is written in, and the lens models of each format.

Nothing slow is imported here.
"""

from dataclasses import dataclass
from importlib.util import find_spec

from calib.extras import how_to_install

BRIEF = 37
"""Characters of a summary that fit a list in a narrow window."""


@dataclass(frozen=True, slots=True)
class ExportLens:
    """A distortion model, by the format's name for it."""

    name: str
    coefficients: int
    """The number of coefficients: 4, 5, 8 or 12, in OpenCV's order; two for each knot of a splined
    model, 0 before it is fitted.
    """
    fisheye: bool = False
    """True for the equidistant model of cv2.fisheye, with its 4 coefficients, for wide lenses."""
    knots: tuple[int, int, float] | None = None
    """The number of knots along x and y of a splined model, and their spacing in stereographic
    coordinates.
    """
    windshield: bool = False
    """True if the lens, of 12 coefficients or of a fisheye's 4, stands behind four polynomials.
    Their coefficients follow its own.
    """


@dataclass(frozen=True, slots=True)
class Format:
    """One value of `calib export --format`."""

    name: str
    module: str
    """The module of this package, with `export(request: ExportRequest) -> ExportedFiles`.

    It is imported when it is first used.
    """
    summary: str
    """The text in the help."""
    lenses: tuple[ExportLens, ...] = ()
    """The lenses of a central camera, the simplest first.

    Empty: the format holds maps, which are exact at their depth, or rays.
    """
    needs_depth: bool = True
    """True if each of its files holds for one depth."""
    needs: str = ""
    """The import name of the library that writes the format, if refracal installs it only with an
    extra.
    """
    lacking: str = ""
    """The sentence that says what to do if that library is missing."""
    files: tuple[str, ...] = ()
    """Names of its files. {depth} stands for each depth, {axes} for those of a ray image, {mesh}
    for the steps of a warp mesh. A file of one of these names that calib did not write is refused
    before the work.
    """
    brief: str = ""
    """A summary of at most BRIEF characters, if `summary` is longer."""

    @property
    def writable(self) -> bool:
        """True if the library that the format needs is installed."""
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

PHOTONVISION = (ExportLens("5", 5), ExportLens("8", 8))
NERFSTUDIO = (ExportLens("OPENCV", 5), ExportLens("OPENCV_FISHEYE", 4, fisheye=True))

AXES = ("opencv", "opengl")
"""The axes of a ray image: x right, y down, z forward, or x right, y up, z backward."""

FORMATS: tuple[Format, ...] = (
    Format(
        "npz",
        "npz",
        "the ray field, from which any depth's map follows, and the maps of cv2.remap for"
        " every --depth",
        needs_depth=False,
        brief="maps for cv2.remap, and every ray",
        files=("rays.npz", "map_{depth}m.npz"),
    ),
    Format(
        "opencv",
        "opencv",
        "FileStorage YAML, and the exact maps of cv2.remap as float TIFF",
        OPENCV,
        brief="FileStorage YAML, and maps as TIFF",
        files=("camera_{depth}m.yaml", "map_x_{depth}m.tiff", "map_y_{depth}m.tiff"),
    ),
    Format(
        "opencv-xml",
        "opencv",
        "the same with FileStorage XML",
        OPENCV,
        brief="as opencv, with FileStorage XML",
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
    Format(
        "nerfstudio",
        "nerfstudio",
        "the camera of transforms.json",
        NERFSTUDIO,
        files=("transforms_{depth}m.json",),
    ),
    Format(
        "photonvision",
        "photonvision",
        "the calibration of one resolution",
        PHOTONVISION,
        files=("photonvision_{depth}m.json",),
    ),
    Format("mrcal", "mrcal", ".cameramodel", MRCAL, files=("camera_{depth}m.cameramodel",)),
    Format(
        "windshield",
        "windshield",
        "the windshield model of NVIDIA NCore and gsplat",
        WINDSHIELD,
        brief="the model of NVIDIA NCore and gsplat",
        files=("windshield_{depth}m.json",),
    ),
    Format(
        "depthai", "depthai", "warp mesh of Luxonis cameras", files=("mesh_{depth}m_{mesh}.calib",)
    ),
    Format(
        "generic",
        "generic",
        "NoncentralGenericModel of Schöps et al. (puzzlepaint), a line for every pixel at"
        " every depth",
        needs_depth=False,
        brief="a line for every pixel, puzzlepaint's",
        files=("intrinsics0.yaml",),
    ),
    Format(
        "calibmar",
        "calibmar",
        "a flat port or dome, for every depth, for Calibmar and COLMAP's underwater fork",
        COLMAP,
        needs_depth=False,
        brief="flat port or dome, also for COLMAP",
        files=("calibmar.yaml",),
    ),
    Format(
        "ray-image",
        "ray_image",
        "origin and direction of every pixel's ray, for ray tracers: (height, width, 2, 3) float32",
        needs_depth=False,
        brief="every pixel's ray, for ray tracers",
        files=("ray_image{axes}.npy",),
    ),
    Format(
        "mitsuba",
        "mitsuba",
        "a sensor of Mitsuba 3 that shoots every pixel's ray",
        needs_depth=False,
        brief="a sensor of Mitsuba 3",
        files=("ray_image.npy", "refracal_mitsuba.py"),
    ),
    Format(
        "blender",
        "blender",
        "a custom camera of Blender 5: an OSL shader and its textures of rays",
        needs_depth=False,
        brief="a custom camera of Blender 5",
        files=("ray_origin.tiff", "ray_direction.tiff", "refracal_camera.osl"),
    ),
    Format(
        "gsplat",
        "gsplat",
        "rays of gsplat's rasterize_to_pixels_eval3d: (1, height, width, 6) float32",
        needs_depth=False,
        brief="every pixel's ray, for gsplat",
        files=("gsplat_rays.npy",),
    ),
    Format(
        "stmap",
        "stmap",
        "for compositing programs: undistort and redistort, 32-bit float TIFF",
        brief="for compositing programs, as TIFF",
        files=("stmap_undistort_{depth}m.tiff", "stmap_redistort_{depth}m.tiff"),
    ),
    Format(
        "stmap-exr",
        "stmap",
        "the same as OpenEXR",
        brief="as stmap, with OpenEXR files",
        needs="OpenEXR",
        lacking=(
            f"OpenEXR is not installed: {how_to_install('exr')}, or use --format stmap, which"
            " writes TIFF."
        ),
        files=("stmap_undistort_{depth}m.exr", "stmap_redistort_{depth}m.exr"),
    ),
)
"""All formats, in the order of the help. A new format is a module of this package and a line
here.
"""
