"""A wide lens: the distance from the principal point is an odd polynomial of the angle from the
axis, which may exceed 90 degrees.

Source: J. Kannala, S. S. Brandt, A generic camera model and calibration method for conventional,
wide-angle, and fish-eye lenses (2006), equation 6. The focal lengths contain its first factor, as
in cv2.fisheye: theta_d = theta (1 + kb1 theta^2 + ... + kb4 theta^8).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

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
from calib.session.lens import FISHEYE, NAMES
from calib.session.parameter_names import CAMERA

NEWTON_STEPS = 40
CONVERGED = 1e-13
"""rad"""
MIN_DISTANCE = 1e-12
"""The smallest distance from the axis that is used as a divisor."""
PROBES = 16
"""The number of angles between the axis and a ray at which the polynomial must rise. Beyond a
maximum of the polynomial, two angles would share a pixel.
"""

COEFFICIENTS = tuple(Param(CAMERA.of(name), "", 1e-3) for name in NAMES[FISHEYE])


@dataclass(frozen=True, slots=True)
class Fisheye:
    """A lens that reads camera.fx, .fy, .cx, .cy and the four coefficients."""

    pupil: tuple[Param, ...] = ()
    wide: ClassVar[bool] = True

    @property
    def params(self) -> tuple[Param, ...]:
        return (*PINHOLE, *COEFFICIENTS, *self.pupil)

    def with_pupil(self, pupil: tuple[Param, ...]) -> Fisheye:
        return replace(self, pupil=pupil)

    def __call__(self, pixels: Tensor, values: Values, _near: Tensor | None = None, /) -> Rays:
        x, y = normalise_pixels(pixels, values)
        distance = (x * x + y * y).clamp_min(MIN_DISTANCE**2).sqrt()
        angle, failed = incidence_angle(distance, _coefficients(values))
        outward = angle.sin() / distance
        return Rays(
            entrance_point(angle, values, self.pupil),
            Vector(x * outward, y * outward, angle.cos()),
            failed.to(torch.uint8) * LENS,
        )

    def launch(
        self, pixels: Tensor, values: Values, names: frozenset[str], near: Tensor | None = None, /
    ) -> tuple[Rays, Pull]:
        return launch_by_autograd(self, pixels, values, names, near)

    def project(self, points: Tensor, values: Values) -> Tensor:
        """Return the (..., 2) px of (..., 3) m points, which may be beside and behind the pinhole.
        A point that the lens does not see gets the pixel that the polynomial gives for its angle.
        """
        x, y, z = points.unbind(-1)
        outward = (x * x + y * y).clamp_min(MIN_DISTANCE**2).sqrt()
        gain = _distance(torch.atan2(outward, z), _coefficients(values))[0] / outward
        return torch.stack(
            [
                values[CAMERA.fx] * x * gain + values[CAMERA.cx],
                values[CAMERA.fy] * y * gain + values[CAMERA.cy],
            ],
            -1,
        )


def incidence_angle(distance: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Return the angle from the axis whose ray is imaged at a distance from the principal point, by
    Newton's method, with exact first derivatives.

    Args:
        distance: (...) over the focal length.
        coefficients: () or (...) each.

    Returns:
        (...) rad, and (...) bool, true where no angle up to 180 degrees is imaged. Those rows keep
        a finite value.
    """
    goal = distance.detach()
    fixed = [c.detach() for c in coefficients]
    angle = goal.clamp_max(math.pi / 2)
    for _ in range(NEWTON_STEPS):
        reached, rise = _distance(angle, fixed)
        step = (reached - goal) / torch.where(rise.abs() < 1e-9, torch.full_like(rise, 1e-9), rise)
        longest = 0.5 * (0.1 + angle.abs())
        angle = angle - step.clamp(-longest, longest)
        if bool((step.abs() <= CONVERGED).all()):
            break
    reached, _ = _distance(angle, coefficients)  # differentiable: Newton's last step is exact
    _, rise = _distance(angle, fixed)
    between = angle.unsqueeze(-1) * torch.linspace(
        1 / PROBES, 1, PROBES, dtype=angle.dtype, device=angle.device
    )
    rises = (_distance(between, [c.unsqueeze(-1) for c in fixed])[1] > 0).all(-1)
    failed = ~((reached.detach() - goal).abs() < 1e3 * CONVERGED) | ~rises | (angle > math.pi)
    zero = torch.zeros_like(angle)
    step = torch.where(
        failed, zero, (reached - distance) / torch.where(failed, torch.ones_like(rise), rise)
    )
    return torch.where(failed, zero, angle) - step, failed


def _distance(angle: Tensor, coefficients: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Return the distance from the principal point, over the focal length, at (...) rad from the
    axis, and its derivative by the angle.
    """
    first, second, third, fourth = coefficients
    square = angle * angle
    gain = 1 + square * (first + square * (second + square * (third + square * fourth)))
    rise = 1 + square * (
        3 * first + square * (5 * second + square * (7 * third + square * 9 * fourth))
    )
    return angle * gain, rise


def _coefficients(values: Values) -> list[Tensor]:
    return [values[param.name] for param in COEFFICIENTS]
