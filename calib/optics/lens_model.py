"""The pinhole with lens distortion: pixels to rays, from one point of the axis or, if the entrance
pupil moves, from several. The distortion model is OpenCV's, with 0, 4, 5, 8, 12 or 14 coefficients.

Source: OpenCV's calib3d documentation, "Detailed Description", the equations for x'' and the tilted
    sensor.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from calib.optics.derivatives import ByName, ByRay
from calib.optics.lens import (
    PINHOLE,
    Pull,
    entrance_point,
    launch_by_autograd,
    normalise_pixels,
)
from calib.optics.params import Param, Values
from calib.optics.rays import LENS, Rays
from calib.optics.vector import Vector
from calib.session.lens import NAMES, OPENCV
from calib.session.parameter_names import CAMERA

COEFFICIENTS = NAMES[OPENCV]

MIN_COEFFICIENTS = 4
"""The smallest number of coefficients that the equations take: k1, k2, p1, p2."""
PRISM_COEFFICIENTS = 12
"""The number of coefficients of a lens with a thin prism."""
NEWTON_STEPS = 40
CONVERGED = 1e-6
"""Normalised image units. After a step this short, the differentiable last step leaves an error of
rounding size.
"""
MAX_FINAL_STEP = 1e-9
"""Normalised image units: a longer last step means that there is no inverse. It is a millionth of a
pixel for any lens in use.
"""


@dataclass(frozen=True, slots=True)
class LensModel:
    """OpenCV's lens: it launches a ray through the entrance pupil for each pixel.

    It reads camera.fx, .fy, .cx, .cy and the first `count` coefficients.
    """

    count: int
    pupil: tuple[Param, ...] = ()
    wide: ClassVar[bool] = False

    @property
    def params(self) -> tuple[Param, ...]:
        return (
            *PINHOLE,
            *(Param(CAMERA.of(name), "", 1e-3) for name in COEFFICIENTS[: self.count]),
            *self.pupil,
        )

    def with_pupil(self, pupil: tuple[Param, ...]) -> "LensModel":
        return replace(self, pupil=pupil)

    def __call__(self, pixels: Tensor, values: Values, near: Tensor | None = None, /) -> Rays:
        """Return the rays of (..., 2) px, starting at the entrance pupil."""
        x, y = normalise_pixels(pixels, values)
        failed = torch.zeros_like(x, dtype=torch.bool)
        if self.count:
            x, y, failed = undistort(x, y, self._coefficients(values), near)
        start = entrance_point((x * x + y * y).clamp_min(1e-24).sqrt().atan(), values, self.pupil)
        return Rays(start, Vector(x, y, torch.ones_like(x)).unit(), failed.to(torch.uint8) * LENS)

    def launch(
        self, pixels: Tensor, values: Values, names: frozenset[str], near: Tensor | None = None, /
    ) -> tuple[Rays, Pull]:
        if self.pupil or self.count > PRISM_COEFFICIENTS:
            return launch_by_autograd(self, pixels, values, names, near)
        distorted = normalise_pixels(pixels, values)
        coefficients = self._coefficients(values) if self.count else []
        x, y = distorted
        failed = torch.zeros_like(x, dtype=torch.bool)
        if self.count:
            x, y, failed = undistort(x, y, coefficients, near)
        direction = Vector(x, y, torch.ones_like(x)).unit()
        zero = torch.zeros_like(x)
        rays = Rays(Vector(zero, zero, zero), direction, failed.to(torch.uint8) * LENS)

        def pull(by_rays: ByRay) -> tuple[Tensor, ByName]:
            by_direction = by_rays.direction
            change = direction.dot(by_direction)
            by_x = (by_direction.x - direction.x * change) * direction.z
            by_y = (by_direction.y - direction.y * change) * direction.z
            by: ByName = {}
            if self.count:
                by_x, by_y = _pull_distortion(x, y, by_x, by_y, coefficients)
                for name, (x_by, y_by) in zip(
                    COEFFICIENTS[: self.count],
                    _by_coefficients(x, y, coefficients),
                    strict=False,
                ):
                    if CAMERA.of(name) in names:
                        by[CAMERA.of(name)] = -by_x * x_by - by_y * y_by
            by_pixel_x, by_pixel_y = by_x / values[CAMERA.fx], by_y / values[CAMERA.fy]
            pinhole = {
                CAMERA.fx: -by_pixel_x * distorted[0],
                CAMERA.fy: -by_pixel_y * distorted[1],
                CAMERA.cx: -by_pixel_x,
                CAMERA.cy: -by_pixel_y,
            }
            by |= {name: value for name, value in pinhole.items() if name in names}
            return torch.stack([by_pixel_x, by_pixel_y], -1), by

        return rays, pull

    def project(self, points: Tensor, values: Values) -> Tensor:
        """Return the (..., 2) px of (..., 3) m points in front of the pinhole, as if there were no
        cover and the pupil did not move.
        """
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        if self.count:
            coefficients = self._coefficients(values) if self.count else []
            x, y = tilt(*distort(x, y, coefficients), coefficients)
        return torch.stack(
            [
                values[CAMERA.fx] * x + values[CAMERA.cx],
                values[CAMERA.fy] * y + values[CAMERA.cy],
            ],
            -1,
        )

    def _coefficients(self, values: Values) -> list[Tensor]:
        coefficients = [values[CAMERA.of(name)] for name in COEFFICIENTS[: self.count]]
        zero = torch.zeros_like(coefficients[0])
        return coefficients + [zero] * (MIN_COEFFICIENTS - self.count)


def distort(x: Tensor, y: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Return normalised (...) image coordinates with lens distortion. `tilt` adds the tilted
    sensor.
    """
    r2 = x * x + y * y
    return _displace(x, y, r2, _radial(r2, coefficients)[0], coefficients)


