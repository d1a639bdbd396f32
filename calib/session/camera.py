"""The bare camera as a session describes it: its size, and its intrinsics if they are given."""

from dataclasses import dataclass, replace

import numpy as np

from calib.session.lens import (
    AUTO,
    COEFFICIENTS,
    COUNTS,
    FISHEYE,
    LENSES,
    MODELS,
    NAMES,
    OPENCV,
    SPLINED,
)
from calib.session.lens_spline import LensSpline, read_spline, spline_to_yaml
from calib.session.schema import UNKNOWN, Number, Quantity, Section, is_unknown
from calib.session.shutter import EXAMPLE as SHUTTER_EXAMPLE
from calib.session.shutter import Shutter, read_shutter, shutter_to_yaml
from calib.session.tolerances import (
    TANGENTIAL_NAMES,
    UNKNOWN_CENTRE,
    UNKNOWN_FOCAL,
    UNKNOWN_RADIAL,
    UNKNOWN_TANGENTIAL,
)

MAX_PIXELS = 2**28
"""Pixels of a picture: the largest sensors have as many, and the map of such a picture takes 2.4
GB.
"""

PINHOLE = (
    Quantity("fx", low=1, high=1e7),
    Quantity("fy", low=1, high=1e7),
    Quantity("cx"),
    Quantity("cy"),
)
INTRINSICS_KEYS = (
    *(quantity.key for quantity in PINHOLE),
    *("distortion", "correlations", "model", "spline"),
)
COEFFICIENT = Quantity("distortion", wide=UNKNOWN_RADIAL)
TANGENTIAL_COEFFICIENT = replace(COEFFICIENT, wide=UNKNOWN_TANGENTIAL)
UNKNOWN_COEFFICIENTS = 5
"""The number of OpenCV's coefficients of a lens that nobody knows, behind a cover: more could
imitate the cover.
"""
CORRELATION = Quantity("correlations", low=-1, high=1)
EXPLANATIONS = {
    "width": ("px, of the pictures", ""),
    "height": ("px, of the pictures", ""),
    "model": ("the camera's name", "Raspberry Pi Camera Module v2"),
    "intrinsics": (
        "The lens without its cover. If left out, the fit takes it from the pictures in bare/, else"
        " from the pictures of the session.",
        "{fx: 1279.2, fy: 1279.2, cx: 832.8, cy: 636.6, distortion: [0, 0, 0, 0, 0]}",
    ),
    "lens": (
        f"The lens model: {OPENCV} for usual lenses, {FISHEYE} for wide ones, {SPLINED} for lenses"
        f" that no formula describes, {AUTO} to take the best of them.",
        AUTO,
    ),
    "lens_coefficients": (
        f"How many coefficients the model {OPENCV} has: one of"
        f" {', '.join(map(str, COEFFICIENTS))}.",
        "5",
    ),
    "shutter": ("global, or rolling with the time of its readout, if known", SHUTTER_EXAMPLE),
}
"""The explanation of each key, for someone who has never seen a session.yaml; and an example of an
optional one.
"""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """The intrinsics in px: a pinhole with cv2's distortion, or a fisheye lens of cv2.fisheye, with
    a spline or without.
    """

    fx: Number
    fy: Number
    cx: Number
    cy: Number
    distortion: tuple[Number, ...] = ()
    """The model's coefficients, in the order of `calib.session.lens.NAMES`."""
    correlations: tuple[tuple[float, ...], ...] = ()
    """Rows of the correlation matrix below its diagonal: for each number but the first, in the
    order of these fields, its correlation with every number before it.

    Empty: the numbers are independent.
    """
    model: str = OPENCV
    """A name of `calib.session.lens.MODELS`."""
    spline: LensSpline | None = None
    """The displacement of a splined lens, applied before its fisheye formula."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its coefficients."""
        return NAMES[self.model][: len(self.distortion)]

    @property
    def is_unknown(self) -> bool:
        """True if no number of it is known."""
        return all(n.unknown for n in (self.fx, self.fy, self.cx, self.cy, *self.distortion))

    @property
    def distorts(self) -> bool:
        """True if a coefficient may differ from zero, or the model is no pinhole even without
        coefficients.
        """
        return self.model != OPENCV or any(
            number.value or number.sigma for number in self.distortion
        )


