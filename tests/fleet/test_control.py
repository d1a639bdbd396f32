"""Control charts: false alarms are as rare as is said, what is far away is out, and batches are
told apart.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from calib.fleet.control import ALPHA, Chart, charts

Numbers = list[dict[str, tuple[float, float, str]]]
NAMES = ("error_px", "held_out_px", "camera.fx", "camera.cx", "cover.thickness", "cover.tilt.x")


def fleet(rng: np.random.Generator, count: int) -> Numbers:
    """Return a fleet with normal numbers, and with errors whose logarithms are normal."""

    def number(name: str) -> tuple[float, float, str]:
        if name.endswith("px"):
            return float(0.1 * np.exp(rng.normal(0, 0.1))), 0.0, "px"
        return float(100 + rng.normal()), 0.5, "mm"

    return [{name: number(name) for name in NAMES} for _ in range(count)]


def out(drawn: Sequence[Chart]) -> set[tuple[str, int]]:
    return {
        (chart.name, int(index)) for chart in drawn for index in np.flatnonzero(chart.is_outlier)
    }


@pytest.mark.parametrize("count", [8, 20, 100])
def test_fleets_without_a_fault_have_the_stated_false_alarms(count: int) -> None:
    rng = np.random.default_rng(count)
    runs = 200
    alarms = sum(bool(out(charts(fleet(rng, count), {}))) for _ in range(runs))
    assert alarms <= ALPHA * runs + 3 * (ALPHA * (1 - ALPHA) * runs) ** 0.5


def test_an_outlier_is_found_although_a_tenth_of_the_fleet_is_broken() -> None:
    numbers = fleet(np.random.default_rng(3), 40)
    for index, (name, value) in enumerate(
        [
            ("camera.fx", 120.0),
            ("camera.cx", 85.0),
            ("held_out_px", 0.4),
            ("cover.thickness", 112.0),
        ]
    ):
        numbers[10 * index][name] = (value, 0.0 if name.endswith("px") else 0.5, "mm")
    assert out(charts(numbers, {})) == {
        ("camera.fx", 0),
        ("camera.cx", 10),
        ("held_out_px", 20),
        ("cover.thickness", 30),
    }


def test_less_error_than_the_fleet_is_no_fault() -> None:
    numbers = fleet(np.random.default_rng(4), 40)
    numbers[7]["held_out_px"] = (0.01, 0.0, "px")
    assert not out(charts(numbers, {}))


def test_a_slightly_larger_error_is_no_outlier_among_equal_ones() -> None:
    numbers: Numbers = [{"noise_px": (0.1 + 1e-6 * index, 0.0, "px")} for index in range(20)]
    numbers[3]["noise_px"] = (0.115, 0.0, "px")
    assert not out(charts(numbers, {}))
    numbers[3]["noise_px"] = (0.13, 0.0, "px")
    assert out(charts(numbers, {})) == {("noise_px", 3)}


def test_a_less_certain_camera_may_deviate_more() -> None:
    numbers = fleet(np.random.default_rng(5), 40)
    numbers[0]["camera.fx"] = (112.0, 5.0, "mm")
    assert not out(charts(numbers, {}))
    numbers[0]["camera.fx"] = (112.0, 0.5, "mm")
    assert out(charts(numbers, {})) == {("camera.fx", 0)}


def test_batches_are_told_apart_and_have_centres_of_their_own() -> None:
    numbers = fleet(np.random.default_rng(6), 60)
    fixtures = ["A" if index % 2 else "B" for index in range(60)]
    for index in range(0, 60, 2):
        value, sigma, unit = numbers[index]["camera.fx"]
        numbers[index]["camera.fx"] = (value + 12, sigma, unit)
    numbers[1]["camera.fx"] = (112.0, 0.5, "mm")  # as B's are, but of A
    drawn = {
        chart.name: chart
        for chart in charts(numbers, {"fixture": fixtures, "date": ["2026-05-01"] * 60})
    }
    assert {name: chart.factor for name, chart in drawn.items() if chart.factor} == {
        "camera.fx": "fixture"
    }
    a, b = drawn["camera.fx"].batches
    assert (a.name, a.count, b.name, b.count) == ("A", 30, "B", 30)
    assert b.centre - a.centre == pytest.approx(12, abs=1)
    assert out(list(drawn.values())) == {("camera.fx", 1)}


@pytest.mark.parametrize("factors", [{}, {"fixture": [""] * 3}])
def test_few_cameras_and_numbers_that_do_not_vary_have_no_chart(
    factors: Mapping[str, Sequence[str]],
) -> None:
    assert charts([{"camera.fx": (1.0 + index, 0.1, "px")} for index in range(3)], factors) == ()
    assert charts([{"camera.fx": (1.0, 0.1, "px")} for _ in range(9)], {}) == ()
    assert charts([{} for _ in range(9)], {}) == ()


def test_numbers_that_some_cameras_lack_are_compared_for_the_others() -> None:
    numbers = fleet(np.random.default_rng(8), 20)
    for index in range(10):
        del numbers[index]["cover.tilt.x"]
    drawn = {chart.name: chart for chart in charts(numbers, {})}
    assert np.isnan(drawn["cover.tilt.x"].value[:10]).all()
    assert not drawn["cover.tilt.x"].is_outlier.any()
