"""Snell's law at one interface."""

import torch
from torch import Tensor


def refract(direction: Tensor, normal: Tensor, ratio: Tensor) -> tuple[Tensor, Tensor]:
    """Bend unit rays at an interface by Snell's law.

    Args:
        direction: (..., 3) unit, travelling towards the surface.
        normal: (..., 3) unit, on the incoming side.
        ratio: () n_from / n_to.

    Returns:
        (..., 3) unit bent directions, and (...) bool, true where the light is totally reflected. Those rows keep their
        direction: finite, with finite gradients.
    """
    cos_in = -(direction * normal).sum(-1, keepdim=True)  # (..., 1)
    cos2_out = 1 - ratio**2 * (1 - cos_in**2)  # (..., 1)
    reflected = cos2_out <= 0
    cos_out = torch.where(reflected, torch.ones_like(cos2_out), cos2_out).sqrt()  # masked before the root
    bent = ratio * direction + (ratio * cos_in - cos_out) * normal
    return torch.where(reflected, direction, bent), reflected.squeeze(-1)