@dataclass(frozen=True, slots=True)
class Camera:
    """The camera of a session."""

    width: int
    """px"""
    height: int
    """px"""
    model: str = ""
    """The camera's name."""
    intrinsics: Intrinsics | None = None
    """None: to be estimated from pictures without the cover."""
    lens_coefficients: int | None = None
    """The number of OpenCV's distortion coefficients to fit.

    None: as few as held-out views justify.
    """
    lens: str | None = None
    """The lens model to fit, a name of `calib.session.lens.MODELS`, or AUTO. None: not stated."""
    shutter: Shutter | None = None
    """None: it is not known whether the sensor's lines are read one after the other."""


def read_camera(section: Section) -> Camera:
    """Read the section `camera` of session.yaml; raise InputError if it is not valid."""
    section.allow_only(tuple(EXPLANATIONS), inner={"intrinsics": INTRINSICS_KEYS})
    counts = f"one of the whole numbers {', '.join(map(str, COEFFICIENTS))}"
    width = section.integer("width", 1, 100_000)
    height = section.integer("height", 1, 100_000)
    written = section.values.get("intrinsics")
    intrinsics = (
        _read_intrinsics(section, (width, height))
        if "intrinsics" in section.values and not is_unknown(written)
        else None
    )
    lens = (
        section.choice("lens", LENSES, f"one of {', '.join(LENSES)}")
        if "lens" in section.values
        else None
    )
    if lens not in (None, OPENCV, AUTO) and "lens_coefficients" in section.values:
        raise section.error(
            "lens_coefficients",
            section.values["lens_coefficients"],
            f"nothing: it is OpenCV's, and lens is {lens}",
        )
    if intrinsics and lens not in (None, AUTO, intrinsics.model):
        raise section.error(
            "lens", lens, f"{intrinsics.model}, the model of camera.intrinsics, or drop the key"
        )
    if width * height > MAX_PIXELS:
        raise section.error(
            "height",
            height,
            f"the pictures' own: {width}x{height} px are more than a sensor has, {MAX_PIXELS:,} at"
            " most",
        )
    camera = Camera(
        width=width,
        height=height,
        model=section.text("model", "the camera's name", default=""),
        intrinsics=intrinsics,
        lens=lens,
        lens_coefficients=(
            section.choice("lens_coefficients", COEFFICIENTS, counts)
            if "lens_coefficients" in section.values
            else None
        ),
        shutter=read_shutter(section),
    )
    return replace(camera, intrinsics=unknown_intrinsics(camera)) if is_unknown(written) else camera


def camera_to_yaml(camera: Camera) -> dict[str, object]:
    """Return the mapping that `read_camera` reads as this camera."""
    document: dict[str, object] = {"width": camera.width, "height": camera.height}
    if camera.model:
        document["model"] = camera.model
    if camera.intrinsics:
        k = camera.intrinsics
        intrinsics: dict[str, object] = {} if k.model == OPENCV else {"model": k.model}
        intrinsics |= {
            q.key: q.to_yaml(n) for q, n in zip(PINHOLE, (k.fx, k.fy, k.cx, k.cy), strict=True)
        }
        intrinsics["distortion"] = [COEFFICIENT.to_yaml(number) for number in k.distortion]
        if k.spline:
            intrinsics["spline"] = spline_to_yaml(k.spline)
        if k.correlations:
            intrinsics["correlations"] = [list(row) for row in k.correlations]
        document["intrinsics"] = intrinsics
    if camera.lens is not None:
        document["lens"] = camera.lens
    if camera.lens_coefficients is not None:
        document["lens_coefficients"] = camera.lens_coefficients
    if camera.shutter:
        document["shutter"] = shutter_to_yaml(camera.shutter)
    return document


