"""The declared numbers beside the estimates: increments of effects as values, every figure to the
second digit of its sigma.
"""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.calibration_content import AddedEffect, Stage
from calib.commands.console import print_fit
from calib.diagnosis.effect_description import describe_estimates
from calib.effects.board_shape import BoardShape
from calib.effects.cover_radius import CoverRadius
from calib.effects.effect import Effect
from calib.effects.focal import Focal
from calib.effects.lens import LensEffect
from calib.effects.thickness import Thickness
from calib.fit_record.history import AcceptedEffect, DiagnosisRecord, EffectEstimate, History
from calib.fitting import fit_result
from calib.fitting.declared import comparisons, effect_comparisons
from calib.fitting.setup import Setup
from calib.inference.fitted_model import FittedModel
from calib.report.effects import effect_rows
from calib.rounding import two_digits, with_sigma
from fixtures.calibrated import CAMERA, tolerant
from fixtures.known import known
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, scene


def with_effect(
    calibration: Calibration, effect: Effect, **figures: tuple[float, float]
) -> Calibration:
    numbers = {
        f"{effect.name}.{name}": (np.array(value), np.array(sigma))
        for name, (value, sigma) in figures.items()
    }
    return replace(
        calibration, effects=(AddedEffect(effect, numbers),), covariance=np.eye(len(figures))
    )


@pytest.fixture(scope="module")
def plain() -> Calibration:
    """A cone with 3 mm of glass of index 1.5 and 41.95 mm of radius, all held."""
    return known(scene(1, views=1), WIDTH, HEIGHT)


@pytest.mark.parametrize(
    ("value", "sigma", "message"),
    [
        (1.00234, 0.00331, "1.0023 ± 0.0033"),
        (2.953, 0.0561, "2.953 ± 0.056"),
        (2.953, 0.0996, "2.95 ± 0.10"),
        (-0.0004, 0.12, "0.00 ± 0.12"),
        (2558.361, 1.449, "2558.4 ± 1.4"),
        (2558.361, 144.9, "2560 ± 140"),
        (1.5, 0.0, "1.5"),
        (1.5, math.nan, "1.5"),
    ],
)
def test_value_and_sigma_have_the_digits_that_sigma_determines(
    value: float, sigma: float, message: str
) -> None:
    assert with_sigma(value, sigma) == message


@pytest.mark.parametrize(
    ("value", "message"),
    [(0.0057, "0.0057"), (0.01, "0.010"), (0.0996, "0.10"), (1.0, "1.0"), (213.0, "210")],
)
def test_a_sigma_by_itself_has_two_digits_and_no_exponent(value: float, message: str) -> None:
    assert two_digits(value) == message


def test_a_declared_number_has_the_digits_of_its_tolerance(plain: Calibration) -> None:
    free = with_effect(plain, Thickness(("cover.thickness",)), thickness=(-0.0015, 0.000056))
    item = {row.name: row for row in comparisons(free)}["cover.thickness"]
    assert item.stated == "3.00 ± 0.50 mm"


def test_an_increment_is_shown_as_the_value_that_it_makes(plain: Calibration) -> None:
    diagnosed = with_effect(plain, Thickness(("cover.thickness",)), thickness=(-0.0015, 0.000056))
    item = {row.name: row for row in comparisons(diagnosed)}["cover.thickness"]
    assert (item.declared, item.estimate) == pytest.approx((3.0, 1.5))
    assert (item.tolerance, item.sigma) == pytest.approx((0.5, 0.056))
    assert item.normalised_deviation == pytest.approx(1.5 / math.sqrt(0.5**2 - 0.056**2))
    assert item.summed == "cover.thickness 1.500 mm = 3 declared - 1.500 ± 0.056"
    assert list(effect_comparisons(diagnosed)) == []
    assert [row for row in comparisons(diagnosed) if row.effect] == [item]


def test_a_fraction_of_a_declared_number_is_an_increment_of_each(plain: Calibration) -> None:
    rows = [
        row
        for row in comparisons(with_effect(plain, Focal(), change=(0.01, 0.001)))
        if row.effect == "focal"
    ]
    assert [row.name for row in rows] == ["camera.fx", "camera.fy"]
    for row in rows:
        assert (row.estimate, row.sigma) == pytest.approx(
            (1.01 * row.declared, 0.001 * row.declared)
        )


