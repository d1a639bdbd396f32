"""A cone around the y axis of the cover's frame; with no slope, a cylinder (the paper's section 2, Fig. 1b)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.params import Param, Values


@dataclass(frozen=True, slots=True)
class Cone:
    """Surfaces rho = inner_radius + radius_slope y + height: equal apertures, the thickness constant along the radius.

    Its chart is (y, theta): metres along the axis and the polar angle from +z towards +x, in rad, so theta = 0 is on the YOZ
    plane with positive z.
    """

    params: tuple[Param, ...] = (Param("cover.inner_radius", "m", 1e-3), Param("cover.radius_slope", "", 1e-2))

    def reach(self, origin: Tensor, direction: Tensor, height: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        slope = values["cover.radius_slope"]
        radius = values["cover.inner_radius"] + height + slope * origin[..., 1]  # (...) of the surface beside the origin
        ox, oz = origin[..., 0], origin[..., 2]
        dx, dy, dz = direction.unbind(-1)
        # a t^2 + 2 b t + c = 0, and c < 0 inside: the way out is -c / (b + sqrt(b^2 - a c)), which stays exact for a -> 0.
        a = dx**2 + dz**2 - (slope * dy) ** 2
        b = ox * dx + oz * dz - slope * dy * radius
        c = ox**2 + oz**2 - radius**2
        disc = b**2 - a * c
        hopeless = disc <= 0
        below = b + torch.where(hopeless, torch.ones_like(disc), disc).sqrt()
        hopeless = hopeless | (below <= 1e-9)
        distance = -c / torch.where(hopeless, torch.ones_like(below), below)
        distance = torch.where(hopeless, torch.zeros_like(distance), distance)
        beyond_apex = radius + slope * dy * distance <= 0
        return distance, hopeless | beyond_apex | (distance < 0)

    def height(self, points: Tensor, values: Values) -> Tensor:
        return _rho(points) - values["cover.inner_radius"] - values["cover.radius_slope"] * points[..., 1]

    def gradient(self, points: Tensor, values: Values) -> Tensor:
        rho = _rho(points)
        down = (-values["cover.radius_slope"]).expand(rho.shape)
        return torch.stack([points[..., 0] / rho, down, points[..., 2] / rho], -1)

    def chart(self, points: Tensor) -> Tensor:
        return torch.stack([points[..., 1], torch.atan2(points[..., 0], points[..., 2])], -1)

    def chart_gradient(self, points: Tensor) -> Tensor:
        rho2 = _rho(points) ** 2
        zero = torch.zeros_like(rho2)
        along = torch.stack([zero, torch.ones_like(rho2), zero], -1)
        around = torch.stack([points[..., 2] / rho2, zero, -points[..., 0] / rho2], -1)
        return torch.stack([along, around], -2)


def _rho(points: Tensor) -> Tensor:
    """(...) m from the axis, never quite zero, so that its derivative exists."""
    return (points[..., 0] ** 2 + points[..., 2] ** 2 + 1e-30).sqrt()
