"""The paper's procedure: with poses and cover held, gradient descent on the amplitudes
(equations 2 and 3).

The paper does not name its descent. This is Nesterov's accelerated gradient descent with the step 1
/ L, L the curvature of the loss measured by power iteration, restarted when the loss rises. So
there is no learning rate to choose, at any amplitude.

Sources: Y. Nesterov, A method of solving a convex programming problem with convergence rate
O(1/k^2) (1983); B. O'Donoghue, E. Candes, Adaptive restart for accelerated gradient schemes (2015),
section 3.2, the function scheme.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from calib.estimation.observations import Observations
from calib.optics.interface import Interface
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.placement import Placement

POWER_STEPS = 12
SAFETY = 1.1
"""The power iteration underestimates the curvature; a step this much shorter is still stable."""


def descend(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    *,
    steps: int,
    progress: Callable[[int, float], None] | None = None,
) -> Tensor:
    """Fit the amplitudes alone.

    Args:
        path: a path with a relief on its outer surface.
        values: all values of the path; relief.amplitudes is the start.
        poses: (V, 6) T_camera_board, constant.
        steps: the number of gradient steps.
        progress: called after each step with its number and the loss, m^2 summed over corners.

    Returns:
        (rows, columns) m, the amplitudes with the lowest loss of all steps.
    """
    loss = _loss(path, values, observations, poses)
    start = values["relief.amplitudes"].detach()
    length = 1 / (SAFETY * _curvature(loss, start))
    best, lowest = start, float("inf")
    current, ahead, momentum, previous = start, start, 1.0, float("inf")
    for step in range(1, steps + 1):
        cost, slope = _gradient(loss, ahead)
        if cost < lowest:
            best, lowest = ahead, cost
        if cost > previous:
            momentum = 1.0  # the restart drops the momentum
        previous = cost
        descended = ahead - length * slope
        next_momentum = (1 + (1 + 4 * momentum**2) ** 0.5) / 2
        ahead = descended + (momentum - 1) / next_momentum * (descended - current)
        current, momentum = descended, next_momentum
        if progress:
            progress(step, lowest)
    return current if float(loss(current)) < lowest else best


def _loss(
    path: Path, values: Values, observations: Observations, poses: Tensor
) -> Callable[[Tensor], Tensor]:
    """Return the sum of squared distances on the board as a function of the amplitudes.

    The part of the path that the amplitudes do not change is traced once.
    """
    *inner, outer = path.cover
    rays = Path(path.lens, tuple[Interface, ...](inner)).trace(
        observations.pixels, values, observations.exposure
    )
    corners, planes = path.planes(observations.corners, Placement.of(poses)[observations.view])

    def loss(amplitudes: Tensor) -> Tensor:
        landed, failure = path.target(
            outer(rays, {**values, "relief.amplitudes": amplitudes}), planes, values
        )
        squared = ((landed - corners) ** 2).sum(-1) * observations.weight**2
        return torch.where(failure == 0, squared, torch.zeros_like(squared)).sum()

    return loss


def _gradient(loss: Callable[[Tensor], Tensor], amplitudes: Tensor) -> tuple[float, Tensor]:
    variable = amplitudes.detach().requires_grad_()
    cost = loss(variable)
    (slope,) = torch.autograd.grad(cost, variable)
    return float(cost.detach()), slope


def _curvature(loss: Callable[[Tensor], Tensor], start: Tensor) -> float:
    """Return the largest eigenvalue of the loss's second derivative, by power iteration on
    differences of gradients.
    """
    _, base = _gradient(loss, start)
    direction = torch.ones_like(start) / start.numel() ** 0.5
    size = 1e-7  # m: far above rounding, far below a bump
    curvature = 0.0
    for _ in range(POWER_STEPS):
        change = (_gradient(loss, start + size * direction)[1] - base) / size
        curvature = float(change.norm())
        if curvature == 0:
            return 1.0
        direction = change / curvature
    return curvature
