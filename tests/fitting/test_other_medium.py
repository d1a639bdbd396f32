"""Water that is declared as air is told where other numbers are unknown, and the other way round;
what is declared right, or cannot be told, raises no doubt.
"""

from collections.abc import Mapping

import pytest

from calib.calibration import Calibration
from calib.corners.view import pose_labels
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting.other_medium import LIKELY, medium_log_odds
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.fitting.unknown_numbers import with_initial_values
from calib.progress import Silent
from calib.session.schema import Number
from calib.session.shapes.layer import MEDIA
from calib.session.tolerances import UNKNOWN_THICKNESS
from calib.verdict.judge import judge
from calib.verdict.medium import medium
from calib.verdict.verdict import Trust
from fixtures.calibrated import CAMERA, calibrated, with_outcome
from fixtures.synthetic import COVERS, INTRINSICS, Scene, scene
from tests.verdict.cases import asked

SETTINGS = Settings(grid=EVEN_GRID, flat_board=True)


def seen_through(cover: str) -> Scene:
    return scene(0, views=8, amplitude=0.0, noise=0.1, cover=COVERS[cover][0])


def declared_in(made: Scene, word: str) -> Setup:
    """Return a setup with this medium and an unknown thickness."""
    numbers = {
        "cover.outside_index": Number(MEDIA[word]),
        "cover.thickness": Number.of_prior(UNKNOWN_THICKNESS),
    }
    setup = Setup(made.board, CAMERA, INTRINSICS, made.cover.replace_numbers(numbers))
    return with_initial_values(setup, made.views, Silent())


def odds_in(made: Scene, setup: Setup) -> Mapping[str, float] | None:
    fitted = fit_stages(
        setup.with_tolerances(SETTINGS),
        made.observations,
        SETTINGS,
        Silent(),
        labels=pose_labels(made.views),
    )
    return medium_log_odds(setup, fitted, made.views, SETTINGS, Silent())


@pytest.mark.parametrize(("cover", "truth"), [("wet-dome", "water"), ("dome", "air")])
@pytest.mark.parametrize("declared", ["air", "water"])
def test_the_medium_is_told_where_the_thickness_is_unknown(
    cover: str, truth: str, declared: str
) -> None:
    made = seen_through(cover)
    odds = odds_in(made, declared_in(made, declared))
    assert odds
    assert odds[truth] == 0.0
    assert odds[({*MEDIA} - {truth}).pop()] < -LIKELY


def test_nothing_is_compared_where_every_number_is_known() -> None:
    made = seen_through("dome")
    assert odds_in(made, Setup(made.board, CAMERA, INTRINSICS, made.cover)) is None


def test_the_verdict_names_the_medium() -> None:
    made = seen_through("dome")
    fitted: Calibration = calibrated(made, declared_in(made, "air"), SETTINGS)
    assert not asked(medium, with_outcome(fitted, medium_log_odds={"air": -6.9, "water": 0.0}))
    assert not asked(medium, with_outcome(fitted, medium_log_odds={"air": 0.0, "water": -50.0}))
    (reason,) = asked(medium, with_outcome(fitted, medium_log_odds={"air": -28.0, "water": 0.0}))
    assert "Either they were taken in water (10^12 times as probable)" in reason.sentence
    assert "in session.yaml. Or the cover has another shape" in reason.sentence
    assert reason.word is Trust.DO_NOT_USE
    assert reason.suspects == ("cover.outside_index",)
    assert not asked(medium, with_outcome(fitted, medium_log_odds=None))
    odds = {"medium_log_odds": {"air": -28.0, "water": 0.0}, "shape_log_odds": {"dome": 0.0}}
    (reason,) = asked(medium, with_outcome(fitted, **odds))
    assert reason.sentence.endswith(". Or the cover has a shape that calib does not know.")


def test_a_note_says_that_the_pictures_do_not_tell_the_medium() -> None:
    made = seen_through("dome")
    fitted: Calibration = calibrated(made, declared_in(made, "air"), SETTINGS)
    (note,) = judge(with_outcome(fitted, medium_log_odds={"air": -2.0, "water": 0.0})).notes
    assert "fit water outside of the cover about as well as air" in note
    assert not judge(with_outcome(fitted, medium_log_odds={"air": 0.0, "water": -3.1})).notes
    assert not judge(with_outcome(fitted, medium_log_odds={"air": -28.0, "water": 0.0})).notes