def _displace(
    x: Tensor, y: Tensor, r2: Tensor, gain: Tensor, coefficients: Sequence[Tensor]
) -> tuple[Tensor, Tensor]:
    """Return what `distort` does, from the squared radius and the radial factor."""
    p1, p2 = coefficients[2:MIN_COEFFICIENTS]
    distorted_x = x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    distorted_y = y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    if len(coefficients) < PRISM_COEFFICIENTS:
        return distorted_x, distorted_y
    s1, s2, s3, s4 = coefficients[8:PRISM_COEFFICIENTS]
    return distorted_x + r2 * (s1 + r2 * s2), distorted_y + r2 * (s3 + r2 * s4)


def _radial(r2: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor | None]:
    """Return the (...) radial factor at the squared radius, and its denominator; None for a model
    without one.
    """
    k1, k2, _, _, *higher = coefficients
    inner = k2 + r2 * higher[0] if higher else k2
    top = 1 + r2 * (k1 + r2 * inner)
    if len(higher) < 4:
        return top, None
    k4, k5, k6 = higher[1:4]
    bottom = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    return top / bottom, bottom


def tilt(
    x: Tensor, y: Tensor, coefficients: Sequence[Tensor], *, undo: bool = False
) -> tuple[Tensor, Tensor]:
    """Return normalised (...) coordinates on the tilted sensor (Scheimpflug); with `undo`, the
    inverse.
    """
    if len(coefficients) < 14:
        return x, y
    homography = _tilt_matrix(coefficients[12], coefficients[13])
    if undo:
        homography = torch.linalg.inv(homography)
    points = torch.stack([x, y, torch.ones_like(x)], -1).unsqueeze(-1)
    u, v, w = (homography @ points).squeeze(-1).unbind(-1)
    return u / w, v / w


