"""Groups of numbers that may differ from view to view, and the patterns that they may follow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.effects.board_scale import SHEAR, STRETCH
from calib.effects.effect import EffectContext, EffectParameter
from calib.inference.fitted_model import FittedModel
from calib.optics import rotation
from calib.session.parameter_names import CAMERA, number_of
from calib.session.shapes.registry import find_dimension
from calib.session.tolerances import BOARD_FLEX, FOCAL, PRINCIPAL_POINT, RADIAL

Array = NDArray[np.float64]
WARM_UPS = (1 / 16, 1 / 8, 1 / 4)
"""Time constants of an exponential approach, as fractions of the session."""
MIN_BLOCK = 3
"""The fewest views before and after a step, or of one kind."""


class VariationKind(StrEnum):
    """The way in which numbers differ from view to view."""

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


def groups_of(context: EffectContext) -> tuple[Group, ...]:
    """Return the groups of numbers that may differ from view to view in this session."""
    focal = EffectParameter.of("focal", FOCAL, CAMERA.focal, relative=True)
    centre = tuple(EffectParameter.of(name, PRINCIPAL_POINT, (name,)) for name in CAMERA.centre)
    radial = EffectParameter.of("k1", RADIAL, ("lens.k1",))
    bend = tuple(
        EffectParameter.of(name, BOARD_FLEX, (f"board_shape.{name}",))
        for name in ("xx", "xy", "yy")
    )
    scale = tuple(replace(number, shifts=(number.param.name,)) for number in (STRETCH, SHEAR))
    rolling = not context.path.shutter and (not context.shutter or context.shutter.rolling)
    return (
        Group("focal", (focal,), (VariationKind.EACH, *TIME, *TWO, VariationKind.NEARNESS)),
        Group("principal_point", centre, (VariationKind.EACH, *TIME, *TWO)),
        Group("lens", (focal, *centre, radial), (VariationKind.STEP, *TWO)),
        *_cover_groups(context),
        Group("board_flex", bend, (VariationKind.EACH, *TIME, *TWO, VariationKind.TILT)),
        Group("board_scale", scale, (*TIME, *TWO)),
        *([Group("rolling_shutter", (), (VariationKind.EACH,))] if rolling else []),
    )


def _cover_groups(context: EffectContext) -> Iterator[Group]:
    """Yield a group for each effect on the numbers of the cover."""
    numbers: dict[str, list[EffectParameter]] = {}
    read = (param.name for interface in context.path.cover for param in interface.params)
    for name in dict.fromkeys(read):
        dimension = find_dimension(number_of(name))
        if name in context.values and dimension and dimension.effect and dimension.tolerance:
            number = EffectParameter.of(name, dimension.tolerance, (name,))
            numbers.setdefault(dimension.effect, []).append(number)
    for effect, members in numbers.items():
        moves = effect in ("cover_offset", "cover_tilt")
        yield Group(effect, tuple(members), TIME if moves else (*TIME, *TWO))


def board_patterns(fitted: FittedModel) -> Mapping[VariationKind, Sequence[Array]]:
    """Return the (V,) patterns of these views: the nearness of the boards' middles, and the tilt of
    their normals towards the picture's y and towards its x.
    """
    poses = fitted.joint.poses
    near = 1 / fitted.model.path.distance(poses[:, 3:6]).numpy()
    normals = rotation.matrix(poses[:, :3])[:, :, 2].numpy()
    return {
        VariationKind.NEARNESS: [centred_pattern(near)],
        VariationKind.TILT: [centred_pattern(normals[:, 1]), centred_pattern(normals[:, 0])],
    }


def time_patterns(count: int) -> Mapping[VariationKind, Sequence[Array]]:
    """Return the (V,) patterns that any sequence of so many views may follow."""
    view = np.arange(count)
    steps = range(MIN_BLOCK, count - MIN_BLOCK + 1)
    return {
        VariationKind.DRIFT: [centred_pattern(view)],
        VariationKind.WARM_UP: [
            centred_pattern(np.exp(-view / (fraction * count))) for fraction in WARM_UPS
        ],
        VariationKind.STEP: [centred_pattern(view >= first) for first in steps],
        VariationKind.ALTERNATING: [centred_pattern(view % 2)],
    }


def centred_pattern(pattern: NDArray[np.float64] | NDArray[np.int64] | NDArray[np.bool_]) -> Array:
    """Return (V,) the pattern about its mean, with standard deviation 1."""
    deviation = pattern.astype(np.float64) - pattern.mean()
    return np.asarray(deviation / max(float(deviation.std()), 1e-300))
