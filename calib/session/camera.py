"""The bare camera as a session describes it: its size, and its intrinsics if they are known."""

from dataclasses import dataclass

import numpy as np

from calib.session.lens import AUTO, COEFFICIENTS, COUNTS, MODELS, NAMES, OPENCV, SPLINED
from calib.session.lens_spline import Spline, read_spline, spline_to_yaml
from calib.session.schema import Number, Quantity, Section
from calib.session.shutter import Shutter, read_shutter, shutter_to_yaml

MOST_PIXELS = 2**28
"""Of a picture: the largest sensors have as many, and its map takes 2.4 GB."""

PINHOLE = (
    Quantity("fx", low=1, high=1e7),
    Quantity("fy", low=1, high=1e7),
    Quantity("cx"),
    Quantity("cy"),
)
COEFFICIENT = Quantity("distortion")
CORRELATION = Quantity("correlations", low=-1, high=1)
LENSES = (AUTO, *MODELS)


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole with the lens of cv2 or, for wide ones, of cv2.fisheye, in px; the latter with a
    spline or without.
    """

    fx: Number
    fy: Number
    cx: Number
    cy: Number
    distortion: tuple[Number, ...] = ()
    """As many of the model's coefficients as it has, in the order of `calib.session.lens.NAMES`."""
    correlations: tuple[tuple[float, ...], ...] = ()
    """Of each number but the first, in the order of these fields, with every one before it.

    Empty: they are independent.
    """
    model: str = OPENCV
    """Of `calib.session.lens.MODELS`."""
    spline: Spline | None = None
    """Of a splined lens, which is a fisheye with this displacement before it."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of its coefficients."""
        return NAMES[self.model][: len(self.distortion)]

    @property
    def distorts(self) -> bool:
        """Whether a coefficient is there that is not zero for certain, or the lens is no pinhole
        without any.
        """
        return self.model != OPENCV or any(
            number.value or number.sigma for number in self.distortion
        )


@dataclass(frozen=True, slots=True)
class Camera:
    width: int
    """px"""
    height: int
    """px"""
    model: str = ""
    intrinsics: Intrinsics | None = None
    """None: to be found from pictures without the cover."""
    lens_coefficients: int | None = None
    """How many of OpenCV's distortion coefficients to fit.

    None: the fewest that held-out views ask for.
    """
    lens: str | None = None
    """The lens model to fit, of `calib.session.lens.MODELS`, or AUTO. None: it is not said."""
    shutter: Shutter | None = None
    """None: it is not known whether lines are read one after the other."""


def read_camera(section: Section) -> Camera:
    section.only(("model", "width", "height", "intrinsics", "lens", "lens_coefficients", "shutter"))
    counts = f"one of the whole numbers {', '.join(map(str, COEFFICIENTS))}"
    width, height = (section.whole(key, 1, 100_000) for key in ("width", "height"))
    intrinsics = (
        _read_intrinsics(section, (width, height)) if "intrinsics" in section.values else None
    )
    lens = (
        section.choice("lens", LENSES, f"one of {', '.join(LENSES)}")
        if "lens" in section.values
        else None
    )
    if lens not in (None, OPENCV, AUTO) and "lens_coefficients" in section.values:
        raise section.wrong(
            "lens_coefficients",
            section.values["lens_coefficients"],
            f"nothing: it is OpenCV's, and lens is {lens}",
        )
    if intrinsics and lens not in (None, AUTO, intrinsics.model):
        raise section.wrong(
            "lens", lens, f"{intrinsics.model}, the model of camera.intrinsics, or drop the key"
        )
    if width * height > MOST_PIXELS:
        raise section.wrong(
            "height",
            height,
            f"the pictures' own: {width}x{height} px are more than a sensor has, {MOST_PIXELS:,} at"
            " most",
        )
    return Camera(
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


def camera_to_yaml(camera: Camera) -> dict[str, object]:
    """The mapping that `read_camera` reads as this camera."""
    written: dict[str, object] = {"width": camera.width, "height": camera.height}
    if camera.model:
        written["model"] = camera.model
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
        written["intrinsics"] = intrinsics
    if camera.lens is not None:
        written["lens"] = camera.lens
    if camera.lens_coefficients is not None:
        written["lens_coefficients"] = camera.lens_coefficients
    if camera.shutter:
        written["shutter"] = shutter_to_yaml(camera.shutter)
    return written


def _read_intrinsics(camera: Section, size: tuple[int, int]) -> Intrinsics:
    section = camera.section(
        "intrinsics", "{fx: 1279.2, fy: 1279.2, cx: 832.8, cy: 636.6, distortion: [0, 0, 0, 0, 0]}"
    )
    section.only(
        (*(quantity.key for quantity in PINHOLE), "distortion", "correlations", "model", "spline")
    )
    model = (
        section.choice("model", MODELS, f"one of {', '.join(MODELS)}")
        if "model" in section.values
        else OPENCV
    )
    fx, fy, cx, cy = (section.read(quantity)[quantity.key] for quantity in PINHOLE)
    expected = (
        f"a list of {', '.join(map(str, COUNTS[model]))} numbers in"
        f" {'OpenCV' if model == OPENCV else 'cv2.fisheye'}'s order"
    )
    written = section.values.get("distortion", [])
    if not isinstance(written, list) or len(written) not in COUNTS[model]:
        raise section.wrong("distortion", written, expected)
    if model != SPLINED and "spline" in section.values:
        raise section.wrong(
            "spline", section.values["spline"], f"nothing: a lens of the model {model} has none"
        )
    spline = read_spline(section, size) if model == SPLINED else None
    distortion = tuple(
        section.number(f"distortion[{i}]", entry, COEFFICIENT) for i, entry in enumerate(written)
    )
    return Intrinsics(
        fx, fy, cx, cy, distortion, _read_correlations(section, 3 + len(written)), model, spline
    )


def _read_correlations(section: Section, count: int) -> tuple[tuple[float, ...], ...]:
    """`count` rows, of one number, of two and so on; none where the key is missing."""
    if "correlations" not in section.values:
        return ()
    written = section.values["correlations"]
    if not isinstance(written, list) or [
        isinstance(row, list) and len(row) for row in written
    ] != list(range(1, count + 1)):
        raise section.wrong(
            "correlations",
            written,
            f"{count} rows: of fy, cx, cy and each coefficient, with every number before it",
        )
    rows = tuple(
        tuple(
            section.number(f"correlations[{i}][{j}]", entry, CORRELATION).value
            for j, entry in enumerate(row)
        )
        for i, row in enumerate(written)
    )
    lower = np.eye(count + 1)
    lower[np.tril_indices(count + 1, -1)] = [value for row in rows for value in row]
    try:
        np.linalg.cholesky(lower)  # which reads what is below the diagonal
    except np.linalg.LinAlgError:
        raise section.wrong(
            "correlations",
            written,
            "numbers that all can be correlated by, a positive definite matrix",
        ) from None
    return rows
