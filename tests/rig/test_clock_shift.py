"""Clocks of cameras that differ by a constant: the shift is found where no picture pairs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import NotEnoughDataError
from calib.rig.check_rig import check_clocks
from calib.rig.clock_shift import constant_shift, describe_clock_shift
from calib.rig.fit_rig import fit_rig
from calib.rig.placements import Placements
from calib.rig.rig_file import read_rig
from fixtures.rigs import SimulatedRig
from tests.rig.conftest import EVEN

SHIFT = 3600.123
TOGETHER = {"tolerance_ms": 5}


def timed(rig: SimulatedRig, shift: float) -> SimulatedRig:
    """Return the rig with a picture of each camera each 2 s, where the second camera's clock is
    ahead by a shift in s.
    """
    starts = {"left": 100.0, "right": 100.0 + shift}
    views = {
        name: tuple(
            replace(view, time_s=start + 2.0 * place) for place, view in enumerate(rig.views[name])
        )
        for name, start in starts.items()
    }
    return replace(rig, views=views)


@pytest.mark.parametrize(
    ("shift", "says"),
    [
        (SHIFT, "are 3600.123 s later than times of left: subtract 3600.123 from time_s in"),
        (-SHIFT, "are 3600.123 s earlier than times of left: add 3600.123 to time_s in"),
        (0.008, "later than times of left: write tolerance_ms: 13 in"),
        (-0.008, "or add 0.008 to time_s in"),
        (0.0, ""),
        (2.0, ""),
    ],
)
def test_the_shift_of_a_clock_is_stated(
    pair: SimulatedRig, tmp_path: Path, shift: float, says: str
) -> None:
    rig = timed(pair, shift)
    description = read_rig(rig.write(tmp_path / "rig", together=TOGETHER))
    placements = Placements.of(description, rig.views)
    sentence = describe_clock_shift(description, rig.views, placements)
    assert says in sentence
    assert bool(sentence) == bool(says)


def test_times_that_jitter_give_the_shift_of_most() -> None:
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(1, 3, 40))
    later = times[5:] + SHIFT + rng.uniform(-0.002, 0.002, 35)
    shift, count = constant_shift(later, times, 0.005)
    assert shift == pytest.approx(SHIFT, abs=0.002)
    assert count == 35


def test_times_of_other_moments_have_no_shift() -> None:
    rng = np.random.default_rng(4)
    first, second = np.cumsum(rng.uniform(1, 3, (2, 40)), 1)
    assert constant_shift(first, second + 500.0, 0.005)[1] < 8


def test_a_fit_states_the_shift(pair: SimulatedRig, tmp_path: Path) -> None:
    with pytest.raises(NotEnoughDataError, match="all 12 times of right are 3600"):
        fit_rig(timed(pair, SHIFT).write(tmp_path / "rig", together=TOGETHER), EVEN)


def test_a_check_of_two_cameras_goes_on_without_a_third(pair: SimulatedRig, tmp_path: Path) -> None:
    """Times at equal intervals pair with any others that are shifted."""
    rig = timed(pair, 0.0)
    description = read_rig(rig.write(tmp_path / "rig", together=TOGETHER))
    third = tuple(replace(view, name=f"third {view.name}") for view in rig.views["right"])
    alone = timed(replace(rig, views={"left": (), "right": third}), SHIFT).views["right"]
    views = {**rig.views, "third": alone}
    check_clocks(description, views, Placements.of(description, views))
    apart = timed(pair, SHIFT).views
    with pytest.raises(NotEnoughDataError, match="if its clock was off"):
        check_clocks(description, apart, Placements.of(description, apart))
