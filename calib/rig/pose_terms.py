"""Numbers of a rig by which the board's pose in a view differs from mounting times placement."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, slots=True)
class PoseTerms:
    """Numbers by which the board's pose in each view of one camera differs from the mounting times
    the placement: a camera that is late, or that slipped.
    """

    entries: Tensor
    """(k,) int64: the places of these numbers in a vector."""
    by_mounting: Tensor
    """(V, 6, k) changes of the mounting in each view."""
    by_placement: Tensor
    """(V, 6, k) changes of the placement that each view sees."""

    def select(self, views: Tensor) -> PoseTerms:
        """Return the terms of the views in a (V,) mask."""
        return PoseTerms(self.entries, self.by_mounting[views], self.by_placement[views])

    def joined(self, further: PoseTerms | None) -> PoseTerms:
        """Return these terms and further ones of the same camera."""
        if further is None:
            return self
        return PoseTerms(
            torch.cat([self.entries, further.entries]),
            torch.cat([self.by_mounting, further.by_mounting], -1),
            torch.cat([self.by_placement, further.by_placement], -1),
        )

    def moved(self, mounting: Tensor, placements: Tensor, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """Return the (V, 6) mounting and the (V, B) placement of each view, from the (6,) mounting,
        the (V, B) placements and all numbers of the vector.
        """
        values = numbers[self.entries]
        poses = placements[:, :6] + self.by_placement @ values
        return mounting + self.by_mounting @ values, torch.cat([poses, placements[:, 6:]], 1)
