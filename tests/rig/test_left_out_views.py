"""Pictures that a rig's fit leaves out: those before or after a slip are named, others only if
there are many.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.rig.fit_rig import fit_rig
from calib.rig.judge import judge_rig
from calib.rig.left_out_views import describe_left_out
from calib.rig.rig import Rig
from calib.rig.rig_content import DISAGREEING, INCONSISTENT, RejectedView
from calib.verdict.verdict import Trust
from fixtures.rigs import SimulatedRig, join_pictures, with_motion, with_pictures
from tests.rig.conftest import EVEN

FIRST = ("0.png", "00.png", "000.png")
"""Names before those of the pictures that the fit uses, 0000.png to 0011.png."""
LAST = ("a.png", "b.png", "c.png")
BETWEEN = ("0002a.png", "0005a.png", "0007a.png", "0009a.png")


def without(rig: Rig, files: Sequence[str], *cameras: str, reason: str = INCONSISTENT) -> Rig:
    rejected = tuple(RejectedView(name, file, reason) for name in cameras for file in files)
    return replace(rig, record=replace(rig.record, rejected=rejected))


@pytest.mark.parametrize("reason", DISAGREEING)
def test_a_slip_is_named(fitted: Rig, reason: str) -> None:
    (sentence,) = describe_left_out(without(fitted, FIRST, "left", "right", reason=reason))
    assert "the first 3 pictures of left and right do not fit the others" in sentence
    assert "may have slipped before 0000.png. The calibration is that of the later" in sentence
    (sentence,) = describe_left_out(without(fitted, LAST, "right", reason=reason))
    assert "the last 3 pictures of right do not fit the others" in sentence
    assert "before a.png. The calibration is that of the earlier pictures" in sentence
    assert "record the rig again" in sentence


def test_many_pictures_that_do_not_fit_are_told(fitted: Rig) -> None:
    (sentence,) = describe_left_out(without(fitted, BETWEEN, "right"))
    assert "4 of the 16 pictures that right shares with other cameras do not fit" in sentence


def test_few_pictures_and_blurred_ones_are_no_reason(fitted: Rig) -> None:
    assert not list(describe_left_out(fitted))
    assert not list(describe_left_out(without(fitted, BETWEEN[:3], "right")))
    assert not list(describe_left_out(without(fitted, FIRST[:2], "left", "right")))
    assert not list(describe_left_out(without(fitted, FIRST, "right", reason="it is blurred")))


@pytest.mark.slow
def test_a_rig_that_slipped_early_is_not_trusted(pair: SimulatedRig, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    motion = np.array([0.0, np.radians(0.05), 0.0, 0.0, 4e-4, 0.0])
    later = with_motion(pair, "right", motion)
    joined = join_pictures(with_pictures(rng, pair, 3), with_pictures(rng, later, 15))
    slipped = replace(joined, cameras=later.cameras)
    rig = fit_rig(slipped.write(tmp_path / "rig"), EVEN)
    verdict = judge_rig(rig)
    assert verdict.word is Trust.CARE
    assert any("may have slipped before 0003.png" in r.sentence for r in verdict.reasons)
    true = float(later.cameras["right"].mounting[3:].norm())
    assert abs(rig.baselines[0].metres - true) < 3 * rig.baselines[0].sigma
