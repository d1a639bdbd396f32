"""Derivatives of the ray path in reverse, stage by stage and in closed form.

Two residuals of a corner depend on a dozen numbers. So a stage does not carry the derivatives by
each number forwards. It turns the derivatives of the k outputs by the rays that leave it into those
by the rays that enter it, and into those by its own numbers (the adjoint of the stage). A crossing
of a surface takes the implicit function theorem and Snell's law for that; a few stages that cost
little are differentiated by torch (`by_autograd`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.rotation import Rotation
from calib.optics.vector import Vector

ByName = dict[str, Tensor]
"""The (k, M, ...) derivatives of k outputs of M rays by each ray's own copy of a number."""


@dataclass(frozen=True, slots=True)
class ByRay:
    """The derivatives of k outputs of M rays by the rays."""

    origin: Vector
    """(k, M) per m"""
    direction: Vector
    """(k, M) by the components of the direction, as if they were independent."""

    def turned(self, turn: Rotation) -> ByRay:
        """Return those by the rays before a rotation, from those by the rays after it."""
        return ByRay(turn.turn(self.origin, back=True), turn.turn(self.direction, back=True))


def add_to(derivatives: ByName, name: str, value: Tensor) -> None:
    """Add derivatives by a number to those that other stages have given it."""
    derivatives[name] = derivatives[name] + value if name in derivatives else value


def by_autograd(
    function: Callable[[Mapping[str, Tensor]], Sequence[Tensor]], inputs: Mapping[str, Tensor]
) -> tuple[tuple[Tensor, ...], Callable[[Sequence[Tensor]], ByName]]:
    """Evaluate a function of rows that torch differentiates.

    Args:
        function: from values by name to (M,) outputs; row m of the outputs depends on row m of the
            inputs alone.
        inputs: (M, ...) by name.

    Returns:
        The outputs, and a function that turns the (k, M) derivatives by each output into the (k, M,
        ...) derivatives by each input.
    """
    leaves = {name: value.detach().clone().requires_grad_() for name, value in inputs.items()}
    with torch.enable_grad():
        outputs = tuple(function(leaves))
    differentiable = [place for place, output in enumerate(outputs) if output.requires_grad]

    def pull(by_outputs: Sequence[Tensor]) -> ByName:
        count = len(by_outputs[0])
        if not differentiable or not leaves:
            return {name: leaf.new_zeros(count, *leaf.shape) for name, leaf in leaves.items()}
        # Without `grad_outputs`, for which torch imports its symbolic shapes, and these sympy.
        with torch.enable_grad():
            sums = [
                torch.stack(
                    [(outputs[place] * by_outputs[place][row]).sum() for place in differentiable]
                ).sum()
                for row in range(count)
            ]
        passes = [
            torch.autograd.grad(
                total,
                list(leaves.values()),
                retain_graph=True,
                allow_unused=True,
                materialize_grads=True,
            )
            for total in sums
        ]
        return {
            name: torch.stack(columns)
            for name, columns in zip(leaves, zip(*passes, strict=True), strict=True)
        }

    return tuple(output.detach() for output in outputs), pull
