"""The parameters of each view: its pose, and further blocks that an effect adds."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import torch
from torch import Tensor

from calib.optics.flex_bend import FLEX_TERMS

POSE, MOTION, FLEX, FOCAL, CENTRE = "pose", "motion", "flex", "focal", "centre"
VIEW_BLOCKS = {POSE: 6, MOTION: 6, FLEX: len(FLEX_TERMS), FOCAL: 1, CENTRE: 2}
"""The blocks of per-view parameters in their order, and the number of parameters in each.

Every view has a pose; the other blocks are optional, and a view has FOCAL or CENTRE, not both.
"""
BLOCKS_OF_SIZE = {
    sum(VIEW_BLOCKS[block] for block in blocks): blocks
    for motion, flex, camera in product(((), (MOTION,)), ((), (FLEX,)), ((), (FOCAL,), (CENTRE,)))
    for blocks in [(POSE, *motion, *flex, *camera)]
}
"""The blocks of a view by the number of its parameters, which differs for each choice."""


def block_columns(blocks: Iterable[str]) -> dict[str, slice]:
    """Return the columns of each of these blocks among the parameters of one view."""
    columns, end = {}, 0
    for block in (block for block in VIEW_BLOCKS if block in blocks):
        columns[block] = slice(end, end + VIEW_BLOCKS[block])
        end += VIEW_BLOCKS[block]
    return columns


def blocks_of_size(count: int) -> tuple[str, ...]:
    """Return the blocks of a view that has this many parameters."""
    return BLOCKS_OF_SIZE[count]


def with_blocks(parameters: Tensor, blocks: Iterable[str]) -> Tensor:
    """Return the (V, B) parameters of views with exactly these blocks: a new block is zero, and a
    block that is not named is dropped.
    """
    columns = block_columns(blocks_of_size(parameters.shape[1]))
    zero = parameters.new_zeros(len(parameters), 1)
    return torch.cat(
        [
            parameters[:, columns[block]]
            if block in columns
            else zero.expand(-1, VIEW_BLOCKS[block])
            for block in block_columns(blocks)
        ],
        1,
    )
