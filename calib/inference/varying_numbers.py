"""Groups of numbers that may differ from view to view, and the patterns that they may follow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.effects.board_flex import BoardFlex
from calib.effects.board_scale import DEGREES as PRINT_DEGREES
from calib.effects.board_scale import SHEAR, STRETCH, BoardScale
from calib.effects.board_shape import DEGREES as BEND_DEGREES
from calib.effects.board_shape import BoardShape
from calib.effects.effect import EACH_VIEW, EffectContext, EffectParameter
from calib.effects.lens import UNKNOWNS as BROWN_TERMS
from calib.effects.refractive_index import RefractiveIndex
from calib.effects.varying import (
    ALTERNATING,
    FOCAL_LENGTH,
    FROM_VIEW,
    RADIAL_CHANGE,
    WITH_NEARNESS,
    WITH_TILT,
    WITH_TIME,
    varying_number,
)
from calib.inference.fitted_model import FittedModel
from calib.optics import rotation
from calib.optics.board_polynomials import Term, bend_sigma, term_name, terms_of_degrees
from calib.session.board import Board
from calib.session.parameter_names import CAMERA, COVER, number_of
from calib.session.shapes.registry import find_dimension
from calib.session.tolerances import BOARD_FLEX

Array = NDArray[np.float64]
WARM_UPS = (1 / 16, 1 / 8, 1 / 4)
"""Time constants of an exponential approach, as fractions of the session."""
MIN_BLOCK = 3
"""The fewest views before and after a step, or of one kind."""


DISTORTION = "distortion"
"""The name of a group that stands for the picture: it differs in some views, mostly at its edge,
for no known cause.
"""
STRUCTURE = "structure"
"""The name of a group that stands for the board in each view: its corners are displaced smoothly,
for no known cause (`calib.inference.model_discrepancy`).
"""
NAMELESS = (DISTORTION, STRUCTURE)


class VariationKind(StrEnum):
    """The pattern of numbers that differ from view to view."""

    EACH = "each view"
    """Every view has its own."""
    DRIFT = "drift"
    """An even change with time."""
    WARM_UP = "warm-up"
    """A change that settles in the first views."""
    STEP = "step"
    """A change at one view."""
    ALTERNATING = "alternating"
    TWO_KINDS = "two kinds"
    """Some views have these, and some have those."""
    NEARNESS = "nearness"
    """A change with the nearness of the board."""
    TILT = "tilt"
    """A change with the tilt of the board."""

    @property
    def varies(self) -> str:
        """The word of the command contract."""
        return VARIES[self]


VARIES: Mapping[VariationKind, str] = {
    VariationKind.EACH: EACH_VIEW,
    VariationKind.DRIFT: WITH_TIME,
    VariationKind.WARM_UP: WITH_TIME,
    VariationKind.STEP: FROM_VIEW,
    VariationKind.ALTERNATING: ALTERNATING,
    VariationKind.TWO_KINDS: ALTERNATING,
    VariationKind.NEARNESS: WITH_NEARNESS,
    VariationKind.TILT: WITH_TILT,
}
TIME = (VariationKind.DRIFT, VariationKind.WARM_UP, VariationKind.STEP)
TWO = (VariationKind.ALTERNATING, VariationKind.TWO_KINDS)


@dataclass(frozen=True, slots=True)
class Group:
    """Numbers that differ together."""

    name: str
    numbers: tuple[EffectParameter, ...]
    """Each with the values that it is added to, and its tolerance; none for the board's motion."""
    kinds: tuple[VariationKind, ...]
    """The ways in which they can differ."""

    @property
    def number_names(self) -> tuple[str, ...]:
        """The names of the numbers."""
        return tuple(number.param.name for number in self.numbers)

    @property
    def is_medium(self) -> bool:
        """True if the views are in air and in water."""
        return self.number_names == (COVER.outside_index,)

    @property
    def has_cause(self) -> bool:
        """True if a known cause changes its numbers."""
        return self.name not in NAMELESS

    def may_vary(self, varies: str) -> bool:
        """Return True if its numbers can differ in this way and be in a model so (`Varying`)."""
        excluded = self.name in (BoardFlex.name, BoardScale.name) or not self.has_cause
        return not excluded and any(kind.varies == varies for kind in self.kinds)

    def without_each(self) -> Group:
        """Return the group whose numbers follow a pattern, if they differ."""
        kinds = tuple(kind for kind in self.kinds if kind is not VariationKind.EACH)
        return replace(self, kinds=kinds)