def test_parameters_that_no_session_declares_have_rows_of_their_own(plain: Calibration) -> None:
    """Brown's terms of the effect act before the lens and the other way: they are no increment of
    OpenCV's coefficients.
    """
    bent = with_effect(
        plain, BoardShape(0.08, 0.08), xx=(1.0023e-3, 3.3e-6), xy=(2e-4, 3e-6), yy=(-0.6e-3, 3e-6)
    )
    assert [(row.name, row.estimated) for row in effect_comparisons(bent)] == [
        ("board_shape.xx", "1.0023 ± 0.0033 mm"),
        ("board_shape.xy", "0.2000 ± 0.0030 mm"),
        ("board_shape.yy", "-0.6000 ± 0.0030 mm"),
    ]
    assert not [row for row in comparisons(bent) if row.effect]
    lens = with_effect(
        plain, LensEffect(), **dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), (0.01, 0.001))
    )
    assert [row.name for row in effect_comparisons(lens)] == [
        "lens.k1",
        "lens.k2",
        "lens.k3",
        "lens.p1",
        "lens.p2",
    ]


def test_the_slope_of_a_cylinder_is_not_a_declared_number(plain: Calibration) -> None:
    parameters = {
        name: number for name, number in plain.cover.parameters.items() if name != "radius_slope"
    }
    tube = replace(
        plain, cover=replace(plain.cover, shape="cylinder", parameters=parameters), stated=None
    )
    effect_of_both = CoverRadius(("cover.inner_radius", "cover.radius_slope"))
    wider = with_effect(
        tube, effect_of_both, inner_radius=(0.001, 0.0001), radius_slope=(0.02, 0.001)
    )
    assert [row.name for row in comparisons(wider) if row.effect] == ["cover.inner_radius"]
    assert [row.name for row in effect_comparisons(wider)] == ["cover_radius.radius_slope"]


def test_console_report_and_diagnosis_print_the_same_number(
    plain: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    """And the contract's JSON keeps the increment."""
    increment = {"value": -0.0015, "sigma": 0.000056, "unit": "m"}
    candidate = {
        "effect": "thickness",
        "accepted": True,
        "held_out_px_before": 0.3,
        "held_out_px_after": 0.1,
        "parameters": {"thickness.thickness": increment},
    }
    diagnosed = with_effect(plain, Thickness(("cover.thickness",)), thickness=(-0.0015, 0.000056))
    history = History(diagnosis=DiagnosisRecord({"candidates": [candidate]}))
    diagnosed = replace(diagnosed, history=history, stages=(Stage("pinhole", 1.0, 0.1),))
    sentence = "cover.thickness 1.500 mm = 3 declared - 1.500 ± 0.056"
    print_fit(diagnosed, 1.0)
    words = " ".join(capsys.readouterr().out.split())
    assert re.search(r"cover.thickness 1.500 ± 0.056 mm 3.00 ± \S+ mm \w+, by thickness ", words)
    (accepted,) = history.diagnosis.accepted if history.diagnosis else ()
    assert describe_estimates(accepted, diagnosed) == [sentence]
    assert [row.estimates for row in effect_rows(diagnosed)] == [(sentence,)]


def test_numbers_that_differ_have_their_spread_in_words(plain: Calibration) -> None:
    focal = {"focal": EffectEstimate(9.78e-3, 2.4e-4, "")}
    step = AcceptedEffect("focal", 0.3, 0.1, {}, "from_view", focal, "0012.png")
    assert describe_estimates(step, plain) == [
        "focal differs by 0.00978 ± 0.00024 (root mean square over views, from 0012.png on)"
    ]


def test_a_field_has_its_size_in_words(plain: Calibration) -> None:
    size = {"inner_surface.rms": EffectEstimate(1.23e-5, 2e-6, "m")}
    accepted = AcceptedEffect("inner_surface", 0.3, 0.1, size)
    assert describe_estimates(accepted, plain) == ["inner_surface.rms 0.0123 ± 0.0020 mm"]


def test_no_declared_number_is_less_certain_than_its_tolerance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """However wide the covariance becomes. An estimate may be farther from the declared number than
    its tolerance, and is then uncertain by as much.
    """

    def wide(fitted: FittedModel, *_: object) -> NDArray[np.float64]:
        return 1e6 * np.eye(len(fitted.joint.covariance))

    monkeypatch.setattr(fit_result, "possible_print_shifts", wide)
    made = scene(3, views=8, grid=(4, 4), amplitude=0.0, noise=0.1)
    calibration = tolerant(made, Setup(made.board, CAMERA, INTRINSICS, made.cover))
    limited = 0
    for name, number in calibration.cover.numbers.items():
        declared = calibration.declared.cover.numbers[name]
        if declared.sigma:
            limit = max(declared.sigma, abs(number.value - declared.value))
            assert number.sigma == pytest.approx(limit, rel=1e-6), name
            limited += 1
    assert limited >= 6
