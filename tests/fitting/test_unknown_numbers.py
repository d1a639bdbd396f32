"""Unknown numbers end near the truth, with a standard deviation that says how near; an unknown
shape is the one that the pictures were taken through.
"""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch

from calib.calibration import Calibration
from calib.errors import InputError
from calib.fit_record.outcome import MIN_SHAPE_LOG_ODDS
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting import shape_choice
from calib.fitting.declared import comparisons
from calib.fitting.description import calibrated_numbers, describe
from calib.fitting.fitted import Fitted
from calib.fitting.setup import Setup
from calib.fitting.shape_choice import choose_shape
from calib.fitting.stages import fit_stages
from calib.fitting.unknown_numbers import with_initial_values
from calib.fitting.valleys import widen_valleys
from calib.progress import Silent
from calib.session.camera import Intrinsics, unknown_intrinsics
from calib.session.cover import Cover
from calib.session.numbers import numbers_of
from calib.session.schema import Number
from calib.verdict.judge import judge
from calib.verdict.unknown_numbers import unknown_numbers
from calib.verdict.verdict import Trust
from fixtures.calibrated import CAMERA, calibrated, with_outcome
from fixtures.known import known
from fixtures.synthetic import COVERS, HEIGHT, INTRINSICS, WIDTH, Scene, bare_views, scene
from tests.verdict.cases import asked

SETTINGS = Settings(grid=EVEN_GRID, flat_board=True)
MAX_DEVIATION = 2.5
"""Standard deviations of an estimate from the truth."""


def unknown_cover(cover: Cover, keys: Sequence[str]) -> Cover:
    """Return the cover with every number of these keys unknown."""
    parameters = dict(cover.parameters)
    for name, kind in cover.kinds.items():
        if kind.quantity.key in keys:
            parameters[name] = kind.quantity.unknown_numbers[name]
    return replace(cover, parameters=parameters)


def made(cover: str, views: int = 10) -> Scene:
    return scene(0, views=views, amplitude=0.0, noise=0.1, cover=COVERS[cover][0])


def calibrate(scene_made: Scene, intrinsics: Intrinsics, cover: Cover) -> Calibration:
    setup = Setup(scene_made.board, CAMERA, intrinsics, cover)
    setup = with_initial_values(setup, scene_made.views, Silent())
    return calibrated(scene_made, setup, SETTINGS)


ALL_OF_A_DOME = ("inner_radius_mm", "centre_mm", "thickness_mm", "refractive_index")
ALL_OF_A_CONE = ("inner_radius_mm", "radius_slope", "axis_offset_mm", "tilt_deg", "thickness_mm")


@pytest.mark.parametrize(
    ("cover", "keys", "lens_is_known"),
    [
        ("thick-cone", ("inner_radius_mm",), True),
        pytest.param("thick-cone", ALL_OF_A_CONE, True, marks=pytest.mark.slow),
        ("cylinder", ("thickness_mm", "refractive_index"), True),
        ("wet-flat", ("distance_mm",), False),
        pytest.param("thick-cone", (), False, marks=pytest.mark.slow),
        pytest.param(
            *("wet-flat", ("distance_mm", "tilt_deg", "outside_index"), True),
            marks=pytest.mark.slow,
        ),
        pytest.param("wet-dome", ALL_OF_A_DOME, True, marks=pytest.mark.slow),
        pytest.param("wet-dome", ("centre_mm",), False, marks=pytest.mark.slow),
    ],
)
def test_unknown_numbers_end_near_the_truth(
    cover: str, keys: Sequence[str], lens_is_known: bool
) -> None:
    intrinsics = INTRINSICS if lens_is_known else unknown_intrinsics(CAMERA)
    calibration = calibrate(made(cover), intrinsics, unknown_cover(COVERS[cover][0], keys))
    truth = numbers_of(INTRINSICS, COVERS[cover][0])
    unknown = [number for number in comparisons(calibration) if number.unknown]
    assert unknown
    for number in unknown:
        true = truth.get(number.name, Number(0.0)).value * number.per_si
        deviation = abs(number.estimate - true) / number.sigma
        assert deviation < MAX_DEVIATION, f"{number}: {true:g} is true"
        assert number.sigma < 1.001 * number.tolerance, f"{number.name} became less certain"


