"""The remarks about effects that were requested while a window was in the model, which was dropped
later.
"""

from dataclasses import replace

import numpy as np
import torch

from calib.diagnosis.effect_description import largest_views
from calib.diagnosis.search_state import SearchProblem, SearchState
from calib.diagnosis.sentences import remarks
from calib.diagnosis.trial import Trial
from calib.effects.cover_tilt import CoverTilt
from calib.effects.detector_bias import DetectorBias
from calib.effects.effect import Effect, EffectContext, PlaceOnGlass, is_possible
from calib.effects.flat_port import FlatPort
from calib.effects.free_field import FreeField
from calib.effects.registry import KINDS
from calib.inference.calibration_model import base_model
from calib.inference.cross_validation import fold_split
from calib.inference.fitted_model import ModelFit
from calib.inference.score_test import ScoreTest
from calib.optics.lens_model import LensModel
from calib.optics.path import Path
from tests.diagnosis.hide import without_cover

TILT = CoverTilt("xy")


def state_without_window() -> SearchState:
    made = without_cover(DetectorBias(), {"detector_bias.x": 0.0, "detector_bias.y": 0.0}, 0.1)
    base = base_model(made)
    context = EffectContext(
        made.board, made.camera.width, made.camera.height, base.path, base.means
    )
    model = base.with_effects([DetectorBias(), *FreeField.propose(context)])
    observations = made.observations
    joint = model.fit(observations, torch.from_numpy(made.poses))
    problem = SearchProblem(
        board=made.board,
        camera=made.camera,
        observations=observations,
        folds=fold_split(range(20)),
        depth_bands=None,
        base=base,
        free_base=None,
        report=lambda _: None,
        has_structure=lambda _: False,
    )
    scored = ScoreTest(
        TILT, np.ones((4, 2)), 8.0, 50.0, 2, lambda: 1e-6, 100.0, np.eye(2), np.ones(2)
    )
    state = SearchState.begin(problem, ModelFit(model, joint)).with_trial(Trial(scored))
    return replace(state, confounded={"detector_bias": frozenset({"cover_tilt"})})


def test_effects_on_a_dropped_window_cause_no_remark() -> None:
    """Nothing reads the parameters of such an effect: the information on them has fewer rows than
    their prior, and no sentence can be true.
    """
    sentences = tuple(remarks(state_without_window(), (), (), (), timed=True))
    assert len(sentences) == 1
    assert sentences[0].startswith("free_field has no name")
    assert "cover_tilt" not in sentences[0]


def test_without_the_window_its_effects_are_dropped_as_well() -> None:
    base = state_without_window().problem.base
    assert [e.name for e in base.with_effects([FlatPort("air"), TILT]).effects] == [
        "flat_port",
        "cover_tilt",
    ]
    assert base.with_effects([TILT]).effects == ()


def test_effects_on_a_cover_are_proposed_for_covers_alone() -> None:
    made = without_cover(DetectorBias(), {"detector_bias.x": 0.0, "detector_bias.y": 0.0}, 0.1)
    without = Path(LensModel(0))
    context = EffectContext(
        made.board, 1640, 1232, without, {}, place=PlaceOnGlass((0.0, 0.0), (1.0, 1.0), 1e-3)
    )
    on_cover: list[type[Effect]] = [kind for kind in KINDS if not is_possible(kind, without)]
    assert len(on_cover) == 8
    assert not [kind.name for kind in on_cover if kind.propose(context)]


def test_views_whose_boards_moved_most_are_named() -> None:
    """Thirty views of alike motions name none, as the largest of normal numbers is no cause."""
    names = [f"{index:02}.png" for index in range(30)]
    sizes = np.random.default_rng(0).normal(0, 1e-3, (30, 6))
    assert not largest_views(names, sizes)
    sizes[7], sizes[20] = 6e-3, -4e-3
    parts = (sizes**2).sum(1) / (sizes**2).sum()
    assert largest_views(names, sizes) == (
        f", most in 07.png ({100 * parts[7]:.0f} %), 20.png ({100 * parts[20]:.0f} %)"
    )
    assert not largest_views(names, np.zeros((30, 6)))
