"""The pinhole and its lens: pixels to rays, from one point of the axis or, where the entrance pupil
moves, from several. The distortion model is OpenCV's, with 0, 4, 5, 8, 12 or 14 coefficients.

Source: OpenCV's calib3d documentation, "Detailed Description", the equations for x'' and the tilted
    sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from calib.optics.lens import PINHOLE, entrance, normalised
from calib.optics.params import NEAR, Param, Values
from calib.optics.rays import LENS, Rays
from calib.optics.vector import Vector
from calib.session.lens import NAMES, OPENCV

COEFFICIENTS = NAMES[OPENCV]

FEWEST = 4
"""Coefficients that a distorted point is computed from: k1, k2, p1, p2."""
PRISM = 12
"""Coefficients of a lens with a thin prism."""
NEWTON_STEPS = 40
CONVERGED = 1e-6
"""Normalised image units: the length of the step after which one more, the differentiable one,
leaves rounding alone.
"""
EXACT = 1e-9
"""The length that the last step may have, of a point that counts as found: a millionth of a pixel
for any lens in use.
"""


@dataclass(frozen=True, slots=True)
class LensModel:
    """Launches a ray through the entrance pupil for each pixel.

    Reads camera.fx, .fy, .cx, .cy and the first `count` coefficients.
    """

    count: int
    pupil: tuple[Param, ...] = ()
    wide: ClassVar[bool] = False

    @property
    def params(self) -> tuple[Param, ...]:
        return (
            *PINHOLE,
            *(Param(f"camera.{name}", "", 1e-3) for name in COEFFICIENTS[: self.count]),
            *self.pupil,
        )

    def with_pupil(self, pupil: tuple[Param, ...]) -> "LensModel":
        return replace(self, pupil=pupil)

    def __call__(self, pixels: Tensor, values: Values) -> Rays:
        """(..., 2) px to rays that start at the entrance pupil."""
        x, y = normalised(pixels, values)
        failed = torch.zeros_like(x, dtype=torch.bool)
        if self.count:
            x, y, failed = undistort(x, y, self._coefficients(values), values.get(NEAR))
        start = entrance((x * x + y * y).clamp_min(1e-24).sqrt().atan(), values, self.pupil)
        return Rays(start, Vector(x, y, torch.ones_like(x)).unit(), failed.to(torch.uint8) * LENS)

    def project(self, points: Tensor, values: Values) -> Tensor:
        """(..., 3) m in front of the pinhole to (..., 2) px, as if there were no cover and the
        pupil kept still.
        """
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        if self.count:
            coefficients = self._coefficients(values)
            x, y = tilt(*distort(x, y, coefficients), coefficients)
        return torch.stack(
            [
                values["camera.fx"] * x + values["camera.cx"],
                values["camera.fy"] * y + values["camera.cy"],
            ],
            -1,
        )

    def _coefficients(self, values: Values) -> list[Tensor]:
        found = [values[f"camera.{name}"] for name in COEFFICIENTS[: self.count]]
        return found + [torch.zeros_like(found[0])] * (FEWEST - self.count)


def distort(x: Tensor, y: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Normalised (...) image coordinates, moved by the lens. The tilted sensor is `tilt`'s."""
    r2 = x * x + y * y
    return _moved(x, y, r2, _radial(r2, coefficients)[0], coefficients)


def _moved(
    x: Tensor, y: Tensor, r2: Tensor, gain: Tensor, coefficients: Sequence[Tensor]
) -> tuple[Tensor, Tensor]:
    """`distort`, from the squared radius and the radial factor."""
    p1, p2 = coefficients[2:FEWEST]
    moved_x, moved_y = (
        x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )
    if len(coefficients) < PRISM:
        return moved_x, moved_y
    s1, s2, s3, s4 = coefficients[8:PRISM]
    return moved_x + r2 * (s1 + r2 * s2), moved_y + r2 * (s3 + r2 * s4)


def _radial(r2: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor | None]:
    """(...) the factor on a point at the squared radius, and what it is divided by, where there is
    that.
    """
    k1, k2, _, _, *more = coefficients
    inner = k2 + r2 * more[0] if more else k2
    top = 1 + r2 * (k1 + r2 * inner)
    if len(more) < 4:
        return top, None
    k4, k5, k6 = more[1:4]
    bottom = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    return top / bottom, bottom


def tilt(
    x: Tensor, y: Tensor, coefficients: Sequence[Tensor], *, undo: bool = False
) -> tuple[Tensor, Tensor]:
    """Normalised (...) coordinates on the tilted sensor (Scheimpflug), or back from it."""
    if len(coefficients) < 14:
        return x, y
    homography = _tilt_matrix(coefficients[12], coefficients[13])
    if undo:
        homography = torch.linalg.inv(homography)
    u, v, w = (
        (homography @ torch.stack([x, y, torch.ones_like(x)], -1).unsqueeze(-1))
        .squeeze(-1)
        .unbind(-1)
    )
    return u / w, v / w


