"""Rotations as rotation vectors: the axis times the angle."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.vector import Vector


@dataclass(frozen=True, slots=True)
class Rotation:
    """(...) rotation matrices stored by entry, so that the rotation of many vectors needs no sums
    over a last axis of three.
    """

    rows: tuple[Vector, Vector, Vector]

    @staticmethod
    def of(matrices: Tensor) -> Rotation:
        """Return the rotations of (..., 3, 3) matrices."""
        entries = matrices.flatten(-2).unbind(-1)
        return Rotation((Vector(*entries[:3]), Vector(*entries[3:6]), Vector(*entries[6:])))

    @staticmethod
    def from_rotvec(rotvec: Vector) -> Rotation:
        """Return the rotations of (...) rotation vectors, rad, by the same formula as `matrix`."""
        angle2 = rotvec.dot(rotvec)
        sine, cosine = _factors(angle2)
        keep = 1 - cosine * angle2
        sine_part = rotvec * sine
        scaled = rotvec * cosine
        xy, yz, zx = scaled.x * rotvec.y, scaled.y * rotvec.z, scaled.z * rotvec.x
        return Rotation(
            (
                Vector(keep + scaled.x * rotvec.x, xy - sine_part.z, zx + sine_part.y),
                Vector(xy + sine_part.z, keep + scaled.y * rotvec.y, yz - sine_part.x),
                Vector(zx - sine_part.y, yz + sine_part.x, keep + scaled.z * rotvec.z),
            )
        )

    def turn(self, vector: Vector, *, back: bool = False) -> Vector:
        """Rotate a vector, or rotate it by the inverse."""
        first, second, third = self.rows
        if back:
            return first * vector.x + second * vector.y + third * vector.z
        return Vector(first.dot(vector), second.dot(vector), third.dot(vector))


def matrix(rotvec: Tensor) -> Tensor:
    """Return the rotation matrices of rotation vectors, by Rodrigues' formula.

    Args:
        rotvec: (..., 3) rad.

    Returns:
        (..., 3, 3) rotation matrices, smooth through zero.
    """
    angle2 = (rotvec**2).sum(-1)  # (...)
    sine, cosine = _factors(angle2)
    cross = _cross(rotvec)
    outer = rotvec.unsqueeze(-1) * rotvec.unsqueeze(-2)
    eye = torch.eye(3, dtype=rotvec.dtype, device=rotvec.device)
    # exp(w) = I + s [w] + c [w]^2, and [w]^2 = w w^T - |w|^2 I
    sine_part: Tensor = (
        (1 - cosine * angle2)[..., None, None] * eye
        + sine[..., None, None] * cross
        + cosine[..., None, None] * outer
    )
    return sine_part


def onto_z(directions: Tensor) -> Tensor:
    """Return (..., 3, 3) rotations that turn (..., 3) unit directions onto the z axis."""
    half_turn = torch.ones_like(directions)
    half_turn[..., 1:] = torch.where(directions[..., 2:] < 0, -1.0, 1.0)  # about x, away from -z
    x, y, z = (directions * half_turn).unbind(-1)
    near = 1 / (1 + z)
    rows = [1 - near * x * x, -near * x * y, -x, -near * x * y, 1 - near * y * y, -y, x, y, z]
    turned: Tensor = torch.stack(rows, -1).reshape(*x.shape, 3, 3) * half_turn.unsqueeze(-2)
    return turned


def _factors(angle2: Tensor) -> tuple[Tensor, Tensor]:
    """Return (...) sin(a) / a and (1 - cos(a)) / a^2 for (...) a^2, smooth through zero."""
    small = angle2 < 1e-8
    safe2 = torch.where(small, torch.ones_like(angle2), angle2)  # masked before the root
    angle = safe2.sqrt()
    # Taylor to the second order in angle^2: at 1e-8 the next term is below 1e-19.
    sine = torch.where(small, 1 - angle2 / 6 + angle2**2 / 120, angle.sin() / angle)
    cosine = torch.where(small, 0.5 - angle2 / 24 + angle2**2 / 720, (1 - angle.cos()) / safe2)
    return sine, cosine


def left_jacobian(rotvec: Tensor) -> Tensor:
    """Return the left Jacobian of SO(3): a change dw of a rotation vector turns the rotation
    further by J dw, about the axes of the frame into which it leads.

    J = I + a [w] + b [w]^2. Source: T. D. Barfoot, State estimation for robotics (2017), equation
    7.77.

    Args:
        rotvec: (..., 3) rad.

    Returns:
        (..., 3, 3), column i for component i.
    """
    angle2 = (rotvec**2).sum(-1)[..., None, None]  # (..., 1, 1)
    small = angle2 < 1e-6
    safe2 = torch.where(small, torch.ones_like(angle2), angle2)
    angle = safe2.sqrt()
    # Taylor to the first order in angle^2: at 1e-6 the next term is below 1e-14.
    a = torch.where(small, 0.5 - angle2 / 24, (1 - angle.cos()) / safe2)
    b = torch.where(small, 1 / 6 - angle2 / 120, (angle - angle.sin()) / (safe2 * angle))
    cross = _cross(rotvec)
    eye = torch.eye(3, dtype=rotvec.dtype, device=rotvec.device)
    jacobian: Tensor = eye + a * cross + b * (cross @ cross)
    return jacobian


def derivatives(rotvec: Tensor, turn: Tensor) -> Tensor:
    """Return the derivatives of rotation matrices by their rotation vectors: dR / dw_i = [J e_i] R
    (`left_jacobian`). Source: the same book, equation 7.85.

    Args:
        rotvec: (..., 3) rad.
        turn: (..., 3, 3) their matrices.

    Returns:
        (..., 3, 3, 3): the i-th of the first three is the derivative by component i.
    """
    return _cross(left_jacobian(rotvec).mT) @ turn.unsqueeze(-3)


def _cross(vectors: Tensor) -> Tensor:
    """Return the (..., 3, 3) cross-product matrices [v] of (..., 3) vectors."""
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(
        *vectors.shape[:-1], 3, 3
    )