def undistort(
    x: Tensor, y: Tensor, coefficients: Sequence[Tensor], start: Tensor | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Invert `distort` and `tilt` by Newton's method, with exact first derivatives.

    Args:
        x, y: (...) distorted normalised image coordinates.
        coefficients: () each, OpenCV's order.
        start: (..., 2) undistorted coordinates to start from, NaN where there are none.

    Returns:
        (...) x and y without distortion, and (...) bool, true where there is no inverse (beyond the
        fold of a polynomial). Those rows keep a finite value.
    """
    goal_x, goal_y = tilt(x, y, coefficients, undo=True)
    fixed_x, fixed_y = goal_x.detach(), goal_y.detach()
    fixed = [c.detach() for c in coefficients]
    u, v = fixed_x, fixed_y
    if start is not None:
        valid = start.isfinite().all(-1)
        u = torch.where(valid, start[..., 0], u)
        v = torch.where(valid, start[..., 1], v)
    u, v = _solve(u, v, fixed_x, fixed_y, fixed)
    step_u, step_v, folded = _newton_step(
        u, v, goal_x, goal_y, coefficients
    )  # differentiable: Newton's last step is exact
    unsolved = ~((step_u.detach() ** 2 + step_v.detach() ** 2) < MAX_FINAL_STEP**2) | folded
    u = torch.where(unsolved, torch.zeros_like(u), u)
    v = torch.where(unsolved, torch.zeros_like(v), v)
    zero = torch.zeros_like(step_u)
    return (
        u - torch.where(unsolved, zero, step_u),
        v - torch.where(unsolved, zero, step_v),
        unsolved,
    )


def _solve(
    u: Tensor, v: Tensor, goal_x: Tensor, goal_y: Tensor, coefficients: Sequence[Tensor]
) -> tuple[Tensor, Tensor]:
    """Return (...) undistorted coordinates after Newton's steps from a start. Points that have
    converged rest once they are half of all.
    """
    shape = sum(coefficients, start=u).shape  # a coefficient may differ from point to point
    goal = torch.stack([goal_x.expand(shape), goal_y.expand(shape)]).flatten(1)
    coefficients = [c.expand(shape).flatten() if c.ndim else c for c in coefficients]
    solved = torch.stack([u.expand(shape), v.expand(shape)]).flatten(1)
    point, rows = solved, torch.arange(solved.shape[1])
    for _ in range(NEWTON_STEPS):
        step = torch.stack(_newton_step(point[0], point[1], goal[0], goal[1], coefficients)[:2])
        # A step from a poor start can end beyond the fold: no step is longer than half of
        # 0.1 plus the point's radius.
        length, radius = (step * step).sum(0).sqrt(), (point * point).sum(0).sqrt()
        damped = (0.5 * (0.1 + radius) / length.clamp_min(1e-300)).clamp_max(1.0)
        point = point - damped * step
        moving = (~(length <= CONVERGED)).nonzero()[:, 0]
        if 2 * len(moving) > len(rows):
            continue
        solved = solved.index_copy(1, rows, point)
        if not len(moving):
            break
        rows, point, goal = rows[moving], point[:, moving], goal[:, moving]
        coefficients = [c[moving] if c.ndim else c for c in coefficients]
    else:
        solved = solved.index_copy(1, rows, point)
    return solved[0].reshape(shape), solved[1].reshape(shape)


def _newton_step(
    u: Tensor, v: Tensor, goal_x: Tensor, goal_y: Tensor, coefficients: Sequence[Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the (...) Newton step in u and v, and (...) bool, true where the lens folds the image
    over.
    """
    r2 = u * u + v * v
    gain, bottom = _radial(r2, coefficients)
    x, y = _displace(u, v, r2, gain, coefficients)
    with torch.no_grad():
        a, b, c, d = _jacobian(u, v, r2, gain, bottom, coefficients)
        det = a * d - b * c
        folded = det <= 0
        safe = torch.where(det.abs() < 1e-9, torch.full_like(det, 1e-9), det)
    error_x, error_y = x - goal_x, y - goal_y
    return (d * error_x - b * error_y) / safe, (a * error_y - c * error_x) / safe, folded


def _pull_distortion(
    x: Tensor, y: Tensor, by_x: Tensor, by_y: Tensor, coefficients: Sequence[Tensor]
) -> tuple[Tensor, Tensor]:
    """Return the derivatives by the distorted coordinates, from those by the (M,) undistorted ones
    x and y.
    """
    r2 = x * x + y * y
    gain, bottom = _radial(r2, coefficients)
    a, b, c, d = _jacobian(x, y, r2, gain, bottom, coefficients)
    det = a * d - b * c
    safe = torch.where(det.abs() < 1e-9, torch.full_like(det, 1e-9), det)
    return (d * by_x - c * by_y) / safe, (a * by_y - b * by_x) / safe


def _by_coefficients(
    x: Tensor, y: Tensor, coefficients: Sequence[Tensor]
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield the derivatives of `distort`, x and y, by each coefficient in OpenCV's order."""
    r2 = x * x + y * y
    gain, bottom = _radial(r2, coefficients)
    rise = r2 if bottom is None else r2 / bottom
    zero = torch.zeros_like(r2)
    yield x * rise, y * rise
    yield x * rise * r2, y * rise * r2
    yield 2 * x * y, r2 + 2 * y * y
    yield r2 + 2 * x * x, 2 * x * y
    yield x * rise * r2 * r2, y * rise * r2 * r2
    for power in (zero + 1, r2, r2 * r2):
        yield -x * gain * rise * power, -y * gain * rise * power
    for power in (r2, r2 * r2):
        yield power, zero
    for power in (r2, r2 * r2):
        yield zero, power


def _jacobian(
    x: Tensor,
    y: Tensor,
    r2: Tensor,
    gain: Tensor,
    bottom: Tensor | None,
    coefficients: Sequence[Tensor],
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the (...) derivatives dx'/dx, dx'/dy, dy'/dx, dy'/dy of `distort`, from the squared
    radius and the results of `_radial`.
    """
    k1, k2, p1, p2, *higher = coefficients
    # d gain / d r2
    rise = k1 + r2 * (2 * k2 + r2 * (3 * higher[0])) if higher else k1 + r2 * (2 * k2)
    if bottom is not None:
        k4, k5, k6 = higher[1:4]
        rise = (rise - gain * (k4 + r2 * (2 * k5 + r2 * (3 * k6)))) / bottom
    px, py = p1 * x, p2 * y
    mixed = 2 * (x * y * rise + px + py)
    x_by_x = gain + 2 * (x * x * rise + p1 * y + 3 * (p2 * x))
    y_by_y = gain + 2 * (y * y * rise + 3 * (p1 * y) + p2 * x)
    if len(coefficients) < PRISM_COEFFICIENTS:
        return x_by_x, mixed, mixed, y_by_y
    s1, s2, s3, s4 = coefficients[8:PRISM_COEFFICIENTS]
    prism_x, prism_y = 2 * (s1 + 2 * r2 * s2), 2 * (s3 + 2 * r2 * s4)
    return x_by_x + x * prism_x, mixed + y * prism_x, mixed + x * prism_y, y_by_y + y * prism_y


def _tilt_matrix(tau_x: Tensor, tau_y: Tensor) -> Tensor:
    """Return OpenCV's (..., 3, 3) homography of a sensor tilted by tau_x about x and tau_y about y,
    (...) rad.
    """
    sx, cx, sy, cy = tau_x.sin(), tau_x.cos(), tau_y.sin(), tau_y.cos()
    zero, unit = torch.zeros_like(sx), torch.ones_like(sx)
    rotation = _matrix(cy, sy * sx, -sy * cx, zero, cx, sx, sy, -cy * sx, cy * cx)
    projection = _matrix(cy * cx, zero, sy * cx, zero, cy * cx, -sx, zero, zero, unit)
    return torch.matmul(projection, rotation)


def _matrix(*entries: Tensor) -> Tensor:
    """Return the (..., 3, 3) matrices of nine (...) entries, row by row."""
    return torch.stack(entries, -1).reshape(*entries[0].shape, 3, 3)
