"""A way in which numbers differ from view to view, and the effect that models it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calib.effects.board_flex import BoardFlex
from calib.effects.board_scale import BoardScale
from calib.effects.effect import Effect, EffectContext
from calib.effects.registry import EFFECTS, OF_VIEW
from calib.effects.varying import Varying
from calib.inference.varying_numbers import TWO, Group, VariationKind
from calib.session.parameter_names import COVER
from calib.session.shapes.layer import WATER, medium_word

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Variation:
    """A way in which a group of numbers may differ from view to view."""

    group: Group
    kind: VariationKind
    gain: float
    """The increase of the log evidence, less `penalty`."""
    scales: Array
    """(G,) the standard deviations of the numbers' deviations, in tolerances."""
    deviations: Array
    """(V, G) the deviations of each view's numbers, in tolerances."""
    pattern: Array
    """(V,) what the deviations of all numbers follow; (0,) if every view has its own."""
    penalty: float = 0.0
    """The logarithm of the number of variants tried."""
    view_log_likelihoods: Array = field(default_factory=lambda: np.zeros(0))
    """(V,) log likelihood of each view's corners with it, up to a constant; (0,) if not asked."""

    @property
    def largest(self) -> float:
        """The root mean square of the deviations of the number that deviates most, in
        tolerances.
        """
        return float(np.sqrt((self.deviations**2).mean(0)).max())

    @property
    def next_state(self) -> int | None:
        """A view in the state at the end, which the next picture has, of numbers that step or
        settle; None if the maps are of the mean.
        """
        match self.kind:
            case VariationKind.STEP:
                return int(self.pattern.argmax())
            case VariationKind.WARM_UP:
                return int(self.pattern.argmin())
        return None

    def effects(self, context: EffectContext) -> tuple[Effect, ...]:
        """Return the effect that adds these deviations to a model; none if there is none. A board
        whose bend differs gets one of its own in every view.
        """
        name = self.group.name
        flexes = name == BoardFlex.name and self.group.kinds != TWO  # else it was turned
        each = flexes or self.kind is VariationKind.EACH
        for kind in (*EFFECTS, *OF_VIEW):
            if each and kind.varies and kind.name == name:
                return kind.propose(context)
        if name in (BoardScale.name, BoardFlex.name) or not self.group.has_cause:
            return ()
        end = self.next_state
        pattern = self.pattern - (0.0 if end is None else self.pattern[end])
        if self.group.is_medium:
            stated = medium_word(float(context.values[COVER.outside_index]))
            pattern = self._wet.astype(np.float64) - float(stated == WATER)
        return (Varying(name, self.kind.varies, self.group.number_names, tuple(pattern.tolist())),)

    @property
    def _wet(self) -> NDArray[np.bool_]:
        """(V,) whether each view is in the medium of the higher index, if the media differ."""
        indices = self.deviations[:, 0]
        return np.asarray(indices > (indices.min() + indices.max()) / 2)

    def penalised(self, penalty: float) -> Variation:
        """Return the best of several variants with the penalty for trying them."""
        return replace(self, gain=self.gain - penalty, penalty=penalty)
