"""The pinhole and its lens: pixels to rays, from one point of the axis or, where the entrance pupil moves, from several. The distortion
model is OpenCV's, with 0, 4, 5, 8, 12 or 14 coefficients.

Source: OpenCV's calib3d documentation, "Detailed Description", the equations for x'' and the tilted sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from calib.optics.lens import PINHOLE, entrance, normalised
from calib.optics.params import Param, Values
from calib.optics.rays import LENS, Rays
from calib.optics.vector import Vector
from calib.session.lens import NAMES, OPENCV

COEFFICIENTS = NAMES[OPENCV]

NEWTON_STEPS = 40
CONVERGED = 1e-6
"""Normalised image units: the length of the step after which one more, the differentiable one, leaves rounding alone."""
EXACT = 1e-9
"""The length that the last step may have, of a point that counts as found: a millionth of a pixel for any lens in use."""


@dataclass(frozen=True, slots=True)
class LensModel:
    """Launches a ray through the entrance pupil for each pixel. Reads camera.fx, .fy, .cx, .cy and the first `count` coefficients."""

    count: int
    pupil: tuple[Param, ...] = ()
    wide: ClassVar[bool] = False

    @property
    def params(self) -> tuple[Param, ...]:
        return (*PINHOLE, *(Param(f"camera.{name}", "", 1e-3) for name in COEFFICIENTS[: self.count]), *self.pupil)

    def with_pupil(self, pupil: tuple[Param, ...]) -> "LensModel":
        return replace(self, pupil=pupil)

    def __call__(self, pixels: Tensor, values: Values) -> Rays:
        """(..., 2) px to rays that start at the entrance pupil."""
        x, y = normalised(pixels, values)
        failed = torch.zeros_like(x, dtype=torch.bool)
        if self.count:
            x, y, failed = undistort(x, y, self._coefficients(values))
        start = entrance((x * x + y * y).clamp_min(1e-24).sqrt().atan(), values, self.pupil)
        return Rays(start, Vector(x, y, torch.ones_like(x)).unit(), failed.to(torch.uint8) * LENS)

    def project(self, points: Tensor, values: Values) -> Tensor:
        """(..., 3) m in front of the pinhole to (..., 2) px, as if there were no cover and the pupil kept still."""
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        if self.count:
            coefficients = self._coefficients(values)
            x, y = tilt(*distort(x, y, coefficients), coefficients)
        return torch.stack([values["camera.fx"] * x + values["camera.cx"], values["camera.fy"] * y + values["camera.cy"]], -1)

    def _coefficients(self, values: Values) -> list[Tensor]:
        return [values[f"camera.{name}"] for name in COEFFICIENTS[: self.count]]


def distort(x: Tensor, y: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Normalised (...) image coordinates, moved by the lens. The tilted sensor is `tilt`'s."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = _padded(x, coefficients)
    r2 = x * x + y * y
    gain = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return (
        x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2),
        y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4),
    )


def tilt(x: Tensor, y: Tensor, coefficients: Sequence[Tensor], *, undo: bool = False) -> tuple[Tensor, Tensor]:
    """Normalised (...) coordinates on the tilted sensor (Scheimpflug), or back from it."""
    if len(coefficients) < 14:
        return x, y
    homography = _tilt_matrix(coefficients[12], coefficients[13])
    if undo:
        homography = torch.linalg.inv(homography)
    u, v, w = (homography @ torch.stack([x, y, torch.ones_like(x)], -1).unsqueeze(-1)).squeeze(-1).unbind(-1)
    return u / w, v / w


def undistort(x: Tensor, y: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """The inverse of distort and tilt by Newton's method, with exact first derivatives.

    Args:
        x, y: (...) distorted normalised image coordinates.
        coefficients: () each, OpenCV's order.

    Returns:
        (...) x and y without distortion, and (...) bool, true where no inverse was found (beyond the fold of a polynomial).
        Those rows keep a finite value.
    """
    goal_x, goal_y = tilt(x, y, coefficients, undo=True)
    still_x, still_y = goal_x.detach(), goal_y.detach()
    fixed = [c.detach() for c in coefficients]
    u, v = still_x, still_y
    for _ in range(NEWTON_STEPS):
        step_u, step_v, _ = _newton_step(u, v, still_x, still_y, fixed)
        # A far start can throw Newton beyond the fold: no step is longer than half of what the point itself measures.
        length = (step_u**2 + step_v**2).sqrt()
        damped = (0.5 * (0.1 + (u * u + v * v).sqrt()) / length.clamp_min(1e-300)).clamp_max(1.0)
        u, v = u - damped * step_u, v - damped * step_v
        if bool((length <= CONVERGED).all()):
            break
    step_u, step_v, folded = _newton_step(u, v, goal_x, goal_y, coefficients)  # differentiable: Newton's last step is exact
    unsolved = ~((step_u.detach() ** 2 + step_v.detach() ** 2) < EXACT**2) | folded
    u = torch.where(unsolved, torch.zeros_like(u), u)
    v = torch.where(unsolved, torch.zeros_like(v), v)
    zero = torch.zeros_like(step_u)
    return u - torch.where(unsolved, zero, step_u), v - torch.where(unsolved, zero, step_v), unsolved


def _newton_step(u: Tensor, v: Tensor, goal_x: Tensor, goal_y: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """The (...) step in u and v, and (...) bool, true where the lens folds the image over."""
    x, y = distort(u, v, coefficients)
    a, b, c, d = (entry.detach() for entry in _jacobian(u, v, coefficients))
    det = a * d - b * c
    folded = det <= 0
    safe = torch.where(det.abs() < 1e-9, torch.full_like(det, 1e-9), det)
    error_x, error_y = x - goal_x, y - goal_y
    return (d * error_x - b * error_y) / safe, (a * error_y - c * error_x) / safe, folded


def _jacobian(x: Tensor, y: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """dx'/dx, dx'/dy, dy'/dx, dy'/dy of `distort`, (...) each."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = _padded(x, coefficients)
    r2 = x * x + y * y
    top, bottom = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    gain = top / bottom
    rise = (k1 + r2 * (2 * k2 + r2 * 3 * k3) - gain * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / bottom  # d gain / d r2
    prism_x, prism_y = s1 + 2 * r2 * s2, s3 + 2 * r2 * s4
    return (
        gain + 2 * x * x * rise + 2 * p1 * y + 6 * p2 * x + 2 * x * prism_x,
        2 * x * y * rise + 2 * p1 * x + 2 * p2 * y + 2 * y * prism_x,
        2 * x * y * rise + 2 * p1 * x + 2 * p2 * y + 2 * x * prism_y,
        gain + 2 * y * y * rise + 6 * p1 * y + 2 * p2 * x + 2 * y * prism_y,
    )


def _padded(like: Tensor, coefficients: Sequence[Tensor]) -> list[Tensor]:
    head = list(coefficients[:12])
    return head + [torch.zeros((), dtype=like.dtype, device=like.device)] * (12 - len(head))


def _tilt_matrix(tau_x: Tensor, tau_y: Tensor) -> Tensor:
    """(..., 3, 3) OpenCV's homography of a sensor tilted by tau_x about x and tau_y about y, (...) rad."""
    sx, cx, sy, cy = tau_x.sin(), tau_x.cos(), tau_y.sin(), tau_y.cos()
    zero, one = torch.zeros_like(sx), torch.ones_like(sx)
    turned = _matrix(cy, sy * sx, -sy * cx, zero, cx, sx, sy, -cy * sx, cy * cx)
    onto = _matrix(cy * cx, zero, sy * cx, zero, cy * cx, -sx, zero, zero, one)
    return torch.matmul(onto, turned)


def _matrix(*entries: Tensor) -> Tensor:
    """(..., 3, 3) of (...) entries, row after row."""
    return torch.stack(entries, -1).reshape(*entries[0].shape, 3, 3)
