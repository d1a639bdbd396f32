"""The start of a rig's diagnosis: the linearised fit, and the motion of the board."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calib.effects.board_flex import BoardFlex
from calib.estimation.objective import view_precision
from calib.rig.board_motion import BoardMotion, motion_in_placement, placement_times
from calib.rig.joint_estimate import RigState
from calib.rig.motion_evidence import RandomMotion
from calib.rig.motion_products import POSE, MotionProducts
from calib.rig.own_effects import WideState, with_own_effects
from calib.rig.rig import Rig

DISCREPANCY = (1e-4, 10.0)
"""px: the range of a disagreement without a cause, root mean square over the corners."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigContext:
    """The data of all explanations: the linearised fit, and the motion of the board."""

    products: MotionProducts
    wide: MotionProducts
    """The same with the columns of effects of single cameras and of the board."""
    compared: tuple[str, ...]
    """The cameras whose lateness the placements tell."""
    mounted: tuple[str, ...]
    """The compared cameras whose mounting the placements tell."""
    reference: str
    order: NDArray[np.int64]
    """(P,) the placements in the order of time, or of their names."""
    shared: NDArray[np.bool_]
    """(P,) true for a placement that two cameras saw."""
    motion: BoardMotion
    accepted: tuple[RandomMotion, ...] = ()
    """The random motions of effects that were found before."""
    board_flex: BoardFlex | None = None
    """The effect whose bends the products have; None if the fit has it, or if the board is stiff.
    """
    readouts: Mapping[str, float] = field(default_factory=dict)
    """The duration of the readout of each camera that may have a rolling shutter, over the longest
    one; 1 for all if any is not known.
    """
    bend_sigmas: Array = field(default_factory=lambda: np.zeros(0))
    """(k,) m, the largest plausible standard deviations of these bends."""

    @property
    def count(self) -> int:
        return len(self.products.products)

    def with_own_effects(self) -> RigContext:
        """Return the same with the columns of effects of single cameras and of the board."""
        return replace(self, products=self.wide)

    def of_camera(self, name: str) -> slice:
        """Return the columns of a camera's own motion."""
        start = self.products.motions[name].start
        return slice(start, start + 6)

    def of_board(self, name: str) -> slice:
        """Return the columns of the motion of the board that a camera sees."""
        stop = self.products.motions[name].stop
        return slice(stop - 6, stop)

    def of_readouts(self, names: Iterable[str]) -> NDArray[np.int64]:
        """Return the columns of the motion of the board during the readout of some cameras."""
        return np.concatenate([np.r_[self.products.readouts[name]] for name in names])

    def discrepancy(self, sizes: Array) -> tuple[RandomMotion, ...]:
        """Return the disagreement without a cause, of (2,) sizes in px: of errors of the corners
        without a pattern, and of errors that are nearly the same all over a board.
        """
        used = sizes > DISCREPANCY[0]
        if not used.any():
            return ()
        return tuple(
            RandomMotion(
                self.of_board(name),
                roots(np.einsum("s,spij->pij", np.where(used, sizes, 0.0) ** 2, covariances)),
                adapts=False,
            )
            for name, covariances in self.products.imitations.items()
            if name != self.reference
        )


def roots(covariances: Array) -> Array:
    """Return (P, k, k) L with L L^T the (P, k, k) covariances, which may be singular."""
    values, vectors = np.linalg.eigh(covariances)
    return np.asarray(vectors * np.sqrt(values.clip(0))[:, None, :])


def rig_context(
    rig: Rig, state: RigState, times: Array, accepted: tuple[RandomMotion, ...] = ()
) -> RigContext:
    """Linearise the fit, and estimate the motion of the board."""
    wider = with_own_effects(rig, state)
    wide = MotionProducts.of(wider)
    products = wide.without_own_effects()
    placements = state.placements[:, POSE].numpy()
    inner = products.products[:, products.placement, products.placement]
    covariance = np.linalg.inv(inner)[:, POSE, POSE]
    from_placement = np.linalg.inv(motion_in_placement(placements))
    covariance = from_placement @ covariance @ from_placement.swapaxes(1, 2)
    motion = BoardMotion.of(placements, covariance, times)
    further = tuple(name for name in rig.names if name != rig.reference)
    compared = further if len(rig.names) == 2 else rig.names
    behind_shared = {*rig.covers, *rig.covers.values()}
    is_timed = np.isfinite(times).all()
    order = np.argsort(times, kind="stable") if is_timed else np.argsort(rig.placement_names)
    return RigContext(
        products=products,
        wide=wide,
        compared=compared,
        mounted=tuple(name for name in compared if name not in behind_shared),
        reference=rig.reference,
        order=order.astype(np.int64),
        shared=rig.cameras_seeing > 1,
        motion=motion,
        accepted=accepted,
        board_flex=wider.board_flex,
        readouts=_readouts(rig, state),
        bend_sigmas=_bend_sigmas(wider),
    )


def _readouts(rig: Rig, state: RigState) -> dict[str, float]:
    """Return the readouts of `RigContext`."""
    rolling: list[str] = []
    seconds: list[float] = []
    for camera in state.cameras:
        shutter = rig.calibrations[camera.name].camera.shutter
        if camera.observations.exposure and (not shutter or shutter.rolling):
            rolling.append(camera.name)
            seconds.append((shutter and shutter.readout) or math.nan)
    if np.isnan(seconds).any():
        return dict.fromkeys(rolling, 1.0)
    return {name: s / max(seconds) for name, s in zip(rolling, seconds, strict=True)}


def _bend_sigmas(wider: WideState) -> Array:
    """Return the (k,) m prior standard deviations of the bends that the fit lacks."""
    if not wider.board_flex:
        return np.zeros(0)
    precision = view_precision(wider.state.cameras[0].model.path, wider.state.placements)
    return precision[POSE.stop :].pow(-0.5).numpy()


def times_of(rig: Rig, count: int) -> Array:
    """Return the (P,) s times of the placements; NaN where not recorded."""
    times = [
        np.array([math.nan if view.time_s is None else view.time_s for view in c.views])
        for c in rig.calibrations.values()
    ]
    names = sorted(rig.names, key=lambda name: name != rig.reference)
    by_name = dict(zip(rig.names, times, strict=True))
    return placement_times(
        [rig.of_views[name] for name in names], [by_name[name] for name in names], count
    )
