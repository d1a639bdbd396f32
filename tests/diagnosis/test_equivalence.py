"""Every name has rivals: a twisted board is no moving one, and what views cannot tell is a
family.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from calib.diagnosis import equivalence
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.finding import Diagnosis
from calib.diagnosis.search_state import SearchState
from calib.effects.board_shape import BoardShape
from calib.effects.entrance_pupil import EntrancePupil
from calib.effects.flat_port import FlatPort
from calib.effects.rolling_shutter import RollingShutter
from calib.fitting.differing import EVIDENCE_SCALE
from calib.progress import Silent
from tests.diagnosis.hide import fitted, hidden, without_cover


@pytest.fixture(scope="module")
def window() -> Diagnosis:
    """8 mm of glass that nobody declared, in front of a bare camera."""
    shift = {"flat_port.tilt.x": 0.0, "flat_port.tilt.y": 0.0, "flat_port.thickness": 8e-3}
    return diagnose(without_cover(FlatPort("air"), shift, 0.1), Silent())[1]


@pytest.mark.slow
def test_a_twisted_board_is_not_a_moving_one() -> None:
    """0.7 mm of twist and nothing else, behind glass: a motion of every view was found here,
    alone.
    """
    _, finding = diagnose(
        fitted(
            hidden(
                BoardShape(0.08, 0.08),
                {"board_shape.xx": 0.0, "board_shape.xy": 7e-4, "board_shape.yy": 0.0},
            )
        ),
        Silent(),
    )
    assert finding.accepted == ("board_shape",)
    assert not finding.families
    accepted = [candidate for candidate in finding.candidates if candidate.accepted]
    (shape,) = accepted
    twist = shape.parameters["board_shape.xy"]
    assert abs(twist.value - 7e-4) < 3 * twist.sigma < 1e-4
    assert finding.final_quality.held_out_px < 0.2 < finding.base_quality.held_out_px


@pytest.mark.slow
def test_a_window_and_a_moving_pupil_are_a_family(window: Diagnosis) -> None:
    """Both move rays along the axis: whichever is named, the truth is in the family, and the
    experiment is said.
    """
    (name,) = window.accepted
    (family,) = window.families
    assert next(iter(family.members)) == name
    assert {"flat_port", "entrance_pupil"} <= family.members.keys()
    assert 0.9 < sum(family.members.values()) < 1 + 1e-9
    assert "the lens" in family.name
    assert "the space in front of the lens" in family.name
    assert family.experiment.startswith("To separate them, ")
    assert str(family) in window.remarks
    families = window.as_json()["families"]
    assert [entry.keys() for entry in families] == [{"name", "members", "experiment"}]


@pytest.mark.parametrize(
    ("odds", "chances"), [(0.09, (0.991, 0.009)), (1.0, (0.909, 0.091)), (0.04, None)]
)
def test_prior_odds_order_a_family_and_name_no_member_alone(
    monkeypatch: pytest.MonkeyPatch, odds: float, chances: tuple[float, float] | None
) -> None:
    """A window that the views alone find one time in twelve is named, however rare windows are."""
    pupil, window = EntrancePupil(), FlatPort("air")
    ahead = SimpleNamespace(log_marginal=1.0)
    behind = SimpleNamespace(log_marginal=0.0)
    rival = SimpleNamespace(
        test=SimpleNamespace(effect=window), base=None, fit=SimpleNamespace(joint=behind)
    )
    monkeypatch.setattr(equivalence, "_rivals", lambda *_: [rival])
    monkeypatch.setattr(equivalence, "_odds", lambda fit, *_: 1.0 if fit.joint is ahead else odds)
    monkeypatch.setattr(equivalence, "separation", lambda *_: "To separate them, look.")
    state = SimpleNamespace(
        fit=SimpleNamespace(joint=ahead), problem=SimpleNamespace(observations=None)
    )
    _, name, family = equivalence._compare(cast(SearchState, state), pupil)
    assert name == "entrance_pupil"
    assert (family and tuple(family.members.values())) == (
        chances and pytest.approx(chances, abs=1e-3)
    )


@pytest.mark.parametrize(("structured", "scale"), [(True, 500.0), (False, EVIDENCE_SCALE)])
def test_a_shared_cause_that_leaves_noise_is_compared_as_it_is(
    monkeypatch: pytest.MonkeyPatch, structured: bool, scale: float
) -> None:
    """The motion of every view explains most of what a window in water does. With a tenth of the
    gain as 1, and as windows are rare, the motion was named.
    """
    motion, window = RollingShutter(), FlatPort("water")
    fits = {
        name: SimpleNamespace(joint=SimpleNamespace(log_marginal=value))
        for name, value in (("base", 0.0), ("motion", 4400.0), ("window", 5000.0))
    }
    rival = SimpleNamespace(test=SimpleNamespace(effect=window), base=None, fit=fits["window"])
    scales: list[float] = []

    def odds(fit: object, best: object, _: object, scale: float) -> float:
        scales.append(scale)
        return 1.0 if fit is best else 0.0

    monkeypatch.setattr(equivalence, "_rivals", lambda *_: [rival])
    monkeypatch.setattr(equivalence, "_unmodelled", lambda *_: {})
    monkeypatch.setattr(equivalence, "_odds", odds)
    monkeypatch.setattr(equivalence, "_replace_effect", lambda state, _: state)
    state = SimpleNamespace(
        fit=fits["motion"],
        evaluations=SimpleNamespace(refit_without=lambda _: fits["base"]),
        problem=SimpleNamespace(observations=None, has_structure=lambda _: structured),
    )
    _, name, family = equivalence._compare(cast(SearchState, state), motion)
    assert (name, family) == ("flat_port", None)
    assert scales == [scale, 1.0]


@pytest.mark.slow
def test_a_pupil_that_moves_far_is_named_alone() -> None:
    """10 mm times the angle squared, with a fourth power of the other sign, as no plate of glass
    does.
    """
    moved = {"entrance_pupil.e2": 10e-3, "entrance_pupil.e4": -20e-3}
    _, finding = diagnose(without_cover(EntrancePupil(), moved, 0.03), Silent())
    assert finding.accepted == ("entrance_pupil",)
    assert not finding.families


@pytest.mark.slow
def test_structure_without_a_known_cause_gets_no_name() -> None:
    """In each view another smooth wave over the board: a motion or a board that flexes follows it,
    and neither is what it is.
    """
    made = hidden(None, {})
    rng = np.random.default_rng(4)
    u = made.board.points()[:, :2] / np.abs(made.board.points()[:, :2]).max(0)
    views = []
    for view in made.views:
        (sine, cosine), (first_phase, second_phase) = (
            rng.normal(0, 0.2, (2, 2)),
            rng.uniform(0, 2 * np.pi, 2),
        )
        moved = sine * np.sin(4 * u[:, :1] + first_phase) + cosine * np.cos(
            3 * u[:, 1:] + second_phase
        )
        views.append(replace(view, corners=view.corners + moved))
    _, finding = diagnose(fitted(replace(made, views=tuple(views))), Silent())
    assert not finding.accepted