def test_number_that_the_views_do_not_tell_keeps_its_wide_sigma_and_the_verdict_says_so() -> None:
    """Water on both sides of thin glass: its thickness hardly bends a ray."""
    cover = unknown_cover(COVERS["wet-dome"][0], ("thickness_mm",))
    calibration = calibrate(made("wet-dome"), INTRINSICS, cover)
    thickness = {number.name: number for number in comparisons(calibration)}["cover.thickness"]
    assert thickness.is_open
    assert thickness.sigma > 0.9 * thickness.tolerance
    verdict = judge(calibration)
    assert "cover.thickness" in verdict.suspects
    assert any(
        "pictures do not determine cover.thickness" in sentence for sentence in verdict.sentences
    )


@pytest.mark.parametrize(
    ("index", "names", "advice"),
    [
        (1.0, ["z"], "measure it: in air, more pictures hardly show it."),
        (1.333, ["z"], "measure it, or take pictures of the board near and tilted."),
        (1.0, ["x", "z"], "measure it: in air, more pictures hardly show it."),
    ],
)
def test_more_pictures_hardly_show_the_centre_of_a_dome_in_air(
    index: float, names: list[str], advice: str
) -> None:
    dome = COVERS["dome"][0].replace_numbers({"cover.outside_index": Number(index)})
    centre = {f"cover.centre.{name}": Number(0.0, 0.03) for name in names}
    unknown = {name: replace(number, unknown=True) for name, number in centre.items()}
    calibration = known(scene(1, views=1, cover=dome.replace_numbers(centre)), WIDTH, HEIGHT)
    stated = replace(calibration.declared, cover=dome.replace_numbers(unknown))
    (reason,) = asked(unknown_numbers, replace(calibration, stated=stated), depths=(0.5,))
    assert reason.sentence.endswith(advice)
    assert reason.maps_hold


def test_verdict_is_silent_about_an_unknown_number_that_the_views_tell() -> None:
    cover = unknown_cover(COVERS["thick-cone"][0], ("thickness_mm",))
    calibration = calibrate(made("thick-cone"), INTRINSICS, cover)
    assert "cover.thickness" not in judge(calibration).suspects
    rows = {row[0]: row for section in describe(calibration).sections for row in section.rows}
    assert rows["cover.thickness"][2:] == ("unknown", "", "")
    written = calibrated_numbers(calibration)["cover"]
    assert isinstance(written, dict)
    assert written["thickness_mm"]["declared"] == "unknown"


def test_paper_method_asks_for_the_value() -> None:
    cover = unknown_cover(COVERS["thick-cone"][0], ("thickness_mm",))
    setup = Setup(made("thick-cone", views=3).board, CAMERA, INTRINSICS, cover)
    with pytest.raises(InputError, match=r"cover\.thickness is unknown: write its value"):
        setup.with_tolerances(Settings(method="paper"))


def shapeless(index: float) -> Cover:
    """Return a cover of unknown shape and glass in a medium of this index."""
    glass = {
        name: number
        for name, number in unknown_cover(
            COVERS["wet-flat"][0], ("thickness_mm", "refractive_index")
        ).parameters.items()
        if name in ("thickness", "refractive_index")
    }
    return Cover("unknown", {**glass, "outside_index": Number(index)})


