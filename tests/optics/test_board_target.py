"""The board's own place and shape move the points where rays meet it."""

import pytest
import torch
from torch import Tensor

from calib.effects.board_shape import BoardShape
from calib.optics import rotation
from calib.optics.board_target import Target
from calib.optics.board_terms import Bend
from calib.optics.flex_bend import FLEX_TERMS
from calib.optics.placement import Placement
from calib.optics.rays import Rays
from calib.optics.vector import Vector
from tests.optics.oracle import row_derivatives

HALF = 0.1, 0.08
BOWED = BoardShape(*HALF, degree=4)


def seen() -> tuple[Rays, list[Tensor], dict[str, Tensor]]:
    """Rays to a tilted board, its rotation, place and flex for each ray, and the parameters of its
    shape.
    """
    generator = torch.Generator().manual_seed(3)
    directions = torch.cat(
        [
            torch.rand(40, 2, generator=generator, dtype=torch.float64) * 0.3 - 0.15,
            torch.ones(40, 1, dtype=torch.float64),
        ],
        1,
    )
    start = torch.rand(40, 3, generator=generator, dtype=torch.float64) * 1e-3
    rays = Rays(Vector.of(start), Vector.of(directions).unit(), torch.zeros(40, dtype=torch.uint8))
    turn = rotation.matrix(torch.tensor([0.5, -0.4, 0.2], dtype=torch.float64)).expand(40, 3, 3)
    shift = torch.tensor([0.01, -0.02, 0.5], dtype=torch.float64).expand(40, 3)
    flex = 3e-4 * torch.randn(len(FLEX_TERMS), generator=generator, dtype=torch.float64)
    flex = flex.expand(40, -1)
    sizes = {
        unknown.param.name: torch.tensor(1e-3 / (1 + at), dtype=torch.float64)
        for at, unknown in enumerate(BOWED.effect_parameters)
    }
    return rays, [tensor.clone().requires_grad_() for tensor in (turn, shift, flex)], sizes


@pytest.mark.parametrize("bends", [(), (BOWED,)], ids=["flat", "bowed"])
@pytest.mark.parametrize("flexed", [False, True])
def test_changes_are_those_of_reverse_passes(bends: tuple[Bend, ...], flexed: bool) -> None:
    rays, leaves, sizes = seen()
    target = Target(bends, flex=HALF if flexed else None)
    rays_leaves = [
        component.clone().requires_grad_()
        for component in (*_components(rays.origin), *_components(rays.direction))
    ]
    turned = rotation.matrix(turn := torch.zeros(40, 3, dtype=torch.float64).requires_grad_())
    placement = Placement(turned @ leaves[0], leaves[1], flex=leaves[2] if flexed else None)
    moved = Rays(Vector(*rays_leaves[:3]), Vector(*rays_leaves[3:]), rays.failure)
    landed, failure = target(moved, placement, sizes)
    inputs = [*rays_leaves, turn, *leaves[1 : 3 if flexed else 2]]
    expected = row_derivatives(landed, inputs)
    with torch.no_grad():
        recomputed, failed, landing = target.land(rays, placement, sizes)
        identity = torch.eye(2).double()[:, None].expand(2, 40, 2)
        by_rays, by_placement, _ = landing.pull(identity)
    assert torch.equal(recomputed, landed.detach())
    assert torch.equal(failed, failure)
    results = [*_components(by_rays.origin), *_components(by_rays.direction)]
    results += [by_placement.turn.stacked(), by_placement.shift.stacked()]
    results += [by_placement.flex] if by_placement.flex is not None else []
    assert len(results) == len(expected)
    for result, wanted in zip(results, expected, strict=True):
        assert torch.allclose(result.transpose(0, 1), wanted, rtol=1e-9, atol=1e-12)


def _components(vector: Vector) -> tuple[Tensor, Tensor, Tensor]:
    return vector.x, vector.y, vector.z
