"""Effects of one camera, or of the board that all cameras see, as rivals of those of the rig: what
they would change in the corners may look like cameras that disagree.

A board that bends differently in every placement is no rival but an effect that a rig's fit may
have. Its numbers belong to the placements.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.effects.board_flex import BoardFlex
from calib.effects.effect import Effect, EffectContext, is_possible, scaled_prior_sigmas
from calib.effects.registry import EFFECTS
from calib.estimation.camera_model import CameraModel
from calib.optics.view_blocks import with_blocks
from calib.rig.joint_estimate import CameraState, RigState
from calib.rig.layout import RigLayout
from calib.rig.rig import Rig

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class OwnEffect:
    """An effect of one camera, or of the board."""

    effect: Effect
    camera: str
    """Empty for an effect of the board."""
    entries: Indices
    """(k,) the places of its numbers in the vector."""

    @property
    def spread(self) -> Array:
        """(k,) the prior standard deviations of its numbers."""
        return scaled_prior_sigmas(self.effect)


@dataclass(frozen=True, slots=True, eq=False)
class WideState:
    """A state with the numbers of all such effects, which do nothing."""

    state: RigState
    base: Indices
    """(S,) the places of the numbers of the state without them."""
    effects: tuple[OwnEffect, ...]
    board_flex: BoardFlex | None = None
    """The effect whose bends the placements have and those of the base state have not."""


def with_own_effects(rig: Rig, state: RigState) -> WideState:
    """Return a state with the effects that its cameras and its board may have, a bend of the board
    in every placement among them.
    """
    contexts = [_context(rig.calibrations[camera.name], camera) for camera in state.cameras]
    board_flex = next(iter(BoardFlex.propose(contexts[0])), None)
    further = [board_flex] if board_flex else []
    proposed = [
        (*_proposed(context, camera), *further)
        for context, camera in zip(contexts, state.cameras, strict=True)
    ]
    return replace(with_effects(state, proposed), board_flex=board_flex)


def with_effects(state: RigState, effects: Sequence[Sequence[Effect]]) -> WideState:
    """Return a state with further effects of each camera. Those of the board are of all cameras. A
    placement has the further numbers that an effect adds to every view, at zero.
    """
    names = [camera.name for camera in state.cameras]
    models = [
        camera.model.with_effects(new) for camera, new in zip(state.cameras, effects, strict=True)
    ]
    layout = state.layout.of_models(names, models)
    cameras = tuple(
        replace(
            camera,
            model=model,
            values={name: camera.values.get(name, mean) for name, mean in model.means.items()},
        )
        for camera, model in zip(state.cameras, models, strict=True)
    )
    placements = with_blocks(state.placements, models[0].path.view_blocks)
    wide = replace(state, cameras=cameras, layout=layout, placements=placements)
    by_owner: dict[tuple[str, str], OwnEffect] = {}
    for index, (model, new) in enumerate(zip(models, effects, strict=True)):
        board = {param.name for param in model.path.target.params}
        places = _places(model, layout, index)
        for effect in (effect for effect in new if effect.effect_parameters):
            numbers = [unknown.param.name for unknown in effect.effect_parameters]
            owner = "" if board.issuperset(numbers) else names[index]
            entries = np.concatenate([places[name] for name in numbers])
            by_owner.setdefault((effect.name, owner), OwnEffect(effect, owner, entries))
    return WideState(wide, _base_places(state, wide), tuple(by_owner.values()))


def _context(calibration: Calibration, camera: CameraState) -> EffectContext:
    model = camera.model
    return EffectContext(
        board=calibration.board,
        width=calibration.camera.width,
        height=calibration.camera.height,
        path=model.path,
        values=camera.values,
        estimated=frozenset(model.priors.sigmas),
        shutter=calibration.camera.shutter,
    )


def _proposed(context: EffectContext, camera: CameraState) -> Iterator[Effect]:
    """Yield the effects of scalars that are neutral at the start, and that a first derivative
    judges.
    """
    model = camera.model
    for kind in EFFECTS:
        if kind.per_view or kind.needs_place or not kind.judged_by_score:
            continue
        forms = kind.propose(context) if is_possible(kind, model.path) else ()
        for effect in forms[:1]:
            unknowns = effect.effect_parameters
            is_scalar = all(not unknown.param.shape for unknown in unknowns)
            is_neutral = all(unknown.initial == unknown.neutral for unknown in unknowns)
            is_new = all(unknown.param.name not in model.means for unknown in unknowns)
            if is_scalar and is_neutral and is_new:
                yield effect


def _places(model: CameraModel, layout: RigLayout, index: int) -> dict[str, Indices]:
    """Return the places of a camera's parameters in the vector of the rig."""
    columns = layout.columns[index].numpy()
    return {name: columns[place] for name, place in model.parameters.slices().items()}


def _base_places(state: RigState, wide: RigState) -> Indices:
    """Return the (S,) places of the numbers of a state in the vector of a wider one."""
    places = np.zeros(state.layout.count + len(state.numbers), np.int64)
    for index, (narrow, wider) in enumerate(zip(state.cameras, wide.cameras, strict=True)):
        old = _places(narrow.model, state.layout, index)
        new = _places(wider.model, wide.layout, index)
        for name, entries in old.items():
            places[entries] = new[name]
    for old_entries, new_entries in zip(state.layout.mountings, wide.layout.mountings, strict=True):
        places[old_entries.numpy()] = new_entries.numpy()
    numbers = torch.arange(len(state.numbers))
    places[(state.layout.count + numbers).numpy()] = (wide.layout.count + numbers).numpy()
    return places