@pytest.mark.parametrize(
    ("cover", "shape"),
    [
        pytest.param("wet-dome", "dome", marks=pytest.mark.slow),
        pytest.param("wet-flat", "flat", marks=pytest.mark.slow),
        pytest.param("thick-cone", "cone", marks=pytest.mark.slow),
        pytest.param("cylinder", "cylinder", marks=pytest.mark.slow),
    ],
)
def test_unknown_shape_is_the_true_one_or_as_probable(cover: str, shape: str) -> None:
    scene_made = made(cover)
    medium = COVERS[cover][0].parameters["outside_index"].value
    setup = Setup(scene_made.board, CAMERA, INTRINSICS, shapeless(medium))
    choice = choose_shape(setup, scene_made.views, SETTINGS, Silent())
    chosen = choice.setup.cover.shape
    assert choice.log_odds[chosen] == 0 == max(choice.log_odds.values())
    assert choice.log_odds[shape] > -MIN_SHAPE_LOG_ODDS
    # Ten views hardly tell this cone's slope; everything else is told.
    probable = {name for name, odds in choice.log_odds.items() if odds > -MIN_SHAPE_LOG_ODDS}
    assert probable <= ({"cone", "cylinder"} if shape in ("cone", "cylinder") else {shape})


@pytest.mark.parametrize(
    ("values", "allowed"),
    [
        ({"cover.tilt.x": 0.7, "cover.thickness": 3e-3, "camera.fx": 650.0}, True),
        ({"cover.tilt.z": -1.2}, False),
        ({"cover2.thickness": 2e-5}, False),
    ],
)
def test_a_shape_with_numbers_that_a_session_cannot_have_is_none(
    values: dict[str, float], allowed: bool
) -> None:
    """A window that was tilted by 69 degrees imitated water that nobody declared."""
    fitted = cast(
        Fitted,
        SimpleNamespace(values={name: torch.tensor(value) for name, value in values.items()}),
    )
    assert shape_choice._is_within_limits(fitted) == allowed


@pytest.mark.slow
def test_no_cover_is_a_shape_too_and_what_is_as_probable_is_named() -> None:
    views = bare_views(2, 8, 0.1)
    setup = Setup(made("dome", views=3).board, CAMERA, INTRINSICS, shapeless(1.0))
    choice = choose_shape(setup, views, SETTINGS, Silent())
    assert choice.setup.cover.shape == "none"
    calibration = calibrate(made("dome"), INTRINSICS, COVERS["dome"][0])
    equal = with_outcome(calibration, shape_log_odds={"none": -1.0, "dome": 0.0, "cone": -80.0})
    assert equal.outcome.probable_shapes == ("dome", "none")
    assert any("fit a dome or no cover about equally well" in s for s in judge(equal).sentences)
    rows = {row[0]: row for section in describe(equal).sections for row in section.rows}
    assert rows["cover.shape"] == ("cover.shape", "dome", "unknown", "not determined", "")
    spread = with_outcome(equal, shape_camera_sigma={"camera.fx": 7.5, "camera.fy": 1e-9})
    rows = {row[0]: row for section in describe(spread).sections for row in section.rows}
    assert rows["camera.fx"][1].endswith(" ± 7.5 px")
    assert rows["camera.fx"][3] == "any shape"
    assert rows["camera.fy"] == next(
        row for section in describe(equal).sections for row in section.rows if row[0] == "camera.fy"
    )
    certain = with_outcome(calibration, shape_log_odds={"none": -90.0, "dome": 0.0})
    assert "cover.shape" not in judge(certain).suspects


