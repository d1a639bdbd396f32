"""The groups of views that are held out together, also by frames.csv."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.diagnosis.diagnose import diagnose
from calib.estimation.poses import refit_poses
from calib.inference.calibration_model import base_model
from calib.inference.cross_validation import depth_split, fold_split, hold_out
from calib.inference.sign_flip_test import gain_p_value
from calib.progress import Silent
from tests.diagnosis.hide import fitted, hidden

POSES = [0, 0, 0, 1, 1, 2, 3, 4, 5, 5, 6, 7]


def test_all_views_of_a_burst_are_held_out_together() -> None:
    split = fold_split(POSES)
    assert split.group.tolist() == [0, 0, 0, 1, 1, 2, 3, 4, 0, 0, 1, 2]
    assert split.pose.tolist() == POSES


def test_bands_of_depth_are_near_middle_and_far() -> None:
    depths = np.array([0.5, 0.52, 0.51, 1.0, 1.01, 0.7, 0.9, 0.6, 1.2, 1.2, 0.8, 1.1])
    split = depth_split(depths, POSES)
    assert split
    held = [{POSES[view] for view in np.flatnonzero(split.group == band)} for band in range(3)]
    assert held == [{0, 2, 4}, {1, 3, 6}, {5, 7}]
    assert depth_split(np.linspace(0.9, 1.1, 12), POSES) is None


def test_a_part_is_scored_by_a_fit_that_did_not_see_it() -> None:
    """The test refits one part by hand. Its poses are refitted on the board, not in the image."""
    made = fitted(hidden(None, {}, views=10))
    model, observations = base_model(made), made.observations
    joint = model.fit(observations, torch.from_numpy(made.poses))
    held = hold_out(model, observations, joint, fold_split(range(10)))
    out = torch.arange(10) % 5 == 3
    refit = model.fit(observations.without_views(out), joint.poses[~out], joint.start)
    held_out = refit_poses(
        model.path, refit.values, observations.without_views(~out), joint.poses[out]
    )[1]
    scored = held.squares[out[observations.view].numpy()]
    assert np.sqrt(scored.mean()) == pytest.approx(
        held_out.rms_px, rel=0.01
    )  # the two ways to fit a pose weigh corners differently
    assert held.rms > 1.01 * joint.sigma * 2**0.5


@pytest.mark.slow
def test_a_burst_counts_as_one_view() -> None:
    made = fitted(hidden(None, {}, views=10))
    bursts = tuple(replace(view, pose_id=str(index // 2)) for index, view in enumerate(made.views))
    _, finding = diagnose(replace(made, views=bursts), Silent())
    assert finding.remarks[0].startswith("With 5 views nothing can be confirmed")


def test_corners_that_are_hardly_predicted_have_less_weight() -> None:
    """Corners that the folds' fits extrapolate to are off by more than the noise, by as much as
    their weights say.
    """
    made = fitted(hidden(None, {}, seed=3, views=15))
    model, observations = base_model(made), made.observations
    joint = model.fit(observations, torch.from_numpy(made.poses))
    held = hold_out(model, observations, joint, fold_split(range(15)))
    unsure = held.weight < np.quantile(held.weight, 0.2)
    noise = 2 * 0.1**2 * (1 - 6 / (2 * 81))  # each pose takes up six of 162 degrees of freedom
    assert held.weight[unsure].mean() < 0.8 * held.weight[~unsure].mean()
    for group in (unsure, ~unsure):
        weighed = held.squares[group] * held.weight[group]
        assert weighed.mean() == pytest.approx(
            noise, rel=0.3
        )  # what is extrapolated is a few places, whose errors go together


def test_a_gain_in_few_views_has_the_probability_of_their_signs() -> None:
    """Only the views' own signs, one choice of 2^V, have the largest sum, within rounding. The
    error of a view without any scored corner is 0 in both models: it counts for neither.
    """
    base = np.array([1.0, 2.0, 1.5, 0.7, 1.1, 0.3])
    for count in (3, 5, 6):
        p_value = gain_p_value(base[:count], base[:count] / 4)
        assert p_value == pytest.approx(2 / 2**count, rel=0.15)  # of 20,000 draws
        unseen = np.append(base[:count], 0.0)
        assert gain_p_value(unseen, unseen / 4) == pytest.approx(p_value, rel=0.15)
    assert gain_p_value(unseen, unseen) == 1.0