def _read_intrinsics(camera: Section, size: tuple[int, int]) -> Intrinsics:
    section = camera.section(
        "intrinsics", "{fx: 1279.2, fy: 1279.2, cx: 832.8, cy: 636.6, distortion: [0, 0, 0, 0, 0]}"
    )
    section.allow_only(INTRINSICS_KEYS)
    model = (
        section.choice("model", MODELS, f"one of {', '.join(MODELS)}")
        if "model" in section.values
        else OPENCV
    )
    pinhole = {
        quantity.key: section.read(quantity)[quantity.key] for quantity in _pinhole_within(size)
    }
    expected = (
        f"a list of {', '.join(map(str, COUNTS[model]))} numbers in"
        f" {'OpenCV' if model == OPENCV else 'cv2.fisheye'}'s order"
    )
    coefficients = section.values.get("distortion", [])
    if is_unknown(coefficients):
        coefficients = [UNKNOWN] * _count_unknown(model)
    if not isinstance(coefficients, list) or len(coefficients) not in COUNTS[model]:
        raise section.error("distortion", coefficients, expected)
    if model != SPLINED and "spline" in section.values:
        raise section.error(
            "spline", section.values["spline"], f"nothing: a lens of the model {model} has none"
        )
    spline = read_spline(section, size) if model == SPLINED else None
    distortion = tuple(
        section.number(f"distortion[{i}]", entry, _coefficient(name))
        for i, (name, entry) in enumerate(zip(NAMES[model], coefficients, strict=False))
    )
    return Intrinsics(
        fx=pinhole["fx"],
        fy=pinhole["fy"],
        cx=pinhole["cx"],
        cy=pinhole["cy"],
        distortion=distortion,
        correlations=_read_correlations(section, 3 + len(coefficients)),
        model=model,
        spline=spline,
    )


def without_unknown(camera: Camera) -> Camera:
    """Return the camera without intrinsics of which no number is known."""
    stated = camera.intrinsics
    if not (stated and stated.is_unknown):
        return camera
    lens = camera.lens if stated.model == OPENCV else stated.model
    return replace(camera, intrinsics=None, lens=lens)


def unknown_intrinsics(camera: Camera) -> Intrinsics:
    """Return intrinsics of which no number is known, for the lens that the camera states, or else
    one of OpenCV's.
    """
    model = FISHEYE if camera.lens == FISHEYE else OPENCV
    count = camera.lens_coefficients
    if count is None:
        count = _count_unknown(model)
    fx, fy, cx, cy = _pinhole_within((camera.width, camera.height))
    return Intrinsics(
        fx=fx.unknown_numbers[fx.key],
        fy=fy.unknown_numbers[fy.key],
        cx=cx.unknown_numbers[cx.key],
        cy=cy.unknown_numbers[cy.key],
        distortion=tuple(
            _coefficient(name).unknown_numbers[COEFFICIENT.key] for name in NAMES[model][:count]
        ),
        model=model,
    )


def _count_unknown(model: str) -> int:
    """Return the number of coefficients of an unknown lens of this model."""
    return UNKNOWN_COEFFICIENTS if model == OPENCV else COUNTS[model][-1]


def _coefficient(name: str) -> Quantity:
    return TANGENTIAL_COEFFICIENT if name in TANGENTIAL_NAMES else COEFFICIENT


def _pinhole_within(size: tuple[int, int]) -> tuple[Quantity, ...]:
    """Return the pinhole's numbers with their priors for pictures of this width and height, px."""
    longer = max(size)
    focal = replace(
        UNKNOWN_FOCAL, mean=UNKNOWN_FOCAL.mean * longer, sigma=UNKNOWN_FOCAL.sigma * longer
    )
    centres = [
        replace(
            UNKNOWN_CENTRE,
            mean=UNKNOWN_CENTRE.mean * (length - 1),
            sigma=UNKNOWN_CENTRE.sigma * longer,
        )
        for length in size
    ]
    priors = (focal, focal, *centres)
    return tuple(
        replace(quantity, wide=prior) for quantity, prior in zip(PINHOLE, priors, strict=True)
    )


def _read_correlations(section: Section, count: int) -> tuple[tuple[float, ...], ...]:
    """Return `count` rows, of one number, of two and so on; () where the key is missing."""
    if "correlations" not in section.values:
        return ()
    matrix = section.values["correlations"]
    if not isinstance(matrix, list) or [
        isinstance(row, list) and len(row) for row in matrix
    ] != list(range(1, count + 1)):
        raise section.error(
            "correlations",
            matrix,
            f"{count} rows: of fy, cx, cy and each coefficient, with every number before it",
        )
    rows = tuple(
        tuple(
            section.number(f"correlations[{i}][{j}]", entry, CORRELATION).value
            for j, entry in enumerate(row)
        )
        for i, row in enumerate(matrix)
    )
    lower = np.eye(count + 1)
    lower[np.tril_indices(count + 1, -1)] = [value for row in rows for value in row]
    try:
        np.linalg.cholesky(lower)  # it reads only the part below the diagonal
    except np.linalg.LinAlgError:
        raise section.error(
            "correlations",
            matrix,
            "correlations that are possible together, a positive definite matrix",
        ) from None
    return rows