@pytest.mark.slow
@pytest.mark.parametrize("exact", [True, False])
def test_sigma_is_for_all_shapes_of_numbers_that_are_estimated(
    exact: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All shapes count as probable. An exact number has no sigma."""
    monkeypatch.setattr("calib.fitting.shape_choice.MIN_SHAPE_LOG_ODDS", 1e9)
    scene_made = made("dome", views=5)
    k = INTRINSICS
    held = {key: replace(getattr(k, key), exact=True) for key in ("fx", "fy", "cx", "cy")}
    stated = replace(k, **held) if exact else unknown_intrinsics(CAMERA)
    setup = Setup(scene_made.board, CAMERA, stated, shapeless(1.0))
    choice = choose_shape(setup, scene_made.views, SETTINGS, Silent())
    assert len(choice.map_changes_px) >= 2
    if exact:
        assert choice.camera_sigma == {}
    else:
        assert abs(choice.camera_sigma["camera.fx"]) > 1.0


def test_a_cover_that_explains_the_views_as_well_as_none_is_named() -> None:
    """The fit takes no cover, which the wide priors of a cover's numbers make more probable."""
    calibration = calibrate(made("dome", views=8), INTRINSICS, COVERS["dome"][0])
    odds = {"none": 0.0, "dome": -5.8}
    differing = with_outcome(calibration, shape_log_odds=odds, shape_map_changes_px={"dome": 3.5})
    assert any(
        "do not show a cover: a dome explains them as well" in s for s in judge(differing).sentences
    )
    rows = {row[0]: row for section in describe(differing).sections for row in section.rows}
    assert rows["cover.shape"] == ("cover.shape", "none", "unknown", "not determined", "")
    same = with_outcome(calibration, shape_log_odds=odds, shape_map_changes_px={"dome": 1e-6})
    assert "cover.shape" not in judge(same).suspects


def test_the_camera_alone_has_the_lens_that_suits_the_views() -> None:
    """A window in water looks like a longer lens, nearly. A cover that leaves more is refuted, and
    the other medium is not proposed for it.
    """
    wet = made("wet-flat", views=8)
    calibration = calibrate(wet, unknown_intrinsics(CAMERA), COVERS["wet-flat"][0])
    alone, last = calibration.stages[0].rms_px, calibration.stages[-1].rms_px
    assert last < alone < 2 * last
    assert "cover.shape" not in judge(calibration).suspects
    worse = tuple(
        replace(stage, rms_px=alone * (1.0 if stage.name == "pinhole" else 1.05))
        for stage in calibration.stages
    )
    odds = {"air": 0.0, "water": -50.0}
    refuted = replace(with_outcome(calibration, medium_log_odds=odds), stages=worse)
    verdict = judge(refuted)
    assert any("explains them better" in sentence for sentence in verdict.sentences)
    assert not any("Either they were taken in" in sentence for sentence in verdict.sentences)
    assert verdict.word is Trust.DO_NOT_USE
    likely = judge(with_outcome(calibration, medium_log_odds=odds))
    assert any("Either they were taken in air" in sentence for sentence in likely.sentences)


@pytest.mark.slow
def test_place_of_a_dome_that_the_lens_makes_up_for_is_as_uncertain_as_it_is() -> None:
    """Eight boards through a dome in water, of which nobody knows where it stands, nor the lens:
    the error over its place is no parabola. Of eight sessions, place and focal length are off by 1
    of their sigmas, within what chance leaves; by the covariance at the optimum, 1.6 and up to 4.2.
    """
    deviations = []
    truth = numbers_of(INTRINSICS, COVERS["wet-dome"][0])
    for seed in range(8):
        views = scene(seed, views=8, amplitude=0.0, noise=0.1, cover=COVERS["wet-dome"][0])
        cover = unknown_cover(COVERS["wet-dome"][0], ("centre_mm",))
        numbers = {
            n.name: n for n in comparisons(calibrate(views, unknown_intrinsics(CAMERA), cover))
        }
        for name in ("cover.centre.z", "camera.fx"):
            error = numbers[name].estimate - truth[name].value * numbers[name].per_si
            deviations.append(error / numbers[name].sigma)
    print(np.round(deviations, 1))
    assert np.abs(deviations).max() < 3
    assert 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.4


@pytest.mark.slow
def test_a_parabola_is_not_widened() -> None:
    """A window in water, whose distance the views tell."""
    cover = unknown_cover(COVERS["wet-flat"][0], ("distance_mm",))
    setup = Setup(made("wet-flat").board, CAMERA, INTRINSICS, cover)
    setup = with_initial_values(setup, made("wet-flat").views, Silent())
    observations = made("wet-flat").observations
    fitted = fit_stages(setup, observations, SETTINGS, Silent())
    assert fitted.model
    assert fitted.joint
    wide, variances = widen_valleys(
        fitted.model, observations, fitted.joint, fitted.joint, ("cover.distance",)
    )
    assert not variances
    assert torch.equal(wide.covariance, fitted.joint.covariance)
