"""Rao's score test where a fit ended beside its optimum."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from calib.corners.corners_file import write_corners
from calib.effects.lens import LensEffect
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import score_test
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.session import read_session, session_to_yaml
from calib.verdict.case import Case
from calib.verdict.next_commands import NextCommands
from fixtures.synthetic import HEIGHT, WIDTH, bare_views


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> FittedModel:
    """A camera without a cover, whose own coefficients can do all but a thousandth of what the
    effect `lens` does.
    """
    folder: Path = tmp_path_factory.mktemp("bare")
    setup = session_to_yaml(Board(9, 9, 0.020), Camera(WIDTH, HEIGHT), Cover("none", {}))
    (folder / "session.yaml").write_text(
        yaml.safe_dump({"format": 1, **setup, "corners": "corners.vnl"})
    )
    write_corners(folder / "corners.vnl", bare_views(3, 12, 0.02, (-0.1, 0.02)))
    calibration = fit(read_session(folder))
    return Case(calibration, (), NextCommands(folder, folder, Settings()), None, "").optimum


def test_an_unfinished_fit_does_not_favour_an_imitated_effect(
    ended: FittedModel,
) -> None:
    """A tenth of a standard deviation beside the optimum in each parameter of the camera; a score
    of noise alone is about 5.
    """
    at_end = score_test(ended, LensEffect())
    assert at_end.absorbed > 0.99
    assert at_end.chi2 < 20  # of five parameters: beyond it by chance once in a thousand times
    parameters = ended.parameters()
    equations = sum(ended.information())
    sigmas = np.sqrt(np.diag(np.linalg.inv(equations + ended.prior_precision())))
    for entry in range(parameters.count):
        step = torch.zeros(parameters.count, dtype=torch.float64)
        step[entry] = 0.1 * sigmas[entry]
        displaced = replace(ended, joint=replace(ended.joint, values=parameters.values(step)))
        assert score_test(displaced, LensEffect()).chi2 == pytest.approx(at_end.chi2, abs=1.0)
