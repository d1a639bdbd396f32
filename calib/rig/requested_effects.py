"""Effects that the user requests by name for a rig: they are added without a held-out test.

An effect of a camera is added to each camera that can have it, in the camera's own fit, and the
joint fit estimates its numbers again. An effect of the board has the same numbers for all cameras.
A bend of the board in each placement belongs to the placement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from calib.calibration import Calibration
from calib.diagnosis.possible_effects import check_possible
from calib.diagnosis.requested_effects import with_requested
from calib.effects.board_flex import BoardFlex
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.effect import Effect
from calib.effects.registry import KINDS
from calib.effects.rolling_shutter import RollingShutter
from calib.effects.screen_glass import ScreenGlass
from calib.effects.view_effect import ViewEffect
from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.progress import Progress
from calib.session.session import Session


def requested_by_camera(
    sessions: Mapping[str, Session],
    covers: Mapping[str, str],
    settings: Settings,
    names: Sequence[str],
) -> dict[str, tuple[str, ...]]:
    """Return which of the requested effects each camera of a rig can have.

    Args:
        sessions: of the cameras, with the covers of their fits.
        covers: the first camera behind the same cover, by the name of each further one.
        settings: of the cameras' fits.
        names: of the effects.

    Raises:
        InputError: no camera can have one of the effects, or the joint fit has no numbers for it.
    """
    kinds = {kind.name: kind for kind in KINDS}
    for name in names:
        if name == RollingShutter.name:
            raise InputError(
                f"--effects {name}: the fit of a rig has no numbers for {name}: leave it out, or"
                " add it to one camera by calib fit."
            )
        if kinds[name].on_cover and covers:
            raise InputError(
                f"--effects {name}: the fit of a rig has no numbers for {name} of a shared cover:"
                " leave it out."
            )
    possible: dict[str, tuple[str, ...]] = dict.fromkeys(sessions, ())
    for name in names:
        refusals = []
        for camera, session in sessions.items():
            try:
                check_possible(session, settings, (*possible[camera], name))
            except InputError as error:
                refusals.append(InputError(f"{camera}: {error}"))
            else:
                possible[camera] = (*possible[camera], name)
        if len(refusals) == len(sessions):
            raise refusals[0]
    return possible


def with_requested_effects(
    camera: str, calibration: Calibration, names: Sequence[str], progress: Progress
) -> Calibration:
    """Return the calibration of one camera of a rig, fitted again with these effects.

    Raises:
        InputError: the camera cannot have one of them.
    """
    if not names:
        return calibration
    try:
        return with_requested(calibration, names, progress)
    except InputError as error:
        raise InputError(f"{camera}: {error}") from None


def is_of_board(effect: Effect) -> bool:
    """Return True for an effect that is the same for all cameras, which see one board."""
    return isinstance(effect, BoardShape | BoardScale | BoardFlex | ScreenGlass)


def richer(effect: Effect, other: Effect) -> bool:
    """Return True if an effect has more numbers than another form of it, or a wider prior."""
    return _richness(effect) > _richness(other)


def _richness(effect: Effect) -> tuple[int, float]:
    size = effect.size if isinstance(effect, ViewEffect) else 0.0
    return len(effect.effect_parameters), size
