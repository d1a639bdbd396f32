"""Snell's law at one interface."""

import torch
from torch import Tensor

from calib.optics.vector import Vector


def refract(direction: Vector, normal: Vector, ratio: Tensor) -> tuple[Vector, Tensor]:
    """Bend unit rays at an interface by Snell's law.

    Args:
        direction: (...) unit, travelling towards the surface.
        normal: (...) unit, on the side that the rays go to.
        ratio: () n_from / n_to.

    Returns:
        (...) unit bent directions, and (...) bool, true where the light is totally reflected. Those
        rows keep their direction: finite, with finite gradients.
    """
    cos_in = direction.dot(normal)
    cos2_out = 1 - ratio**2 * (1 - cos_in**2)
    reflected = cos2_out <= 0
    cos_out = torch.where(
        reflected, torch.ones_like(cos2_out), cos2_out
    ).sqrt()  # masked before the root
    gain = torch.where(reflected, torch.ones_like(cos_out), ratio)
    push = torch.where(reflected, torch.zeros_like(cos_out), cos_out - ratio * cos_in)
    return direction * gain + normal * push, reflected
