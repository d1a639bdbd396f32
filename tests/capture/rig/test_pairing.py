"""Which frames belong together, by time stamps alone."""

import numpy as np
import pytest

from capture.frames import Frame
from capture.rig.pairing import MAX_TOLERANCE_S, TOLERANCE_FRACTION, Moment, Pairing

PIXELS = np.zeros((2, 2), np.uint8)


def paired(times: dict[str, list[float]]) -> tuple[list[Moment], Pairing]:
    """Return the moments of cameras with these times of their frames, s."""
    pairing = Pairing(tuple(times))
    frames = sorted((time_s, name) for name, series in times.items() for time_s in series)
    moments = []
    for time_s, name in frames:
        moments += pairing.add(name, Frame(PIXELS, 0, time_s))
    return moments, pairing


def test_every_frame_of_the_slower_camera_has_a_partner() -> None:
    rng = np.random.default_rng(1)
    slow = [float(t) for t in np.arange(40) * 0.1 + 0.013]
    fast = [float(t) for t in np.arange(140) / 30 + rng.uniform(-0.001, 0.001, 140)]
    moments, pairing = paired({"left": slow, "right": fast})
    assert len(moments) == 40
    assert max(moment.spread_s for moment in moments) < TOLERANCE_FRACTION / 30 + 0.001
    assert pairing.unpaired >= 60


@pytest.mark.parametrize("offset_s", [0.0, 0.008, 0.0166, -0.0166])
def test_an_offset_is_the_same_in_every_pair(offset_s: float) -> None:
    times = [k / 30 for k in range(1, 31)]
    moments, pairing = paired({"left": times, "right": [t + offset_s for t in times]})
    assert len(moments) >= 29
    offsets = [m.frames["right"].time_s - m.frames["left"].time_s for m in moments]
    assert offsets == pytest.approx([offset_s] * len(offsets))
    assert pairing.unpaired <= 1


def test_a_dropped_frame_costs_its_own_pair_only() -> None:
    times = [k / 30 for k in range(30)]
    dropped = [t for k, t in enumerate(times) if k not in (7, 8, 20)]
    moments, pairing = paired({"left": times, "right": dropped, "top": times})
    assert len(moments) == 27
    assert all(moment.spread_s == 0 for moment in moments)
    assert pairing.unpaired == 6


def test_slow_cameras_have_a_bounded_tolerance() -> None:
    times = [2.0 * k for k in range(10)]
    moments, pairing = paired({"left": times, "right": [t + 0.3 for t in times]})
    assert pairing.tolerance_s == MAX_TOLERANCE_S
    assert not moments