def groups_of(context: EffectContext) -> tuple[Group, ...]:
    """Return the groups of numbers that may differ from view to view in this session."""
    focal = varying_number(FOCAL_LENGTH)
    centre = tuple(map(varying_number, CAMERA.centre))
    radial = replace(varying_number(RADIAL_CHANGE), shifts=(RADIAL_CHANGE,))
    bends = tuple(map(_bend, terms_of_degrees(BEND_DEGREES)))
    first_bends = tuple(map(_bend, terms_of_degrees(BEND_DEGREES[:1])))
    scale = tuple(replace(number, shifts=(number.param.name,)) for number in (STRETCH, SHEAR))
    brown = tuple(replace(number, shifts=(number.param.name,)) for number in BROWN_TERMS)
    groups = [
        Group(BoardFlex.name, bends, (VariationKind.EACH,)),
        Group(BoardFlex.name, first_bends, (*TIME, *TWO, VariationKind.TILT)),
        *([] if context.board.coding else [turned_board(context.board)]),
        Group("board_scale", scale, (*TIME, *TWO)),
    ]
    rolling = not context.path.shutter and (not context.shutter or context.shutter.rolling)
    return (
        Group("focal", (focal,), (VariationKind.EACH, *TIME, *TWO, VariationKind.NEARNESS)),
        Group("principal_point", centre, (VariationKind.EACH, *TIME, *TWO, VariationKind.NEARNESS)),
        Group("lens", (focal, *centre, radial), (VariationKind.STEP, *TWO, VariationKind.NEARNESS)),
        *_cover_groups(context),
        *(groups if context.board.is_flat else []),
        *([Group("rolling_shutter", (), (VariationKind.EACH,))] if rolling else []),
        Group(DISTORTION, brown, (VariationKind.EACH, *TIME, VariationKind.NEARNESS)),
    )


def _bend(term: Term) -> EffectParameter:
    """Return the deviation of a term of the board's bend from that of the other views."""
    name = term_name(term)
    number = EffectParameter.of(name, BOARD_FLEX, (f"{BoardShape.name}.{name}",))
    return replace(number, sigma=bend_sigma(BOARD_FLEX.sigma, term))


def turned_board(board: Board) -> Group:
    """Return the numbers that are the other way round on a board that was turned by half a turn:
    the terms of its bend of an odd degree, and those of its print of an even one.
    """
    bend = BoardShape(*board.half, BEND_DEGREES[1])
    uneven = BoardScale(True, PRINT_DEGREES[0], board.half)
    names = {
        *(f"{bend.name}.{term_name(term)}" for term in terms_of_degrees(BEND_DEGREES[1:2])),
        *(
            f"{uneven.name}.{axis}.{term_name(term)}"
            for axis in "xy"
            for term in terms_of_degrees(PRINT_DEGREES[:1])
        ),
    }
    numbers = tuple(
        replace(number, shifts=(number.param.name,))
        for number in (*bend.effect_parameters, *uneven.effect_parameters)
        if number.param.name in names
    )
    return Group(BoardFlex.name, numbers, TWO)


def _cover_groups(context: EffectContext) -> Iterator[Group]:
    """Yield a group for each effect on the numbers of the cover."""
    numbers: dict[str, list[EffectParameter]] = {}
    read = (param.name for interface in context.path.cover for param in interface.params)
    for name in dict.fromkeys(read):
        dimension = find_dimension(number_of(name))
        if name in context.values and dimension and dimension.effect and dimension.tolerance:
            numbers.setdefault(dimension.effect, []).append(varying_number(name))
    for effect, members in numbers.items():
        moves = effect in ("cover_offset", "cover_tilt")
        yield Group(effect, tuple(members), TIME if moves else (*TIME, *TWO))
    if COVER.outside_index in context.values:
        medium = (varying_number(COVER.outside_index),)
        yield Group(RefractiveIndex.name, medium, (VariationKind.STEP, *TWO))


def patterns_of(fitted: FittedModel) -> Mapping[VariationKind, Sequence[Array]]:
    """Return the (V,) patterns that numbers of these views may follow: those of time, the nearness
    of the boards' middles, and the tilt of their normals towards the picture's y and towards its x.
    """
    poses, observations = fitted.joint.poses, fitted.observations
    count = len(observations.names)
    times = np.linspace(0.0, 1.0, count)
    if observations.exposure and count > 1:
        times = observations.exposure.time[observations.starts[:-1]].numpy() + 0.5
    near = 1 / fitted.model.path.distance(poses[:, 3:6]).numpy()
    normals = rotation.matrix(poses[:, :3])[:, :, 2].numpy()
    return {
        **time_patterns(times),
        VariationKind.NEARNESS: [centred_pattern(near)],
        VariationKind.TILT: [centred_pattern(normals[:, 1]), centred_pattern(normals[:, 0])],
    }


def time_patterns(times: Array) -> Mapping[VariationKind, Sequence[Array]]:
    """Return the (V,) patterns that views of these (V,) times may follow, from 0 for the first to 1
    for the last.
    """
    order = times.argsort(kind="stable").argsort()
    steps = range(MIN_BLOCK, len(times) - MIN_BLOCK + 1)
    return {
        VariationKind.DRIFT: [centred_pattern(times)],
        VariationKind.WARM_UP: [centred_pattern(np.exp(-times / part)) for part in WARM_UPS],
        VariationKind.STEP: [centred_pattern(order >= first) for first in steps],
        VariationKind.ALTERNATING: [centred_pattern(order % 2)],
    }


def first_after_step(pattern: Sequence[float] | Array) -> int:
    """Return the index of the view after the largest change of a (V,) pattern."""
    return int(np.abs(np.diff(pattern)).argmax()) + 1


def centred_pattern(pattern: NDArray[np.float64] | NDArray[np.int64] | NDArray[np.bool_]) -> Array:
    """Return (..., V) patterns, each about its mean and with standard deviation 1."""
    deviation = pattern.astype(np.float64) - pattern.mean(-1, keepdims=True)
    return np.asarray(deviation / np.maximum(deviation.std(-1, keepdims=True), 1e-300))
