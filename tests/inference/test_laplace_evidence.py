"""The corners' probability around a fit, for other priors than the fit had, against fits that had
them.
"""

from dataclasses import replace

import numpy as np
import torch

from calib.diagnosis.most_probable_form import with_most_probable
from calib.effects.board_flex import BoardFlex
from calib.estimation.camera_model import CameraModel
from calib.estimation.objective import view_precision
from calib.estimation.priors import Priors
from calib.inference.fitted_model import FittedModel
from calib.inference.laplace_evidence import LaplaceEvidence
from fixtures.synthetic import scene


def test_the_evidence_of_per_view_sizes_agrees_with_fits() -> None:
    """Boards that bend by 0.2 mm in each view, in a curve that is no parabola: every size from one
    fit, and from each of them.
    """
    made = scene(5, views=12, grid=(4, 4), noise=0.1)
    corners, view = made.observations.corners.numpy(), made.observations.view.numpy()
    u = corners / np.abs(corners).max(0)
    bent = np.random.default_rng(2).normal(0, 0.3, (12, 2))[view] * np.cos(2 * u[:, :1])
    observations = replace(
        made.observations, pixels=made.observations.pixels + torch.from_numpy(bent)
    )
    model = CameraModel(made.path, made.values, Priors({"camera.fx": 20.0, "camera.fy": 20.0}))
    flex = BoardFlex(*np.abs(corners).max(0).tolist())
    start = model.fit(observations, made.poses)
    forms = [model.with_effect(form) for form in flex.alternatives()]
    fits = [form.fit(observations, start.poses, start.start, (1e-3, 1e-5)) for form in forms]
    fitted_evidence = np.array([fit.log_marginal for fit in fits])
    assert np.ptp(fitted_evidence) > 20
    for form, fit in zip(forms, fits, strict=True):
        around = LaplaceEvidence.of(FittedModel(form, observations, fit))
        result = np.array(
            [
                around.max_log_evidence(view_precision(candidate.path, fit.poses))
                for candidate in forms
            ]
        )
        assert np.abs(
            (result - result.max()) - (fitted_evidence - fitted_evidence.max())
        ).max() < 0.05 * np.ptp(fitted_evidence)  # a fit chooses the prior of the glass anew
    best, _ = with_most_probable(model, flex, observations, start)
    assert best.effects == forms[int(np.argmax(fitted_evidence))].effects
