"""Numbers that the views contradict."""

from dataclasses import replace

import pytest

from calib.fit_record.request import Settings
from calib.fitting.stages import Setup
from calib.session.schema import Number
from fixtures.calibrated import CAMERA, tolerant
from fixtures.synthetic import INTRINSICS, Scene, scene


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(3, views=20, noise=0.02)


def test_a_wrongly_declared_number_is_found(made: Scene) -> None:
    wrong = replace(made.cover, parameters={**made.cover.parameters, "thickness": Number(0.006)})
    resolved = tolerant(made, Setup(made.board, CAMERA, INTRINSICS, wrong), Settings(grid=(6, 6)))
    assert resolved.declared.doubted == ("cover.thickness",)
    assert resolved.declared.cover.parameters["thickness"] == Number(0.006, 5e-4), (
        "what was declared is kept"
    )
    estimate = resolved.cover.parameters["thickness"]
    assert abs(estimate.value - 0.003) < 3 * estimate.sigma
    assert estimate.sigma < 5e-4, "it is the views that tell"


def test_true_numbers_do_not_conflict(made: Scene) -> None:
    resolved = tolerant(
        made, Setup(made.board, CAMERA, INTRINSICS, made.cover), Settings(grid=(6, 6))
    )
    assert resolved.declared.doubted == ()
    for name, number in resolved.cover.parameters.items():
        assert abs(number.value - made.cover.parameters[name].value) <= 3.5 * number.sigma, name
