"""The bare camera as a session describes it: its size, and its intrinsics if they are known."""

from dataclasses import dataclass

from calib.session.schema import Number, Quantity, Section

COEFFICIENTS = (0, 4, 5, 8, 12, 14)
"""How many distortion coefficients OpenCV's model may have."""

PINHOLE = (Quantity("fx", low=1, high=1e7), Quantity("fy", low=1, high=1e7), Quantity("cx"), Quantity("cy"))
COEFFICIENT = Quantity("distortion")


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """OpenCV's camera model, in px."""

    fx: Number
    fy: Number
    cx: Number
    cy: Number
    distortion: tuple[Number, ...] = ()
    """In OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y."""


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
    """How many distortion coefficients to fit. None: the fewest that held-out views ask for."""


def read_camera(section: Section) -> Camera:
    section.only(("model", "width", "height", "intrinsics", "lens_coefficients"))
    counts = f"one of the whole numbers {', '.join(map(str, COEFFICIENTS))}"
    return Camera(
        width=section.whole("width", 1, 100_000),
        height=section.whole("height", 1, 100_000),
        model=section.text("model", "the camera's name", default=""),
        intrinsics=_read_intrinsics(section) if "intrinsics" in section.values else None,
        lens_coefficients=section.choice("lens_coefficients", COEFFICIENTS, counts) if "lens_coefficients" in section.values else None,
    )


def camera_to_yaml(camera: Camera) -> dict[str, object]:
    """The mapping that `read_camera` reads as this camera."""
    written: dict[str, object] = {"width": camera.width, "height": camera.height}
    if camera.model:
        written["model"] = camera.model
    if camera.intrinsics:
        k = camera.intrinsics
        written["intrinsics"] = {q.key: q.to_yaml(n) for q, n in zip(PINHOLE, (k.fx, k.fy, k.cx, k.cy), strict=True)} | {
            "distortion": [COEFFICIENT.to_yaml(number) for number in k.distortion]
        }
    if camera.lens_coefficients is not None:
        written["lens_coefficients"] = camera.lens_coefficients
    return written


def _read_intrinsics(camera: Section) -> Intrinsics:
    section = camera.section("intrinsics", "{fx: 1279.2, fy: 1279.2, cx: 832.8, cy: 636.6, distortion: [0, 0, 0, 0, 0]}")
    section.only((*(quantity.key for quantity in PINHOLE), "distortion"))
    fx, fy, cx, cy = (section.read(quantity)[quantity.key] for quantity in PINHOLE)
    expected = f"a list of {', '.join(map(str, COEFFICIENTS))} numbers in OpenCV's order"
    written = section.values.get("distortion", [])
    if not isinstance(written, list) or len(written) not in COEFFICIENTS:
        raise section.wrong("distortion", written, expected)
    distortion = (section.number(f"distortion[{i}]", entry, COEFFICIENT) for i, entry in enumerate(written))
    return Intrinsics(fx, fy, cx, cy, tuple(distortion))