def undistort(
    x: Tensor, y: Tensor, coefficients: Sequence[Tensor], near: Tensor | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """The inverse of distort and tilt by Newton's method, with exact first derivatives.

    Args:
        x, y: (...) distorted normalised image coordinates.
        coefficients: () each, OpenCV's order.
        near: (..., 2) where to begin, NaN where that is not known.

    Returns:
        (...) x and y without distortion, and (...) bool, true where no inverse was found (beyond
        the fold of a polynomial). Those rows keep a finite value.
    """
    goal_x, goal_y = tilt(x, y, coefficients, undo=True)
    still_x, still_y = goal_x.detach(), goal_y.detach()
    fixed = [c.detach() for c in coefficients]
    u, v = still_x, still_y
    if near is not None:
        known = near.isfinite().all(-1)
        u, v = (
            torch.where(known, begin, still)
            for begin, still in zip(near.unbind(-1), (u, v), strict=True)
        )
    for _ in range(NEWTON_STEPS):
        step_u, step_v, _ = _newton_step(u, v, still_x, still_y, fixed)
        # A far start can throw Newton beyond the fold: no step is longer than half of what the
        # point itself measures.
        length = (step_u**2 + step_v**2).sqrt()
        damped = (0.5 * (0.1 + (u * u + v * v).sqrt()) / length.clamp_min(1e-300)).clamp_max(1.0)
        u, v = u - damped * step_u, v - damped * step_v
        if bool((length <= CONVERGED).all()):
            break
    step_u, step_v, folded = _newton_step(
        u, v, goal_x, goal_y, coefficients
    )  # differentiable: Newton's last step is exact
    unsolved = ~((step_u.detach() ** 2 + step_v.detach() ** 2) < EXACT**2) | folded
    u = torch.where(unsolved, torch.zeros_like(u), u)
    v = torch.where(unsolved, torch.zeros_like(v), v)
    zero = torch.zeros_like(step_u)
    return (
        u - torch.where(unsolved, zero, step_u),
        v - torch.where(unsolved, zero, step_v),
        unsolved,
    )


def _newton_step(
    u: Tensor, v: Tensor, goal_x: Tensor, goal_y: Tensor, coefficients: Sequence[Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """The (...) step in u and v, and (...) bool, true where the lens folds the image over."""
    r2 = u * u + v * v
    gain, bottom = _radial(r2, coefficients)
    x, y = _moved(u, v, r2, gain, coefficients)
    with torch.no_grad():
        a, b, c, d = _jacobian(u, v, r2, gain, bottom, coefficients)
        det = a * d - b * c
        folded = det <= 0
        safe = torch.where(det.abs() < 1e-9, torch.full_like(det, 1e-9), det)
    error_x, error_y = x - goal_x, y - goal_y
    return (d * error_x - b * error_y) / safe, (a * error_y - c * error_x) / safe, folded


def _jacobian(
    x: Tensor,
    y: Tensor,
    r2: Tensor,
    gain: Tensor,
    bottom: Tensor | None,
    coefficients: Sequence[Tensor],
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """dx'/dx, dx'/dy, dy'/dx, dy'/dy of `distort`, (...) each, from the squared radius and what
    `_radial` makes of it.
    """
    k1, k2, p1, p2, *more = coefficients
    rise = k1 + r2 * (2 * k2 + r2 * (3 * more[0])) if more else k1 + r2 * (2 * k2)  # d gain / d r2
    if bottom is not None:
        k4, k5, k6 = more[1:4]
        rise = (rise - gain * (k4 + r2 * (2 * k5 + r2 * (3 * k6)))) / bottom
    px, py = p1 * x, p2 * y
    mixed = 2 * (x * y * rise + px + py)
    along_x, along_y = (
        gain + 2 * (x * x * rise + p1 * y + 3 * (p2 * x)),
        gain + 2 * (y * y * rise + 3 * (p1 * y) + p2 * x),
    )
    if len(coefficients) < PRISM:
        return along_x, mixed, mixed, along_y
    s1, s2, s3, s4 = coefficients[8:PRISM]
    prism_x, prism_y = 2 * (s1 + 2 * r2 * s2), 2 * (s3 + 2 * r2 * s4)
    return along_x + x * prism_x, mixed + y * prism_x, mixed + x * prism_y, along_y + y * prism_y


def _tilt_matrix(tau_x: Tensor, tau_y: Tensor) -> Tensor:
    """(..., 3, 3) OpenCV's homography of a sensor tilted by tau_x about x and tau_y about y, (...)
    rad.
    """
    sx, cx, sy, cy = tau_x.sin(), tau_x.cos(), tau_y.sin(), tau_y.cos()
    zero, one = torch.zeros_like(sx), torch.ones_like(sx)
    turned = _matrix(cy, sy * sx, -sy * cx, zero, cx, sx, sy, -cy * sx, cy * cx)
    onto = _matrix(cy * cx, zero, sy * cx, zero, cy * cx, -sx, zero, zero, one)
    return torch.matmul(onto, turned)


def _matrix(*entries: Tensor) -> Tensor:
    """(..., 3, 3) of (...) entries, row after row."""
    return torch.stack(entries, -1).reshape(*entries[0].shape, 3, 3)
