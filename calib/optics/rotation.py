"""Rotations as rotation vectors: the axis times the angle."""

import torch
from torch import Tensor


def matrix(rotvec: Tensor) -> Tensor:
    """Rodrigues' formula.

    Args:
        rotvec: (..., 3) rad.

    Returns:
        (..., 3, 3) rotation matrices, smooth through zero.
    """
    angle2 = (rotvec**2).sum(-1)  # (...)
    small = angle2 < 1e-8
    safe2 = torch.where(small, torch.ones_like(angle2), angle2)  # masked before the root
    angle = safe2.sqrt()
    # Taylor to the second order in angle^2: at 1e-8 the next term is below 1e-19.
    sine = torch.where(small, 1 - angle2 / 6 + angle2**2 / 120, angle.sin() / angle)
    cosine = torch.where(small, 0.5 - angle2 / 24 + angle2**2 / 720, (1 - angle.cos()) / safe2)
    x, y, z = rotvec.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*rotvec.shape[:-1], 3, 3)
    outer = rotvec.unsqueeze(-1) * rotvec.unsqueeze(-2)
    eye = torch.eye(3, dtype=rotvec.dtype, device=rotvec.device)
    # exp(w) = I + s [w] + c [w]^2, and [w]^2 = w w^T - |w|^2 I
    turned: Tensor = (1 - cosine * angle2)[..., None, None] * eye + sine[..., None, None] * cross + cosine[..., None, None] * outer
    return turned
