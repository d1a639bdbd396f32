"""The choice of the shape of a cover that nobody knows, by marginal likelihood."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from calib.corners.view import View, pose_labels
from calib.effects.board_shape import DEGREES, BoardShape
from calib.errors import NotEnoughDataError
from calib.estimation.joint_fit import ROUNDS
from calib.estimation.observations import Observations
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting.stages import Fitted, Setup, fit_stages
from calib.fitting.unknown_numbers import with_initial_values
from calib.progress import Progress
from calib.session.freeing import ALL, AUTO, free_parameters
from calib.session.shapes.registry import shape_names
from calib.threads import single_thread


@dataclass(frozen=True, slots=True)
class ShapeChoice:
    """The most probable shape."""

    setup: Setup
    """The setup with a cover of this shape."""
    log_odds: Mapping[str, float]
    """The logarithm of the odds of each shape against the most probable one: 0 for this one. A
    shape that cannot be fitted has none.
    """


def choose_shape(
    setup: Setup, views: Sequence[View], settings: Settings, progress: Progress
) -> ShapeChoice:
    """Return the most probable shape of the cover, each fitted to the same corners with even glass.
    The board may be bent. Every shape has the same tolerances of the intrinsics.

    Raises:
        NotEnoughDataError: no shape can be fitted.
        InputError: the settings name a number that a cover of unknown shape lacks.
    """
    free = (ALL,) if AUTO in settings.free else settings.free
    intrinsics, _ = free_parameters(setup.intrinsics, setup.cover, free)
    settings = replace(settings, free=free, grid=EVEN_GRID, flat_board=True)
    setups: dict[str, Setup] = {}
    evidence: dict[str, float] = {}
    for name in shape_names():
        declared = setup.intrinsics if setup.cover.as_shape(name).parameters else intrinsics
        candidate = replace(setup, intrinsics=declared, cover=setup.cover.as_shape(name))
        with single_thread():
            candidate = with_initial_values(candidate, views, progress)
            log_marginal = _log_marginal(candidate, views, settings, progress, name)
        if log_marginal is not None:
            setups[name] = candidate
            evidence[name] = log_marginal
    if not evidence:
        raise NotEnoughDataError(
            "No shape of cover explains these views: check board.square_mm, and take more pictures"
            " of the board, tilted and at several distances."
        )
    best = max(evidence, key=evidence.__getitem__)
    return ShapeChoice(
        setups[best], {name: value - evidence[best] for name, value in evidence.items()}
    )


def _log_marginal(
    setup: Setup, views: Sequence[View], settings: Settings, progress: Progress, name: str
) -> float | None:
    """Return the logarithm of the marginal likelihood, of a bent board if that is more probable;
    None if there is no fit.
    """
    observations = Observations.of(views, setup.board)
    try:
        fitted = fit_stages(
            setup.with_tolerances(settings),
            observations,
            settings,
            progress,
            labels=pose_labels(views),
            purpose=f"shape {name}",
        )
    except NotEnoughDataError:
        return None
    if not (fitted.joint and fitted.joint.finite):
        return None
    return max(fitted.joint.log_marginal, _bent(fitted, setup, observations))


def _bent(fitted: Fitted, setup: Setup, observations: Observations) -> float:
    """Return the logarithm of the marginal likelihood with a bent board."""
    joint, model = fitted.joint, fitted.model
    assert joint
    assert model
    bent = model.with_effect(BoardShape(*setup.board.half, DEGREES[-1]))
    return bent.fit(observations, joint.poses, joint.start, ROUNDS).log_marginal
