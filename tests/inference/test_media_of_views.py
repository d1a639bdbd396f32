"""Sessions with some pictures in air and the others in water."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.diagnosis.diagnose import diagnose
from calib.effects.varying import Varying
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.inference.fitted_model import FittedModel
from calib.inference.media_of_views import LIKELY, fit_of_two_media, views_in_other_medium
from calib.progress import Silent
from calib.session.parameter_names import COVER
from calib.verdict.case import optimum_of
from calib.verdict.judge import judge
from fixtures.calibrated import CAMERA, calibrated
from fixtures.map_errors import error_over_sigma
from fixtures.synthetic import COVERS, INTRINSICS, WATER, Scene, misdeclared, scene
from fixtures.view_variation import Cause, Pattern

MIN_CORNERS = 20
"""Corners of a view that leaves the picture in the other medium."""
STEP = WATER - 1.0
"""The index of water over that of air."""


def session(
    cover_name: str, is_other: NDArray[np.bool_], seed: int, index: float
) -> tuple[Scene, Setup]:
    """Return a scene in the medium of this index, with some views in the other medium, and its
    setup with errors of the tolerances.
    """
    cover, amplitude = COVERS[cover_name]
    assert cover.medium
    cover = cover.replace_medium(replace(cover.medium, value=index), None)
    made = scene(
        seed, len(is_other), amplitude=amplitude, noise=0.1, depths=(0.4, 1.2), cover=cover
    )
    step = STEP if index == 1 else -STEP
    cause = Cause("medium", Pattern.SOME, {COVER.outside_index: 1.0}, "refractive_index")
    made = cause.applied(made, np.where(is_other, step, 0.0)[:, None])
    declared = misdeclared(np.random.default_rng([seed, 2]), INTRINSICS, cover)
    return made, Setup(made.board, CAMERA, *declared)


def fitted(
    cover_name: str, is_other: NDArray[np.bool_], seed: int, index: float = WATER
) -> tuple[Scene, Calibration]:
    made, setup = session(cover_name, is_other, seed, index)
    made = replace(made, views=tuple(v for v in made.views if v.seen.sum() >= MIN_CORNERS))
    return made, calibrated(made, setup, Settings())


@cache
def behind_a_window(in_air: int) -> Calibration:
    """Return a calibration of 12 views through a flat port in water, the first ones in air."""
    return fitted("wet-flat", np.arange(12) < in_air, 3)[1]


def in_air(calibration: Calibration) -> NDArray[np.bool_]:
    """Return which views of `behind_a_window(5)` were in air."""
    return np.array([int(Path(view.name).stem) < 5 for view in calibration.views])


def test_views_show_which_medium_they_were_taken_in() -> None:
    calibration = behind_a_window(5)
    is_other = views_in_other_medium(optimum_of(calibration), LIKELY)
    assert is_other is not None
    assert (is_other == in_air(calibration)).mean() > 0.8


def test_a_fit_of_two_media_divides_the_views() -> None:
    calibration = behind_a_window(5)
    fit = fit_of_two_media(optimum_of(calibration))
    assert fit
    effect = fit.model.effects[-1]
    assert isinstance(effect, Varying)
    assert effect.is_medium
    assert effect.varies == "from_view"
    assert np.array_equal(-np.array(effect.pattern), in_air(calibration))
    step = float(fit.joint.values[effect.params[0].name])
    assert step == pytest.approx(STEP, abs=0.003)


def test_a_division_is_tried_either_way_round() -> None:
    calibration = behind_a_window(5)
    for division in (in_air(calibration), ~in_air(calibration)):
        fit = fit_of_two_media(optimum_of(calibration), [division])
        assert fit
        assert np.array_equal(-np.array(fit.model.effects[-1].pattern), in_air(calibration))  # type: ignore[attr-defined]


def test_views_in_one_medium_are_not_divided() -> None:
    assert fit_of_two_media(optimum_of(behind_a_window(0))) is None


def test_a_model_of_two_media_is_not_divided_again() -> None:
    optimum = optimum_of(behind_a_window(5))
    fit = fit_of_two_media(optimum)
    assert fit
    divided = FittedModel(fit.model, optimum.observations, fit.joint)
    assert fit_of_two_media(divided) is None
    assert views_in_other_medium(divided) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cover_name", "index", "share", "step"),
    [
        ("thin-cone", WATER, 0.5, False),
        ("thin-cone", 1.0, 0.3, True),
        ("dome", WATER, 0.4, False),
        ("wet-flat", 1.0, 0.4, True),
    ],
)
def test_a_session_in_two_media_has_maps_of_the_stated_one(
    cover_name: str, index: float, share: float, step: bool
) -> None:
    is_other = np.arange(24) < round(24 * share)
    if not step:
        is_other = np.random.default_rng(1).permutation(is_other)
    made, calibration = fitted(cover_name, is_other, 5, index)
    extended, diagnosis = diagnose(calibration, Silent())
    assert diagnosis.accepted == ("refractive_index",)
    effect = extended.effects[0].effect
    assert isinstance(effect, Varying)
    numbers = [int(Path(view.name).stem) for view in extended.views]
    assert np.array_equal(np.array(effect.pattern) != 0, is_other[numbers])
    assert error_over_sigma(made, extended) < 2.5
    medium, stated = ("air", "water") if index > 1 else ("water", "air")
    words = f"taken in {medium}, the other pictures in {stated}. The maps are for {stated}."
    assert any(note.endswith(words) for note in judge(extended).notes)
