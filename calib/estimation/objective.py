"""What the solver minimises: how far the corners of all views land from where they are, by the numbers of a ray path and by the poses."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.levenberg_marquardt import Linearised
from calib.estimation.residual_blocks import Landing
from calib.optics.params import Values
from calib.optics.relief import Relief

HUBER = 3.0

SPIN, MOVE = 0.05, 0.01
"""rad and m: how far a board may well turn and move during one readout."""


def view_precision(blocks: Tensor) -> Tensor:
    """(B,) of what is known of each view's own numbers (V, B) beforehand: nothing of its pose."""
    motion = [SPIN**-2] * 3 + [MOVE**-2] * 3
    return blocks.new_tensor(([0.0] * 6 + motion)[: blocks.shape[1]])


@dataclass(frozen=True, slots=True)
class Shared:
    """The numbers that all views share, and where they stand in the solver's vector: the relief's amplitudes, row by row, then the free
    numbers over their scales, as deviations from where the fit starts."""

    start: Values
    relief: Relief | None
    """Whose amplitudes are estimated."""
    free: Mapping[str, float]
    """The scale of each free number; one that has several entries takes as many places."""

    @property
    def amplitudes(self) -> int:
        return self.relief.grid[0] * self.relief.grid[1] if self.relief else 0

    @property
    def count(self) -> int:
        return self.amplitudes + sum(self.start[name].numel() for name in self.free)

    @property
    def scales(self) -> Tensor:
        """One for each entry of the free numbers."""
        some = next(iter(self.start.values()))
        return some.new_tensor([scale for name, scale in self.free.items() for _ in range(self.start[name].numel())])

    def places(self) -> dict[str, slice]:
        """Where each free number stands."""
        begin, found = self.amplitudes, {}
        for name in self.free:
            found[name] = slice(begin, begin + self.start[name].numel())
            begin = found[name].stop
        return found

    def at(self, shared: Tensor) -> dict[str, Tensor]:
        """The path's numbers for (S,) shared ones."""
        moved = dict(self.start)
        if self.relief:
            moved["relief.amplitudes"] = moved["relief.amplitudes"] + shared[: self.amplitudes].reshape(self.relief.grid)
        for name, place in self.places().items():
            moved[name] = moved[name] + self.free[name] * shared[place].reshape(moved[name].shape)
        return moved

    def of(self, values: Values) -> Tensor:
        """The (S,) shared numbers at which the path's numbers are these."""
        changed = ["relief.amplitudes"] * bool(self.relief) + list(self.free)
        parts = [(values[name] - self.start[name]).flatten() / self.free.get(name, 1.0) for name in changed]
        return torch.cat(parts) if parts else next(iter(self.start.values())).new_zeros(0)


@dataclass(frozen=True, slots=True)
class LandingProblem:
    """The solver's view of boards seen through a ray path; its blocks are their poses."""

    shared: Shared
    views: tuple[Landing, ...]
    precision: Tensor
    """(S, S) of the prior on the shared numbers."""
    block_precision: Tensor
    """(B,) of the prior on each view's own numbers."""
    huber: float = HUBER
    """Standard deviations beyond which a corner counts by its distance, not by its square."""

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        values = self.shared.at(shared)
        total = 0.0
        for landing, poses in self._split(blocks):
            residual, lands = landing.residual(values, poses)
            squared = (residual**2).sum(-1)
            robust = torch.where(squared <= self.huber**2, squared, 2 * self.huber * squared.sqrt() - self.huber**2)
            total += float(torch.where(lands, robust, torch.inf).sum())
        return total

    def linearise(self, shared: Tensor, blocks: Tensor) -> Iterator[Linearised]:
        values = self.shared.at(shared)
        for landing, poses in self._split(blocks):
            at = landing.linearise(values, poses, self.shared.scales)
            size = at.residual.norm(dim=-1)
            if bool((size > self.huber).any()):
                robust = (self.huber / size.clamp_min(self.huber)).sqrt()[:, None, None]  # the square root of Huber's weight
                at = Linearised(at.starts, at.residual * robust[..., 0], at.jacobian_block * robust, at.jacobian_shared * robust)
            yield at

    def _split(self, blocks: Tensor) -> Iterator[tuple[Landing, Tensor]]:
        begin = 0
        for landing in self.views:
            count = len(landing.observations.names)
            yield landing, blocks[begin : begin + count]
            begin += count
