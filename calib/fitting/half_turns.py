"""Half turns of the board: a board without markers, square or not, looks the same after one.

After half a turn, the bend's terms of odd degree and the print's terms of even degree have the
other sign. A fit averages both, and the rest looks as if the board moved during the readout. These
numbers are asked whether they have two values, beside everything else that may differ from view to
view (calib.inference.view_variation). If nothing is as probable, the corners of the turned views
are renumbered. Two boards look the same up to here. So the views are fitted again, and the
renumbering stays if it is more probable than whatever differs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
import torch
from numpy.typing import NDArray

from calib.corners.view import View, pose_labels
from calib.estimation.observations import Observations
from calib.estimation.poses import refit_poses, rough_poses
from calib.fit_record.request import Settings
from calib.fitting.board_turns import RENUMBERED, turn_back
from calib.fitting.differing import Differing
from calib.fitting.fitted import Fitted
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import FittedModel
from calib.inference.naming import NAME_ALONE
from calib.inference.variation_equations import VariationEquations
from calib.inference.variation_rows import VariationRows
from calib.inference.varying_numbers import turned_board
from calib.inference.view_variation import MIN_GAIN, MIN_VIEWS, largest_gain
from calib.progress import Progress

MAX_ROUNDS = 3
"""The largest number of renumberings. The first one is by a fit that averages both bends, which may
take a view for another.
"""
CLEAR = 2 * math.log(NAME_ALONE / (1 - NAME_ALONE))
"""The fall of a view's squares over the noise variance at which the other numbering is as probable
as a name that stands alone.
"""


@dataclass(frozen=True, slots=True)
class HalfTurned:
    """The views with the corners of turned boards renumbered, and their fit."""

    names: tuple[str, ...]
    """The views with turned boards."""
    views: tuple[View, ...]
    fitted: Fitted

    @staticmethod
    def find(
        fitted: Fitted,
        views: Sequence[View],
        setup: Setup,
        settings: Settings,
        progress: Progress,
    ) -> HalfTurned | None:
        """Return the views and the fit without half turns; None unless views clearly have some.

        Args:
            fitted: the fit of the views, with the bend of its board.
        """
        found: HalfTurned | None = None
        for _ in range(MAX_ROUNDS):
            better = _turned_back(fitted, views, setup, settings, progress)
            if not better:
                break
            names = set(found.names if found else ()) ^ set(better.names)
            views, fitted = better.views, better.fitted
            found = replace(better, names=tuple(v.name for v in views if v.name in names))
        return _with_clear_views(found, setup, settings, progress) if found else None


def _turned_back(
    fitted: Fitted,
    views: Sequence[View],
    setup: Setup,
    settings: Settings,
    progress: Progress,
) -> HalfTurned | None:
    """Return what `HalfTurned.find` does, by the linearisation around this fit alone."""
    as_they_are = _at_optimum(fitted, views, setup)
    if not (as_they_are and settings.estimates_bend):
        return None
    # A part of very many views shows whether any board is turned.
    turned = _most_probable_turns(as_they_are.some_views(), setup)
    if turned.any() and len(turned) < len(views):
        turned = _most_probable_turns(as_they_are, setup)
    if not turned.any():
        return None
    renumbered, refitted = _renumbered(views, turned, setup, settings, progress)
    turned_back = _at_optimum(refitted, renumbered, setup)
    if not turned_back:
        return None
    gain = _log_evidence(refitted, turned_back, setup)
    gain -= _log_evidence(fitted, as_they_are, setup)
    if gain < (len(views) - 1) * math.log(2):  # so many ways to turn the boards
        return None
    names = tuple(compress((view.name for view in views), turned))
    return HalfTurned(names, renumbered, refitted)


def _renumbered(
    views: Sequence[View],
    turned: NDArray[np.bool_],
    setup: Setup,
    settings: Settings,
    progress: Progress,
) -> tuple[tuple[View, ...], Fitted]:
    """Return the views with the corners of those that are turned renumbered, and their fit."""
    renumbered = tuple(
        turn_back(view, setup.board, 2) if is_turned else view
        for view, is_turned in zip(views, turned.tolist(), strict=True)
    )
    observations, labels = Observations.of(renumbered, setup.board), pose_labels(views)
    return renumbered, fit_stages(
        setup, observations, settings, progress, labels=labels, purpose=RENUMBERED
    )


def _with_clear_views(
    found: HalfTurned, setup: Setup, settings: Settings, progress: Progress
) -> HalfTurned:
    """Return the same after renumbering the views that clearly fit better so. The linearisation may
    take a frontal view for turned, as a bend hardly moves corners there.
    """
    fitted, views = found.fitted, found.views
    assert fitted.model
    assert fitted.joint
    path, values, sigma = fitted.model.path, fitted.joint.values, fitted.joint.sigma
    turned = Observations.of([turn_back(view, setup.board, 2) for view in views], setup.board)
    start = rough_poses(path, values, turned)
    _, residual = refit_poses(path, values, turned, start, sigma=sigma)
    change = (residual.image**2 - fitted.residuals.image**2).sum(-1) * turned.weight**2
    gain = torch.zeros(len(views)).double().index_add(0, turned.view, -change) / sigma**2
    clear = (gain > CLEAR).numpy()  # false for a view without a pose
    if not clear.any():
        return found
    renumbered, refitted = _renumbered(views, clear, setup, settings, progress)
    if not _at_optimum(refitted, renumbered, setup):
        return found
    names = set(found.names) ^ set(compress((view.name for view in views), clear))
    return HalfTurned(tuple(v.name for v in views if v.name in names), renumbered, refitted)


def _at_optimum(fitted: Fitted, views: Sequence[View], setup: Setup) -> FittedModel | None:
    """Return a joint fit that converged, with its observations or their averages; None without
    one.
    """
    if not (fitted.model and fitted.joint and fitted.joint.finite):
        return None
    if fitted.on_averages:
        return FittedModel(fitted.model, fitted.on_averages.observations, fitted.joint)
    return FittedModel(fitted.model, Observations.of(views, setup.board), fitted.joint)


def _most_probable_turns(fitted: FittedModel, setup: Setup) -> NDArray[np.bool_]:
    """Return (V,) true for each view in which the board may be turned by half a turn against the
    majority of the views; all false unless that is what most probably differs from view to view.
    """
    still = np.zeros(len(fitted.observations.names), bool)
    if setup.board.coding or not setup.board.has_grid or len(still) < MIN_VIEWS:
        return still
    context = effect_context(fitted, setup.board, setup.camera, locate=False)
    group = turned_board(setup.board)
    equations = VariationEquations.of(VariationRows.of(fitted, context)).group(group)
    if equations.in_two_kinds().gain < MIN_GAIN:
        return still
    differing = Differing.of(fitted, context, about=group)
    if not (differing and differing.named and differing.first.group == group):
        return still
    turned = differing.first.pattern > 0
    return ~turned if 2 * np.count_nonzero(turned) > len(turned) else turned


def _log_evidence(fitted: Fitted, optimum: FittedModel, setup: Setup) -> float:
    """Return the log evidence beside what most probably differs from view to view.

    Args:
        optimum: the same fit with its observations.
    """
    assert fitted.joint
    context = effect_context(optimum, setup.board, setup.camera, locate=False)
    return fitted.joint.log_marginal + max(0.0, largest_gain(optimum, context))
