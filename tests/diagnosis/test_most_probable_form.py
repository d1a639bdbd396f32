"""The choice of an effect's form: one fit gives the evidence of all forms, as their fits would."""

import pytest
import torch

from calib.diagnosis.most_probable_form import with_most_probable
from calib.effects.board_shape import BoardShape
from calib.inference.calibration_model import full_model
from calib.inference.savage_dickey import savage_dickey_log_odds
from tests.diagnosis.hide import without_cover


@pytest.mark.parametrize(("third", "degree"), [(0.0, 2), (5e-5, 3)])
def test_one_fit_gives_the_evidence_of_the_smaller_forms(third: float, degree: int) -> None:
    """Against the evidence of fits of their own: to a unit of the logarithm or a fifth of it, as
    these estimate the noise anew.
    """
    hidden = BoardShape(0.08, 0.08, 3)
    sizes = {unknown.param.name: 0.0 for unknown in hidden.effect_parameters} | {
        "board_shape.xx": 5e-4,
        "board_shape.xxy": third,
    }
    calibration = without_cover(hidden, sizes, 0.1)
    observations, model = calibration.observations, full_model(calibration)
    start = model.fit(observations, torch.from_numpy(calibration.poses))
    forms = [model.with_effect(form) for form in hidden.alternatives()]
    fits = [form.fit(observations, start.poses, start.start, (1e-3, 1e-4, 1e-6)) for form in forms]
    for form, fit in zip(forms, fits, strict=True):
        assert savage_dickey_log_odds(form, forms[-1], fits[-1]) == pytest.approx(
            fit.log_evidence - fits[-1].log_evidence, abs=1.0, rel=0.2
        )
    chosen, joint = with_most_probable(model, hidden, observations, start)
    assert chosen.effects[-1] == BoardShape(0.08, 0.08, degree)
    assert joint.log_evidence == pytest.approx(max(fit.log_evidence for fit in fits), abs=0.1)
