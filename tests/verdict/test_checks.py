"""Each check: something that triggers it, and something that just does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.apply.map_uncertainty import map_sigmas
from calib.calibration import Calibration
from calib.calibration_content import Declared, Stage
from calib.corners.board_markers import PAST_LAST_ROW
from calib.corners.view import RejectedPicture, View
from calib.effects.wedge import Wedge
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.relief_heights import height_spread
from calib.fit_record.history import DiagnosisRecord, History
from calib.fit_record.request import FitRequest, Settings
from calib.fitting.setup import Setup
from calib.fitting.supported_depths import trusted_depths
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.coding import AprilGrid, Charuco, Coding
from calib.session.freeing import AUTO
from calib.session.parameter_names import COVER
from calib.session.schema import Number
from calib.verdict import judge
from calib.verdict.case import Case
from calib.verdict.convergence import not_converged, not_finite
from calib.verdict.cover_stage import cover_stage, worse_than_none
from calib.verdict.coverage import coverage
from calib.verdict.declared_numbers import declared_numbers
from calib.verdict.depths import one_depth, requested_depths
from calib.verdict.judge import CHECKS
from calib.verdict.medium import implausible_indices, medium
from calib.verdict.principal_point import SENSOR_MODES, other_mode, principal_point
from calib.verdict.residual import residual
from calib.verdict.thresholds import BEYOND_NOISE, NO_BETTER, TAKEN_UP, WORSE_THAN_BARE
from calib.verdict.uncertainty import (
    reached_depths,
    too_few_views,
    uncertain_focal_length,
    uncertain_maps,
)
from calib.verdict.unevenness import unevenness
from calib.verdict.unknown_numbers import unknown_shape
from calib.verdict.unseen_row import extra_rows, unseen_row
from calib.verdict.verdict import MAPS_HOLD, Reason, Trust
from fixtures.calibrated import CAMERA, tolerant, with_outcome
from fixtures.calibrated import calibrated as fixed_calibration
from fixtures.synthetic import COVERS, FLAT_PLACE, INTRINSICS, glass, held, paper_cone, scene
from tests.fitting.test_inputs import spoiled
from tests.report.made import calibrated
from tests.test_calibration import write_session
from tests.verdict.cases import DIAGNOSE, SESSION, asked
from tests.verdict.conftest import FAST

LENS_AGAIN = "Or the lens is not as it was in bare/: take those pictures again"


class Stretched(Board):
    """Printed longer along x by 0.4 %, as it is in fixtures/stretch."""

    def points(self) -> NDArray[np.float64]:
        return super().points() * [1.004, 1.0]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_a_good_calibration_is_not_doubted(check, good: Calibration, freed: Calibration) -> None:  # type: ignore[no-untyped-def]
    assert asked(check, good) == []
    assert asked(check, freed) == []


def test_a_check_with_a_bug_leaves_the_other_checks(
    good: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: Case) -> list[Reason]:
        raise ZeroDivisionError("by design")

    monkeypatch.setattr(judge, "CHECKS", (broken, *CHECKS[:3], broken))
    with pytest.raises(ZeroDivisionError):
        judge.judge(good)
    monkeypatch.delenv("REFRACAL_TRACEBACK")
    (reason,) = judge.judge(good).reasons
    assert "which is a bug in calib (ZeroDivisionError: by design)" in reason.sentence
    assert reason.next.startswith("calib report ")


def test_the_maps_may_be_used_only_where_nothing_else_is_wrong(
    good: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    def open_number(_: Case) -> list[Reason]:
        return [Reason("the radius is open.", "calib report x", maps_hold=True)]

    def wrong(_: Case) -> list[Reason]:
        return [Reason("the board is wrong.", "calib report x", word=Trust.DO_NOT_USE)]

    monkeypatch.setattr(judge, "CHECKS", (open_number,))
    verdict = judge.judge(good)
    assert verdict.word is Trust.CARE
    assert verdict.sentences == [MAPS_HOLD, "The radius is open."]
    monkeypatch.setattr(judge, "CHECKS", (open_number, wrong))
    sentences = ["Do not use it.", "The board is wrong.", "The radius is open."]
    assert judge.judge(good).sentences == sentences


def ended_with(calibration: Calibration, outcome: Outcome) -> Calibration:
    joint = calibration.outcome.joint
    assert joint
    return with_outcome(calibration, joint=replace(joint, outcome=outcome.value))


@pytest.mark.parametrize(
    ("coding", "hidden"),
    [(Charuco(0.015, "DICT_4X4_50"), slice(-1, None)), (AprilGrid(0.3), slice(0, 2))],
)
def test_a_row_that_no_view_shows_is_asked_for(
    good: Calibration, coding: Coding, hidden: slice
) -> None:
    board = replace(good.board, columns=8, rows=8, coding=coding)

    def shown(view: View, *, complete: bool) -> View:
        weights = np.ones((board.rows, board.columns))
        if not complete:
            weights[hidden] = 0
        corners = np.where(weights.reshape(-1, 1) > 0, 100.0, np.nan) * np.ones(2)
        return replace(view, corners=corners, weight=weights.ravel())

    cut = tuple(shown(view, complete=False) for view in good.views)
    (reason,) = asked(unseen_row, replace(good, board=board, views=cut))
    assert (reason.word, reason.suspects) == (Trust.CARE, ("board.rows",))
    assert f"{len(cut)} show the one beside it" in reason.sentence
    assert not asked(
        unseen_row,
        replace(good, board=board, views=(*cut[1:], shown(good.views[0], complete=True))),
    )
    assert not asked(unseen_row, replace(good, board=board, views=cut[:4])), "too few to tell"


def test_pictures_that_show_more_rows_than_are_declared_ask_for_the_board(
    good: Calibration,
) -> None:
    left_out = RejectedPicture(
        "0001.png",
        f"4 markers are seen {PAST_LAST_ROW} of the 8x8 board, as on one with more: correct"
        " board.rows in session.yaml",
    )
    (reason,) = asked(
        extra_rows,
        replace(good, rejected=(left_out, RejectedPicture("0002.png", "no board was found"))),
    )
    assert (reason.word, reason.suspects) == (Trust.CARE, ("board.rows",))
    assert "a picture shows markers beyond the last row" in reason.sentence
    assert not asked(extra_rows, good)


def test_a_fit_that_is_not_finite_is_of_no_use(good: Calibration) -> None:
    (reason,) = asked(not_finite, ended_with(good, Outcome.NOT_FINITE))
    assert (reason.word, reason.next) == (
        Trust.DO_NOT_USE,
        f"calib fit '{SESSION}' --grid 5x5 --free none",
    )
    poses = good.poses.copy()
    poses[3, 2] = np.nan
    assert asked(not_finite, replace(good, poses=poses))
    assert not asked(not_finite, ended_with(good, Outcome.STEPS_USED_UP))


@pytest.mark.parametrize("outcome", [Outcome.STEPS_USED_UP, Outcome.STUCK])
def test_a_fit_that_ended_early_is_judged_by_its_distance_from_the_optimum(
    good: Calibration, outcome: Outcome
) -> None:
    assert not asked(not_converged, ended_with(good, outcome)), "it is at its optimum all the same"
    displaced = replace(good, amplitudes=good.amplitudes + 1e-6 * np.eye(5))
    (reason,) = asked(not_converged, ended_with(displaced, outcome))
    assert reason.word is Trust.DO_NOT_USE
    assert not asked(not_converged, displaced), "it says that it has converged"


def with_stages(calibration: Calibration, pinhole: float, cover: float, last: float) -> Calibration:
    errors = {"pinhole": pinhole, "cover": cover, "cover+rbf": last}
    return replace(calibration, stages=tuple(Stage(name, rms, 0.0) for name, rms in errors.items()))


def test_a_cover_that_is_worse_than_none(good: Calibration) -> None:
    (reason,) = asked(worse_than_none, with_stages(good, 1.0, 1.01 * WORSE_THAN_BARE, 1.0))
    assert "larger than no cover at all" in reason.sentence
    even = with_stages(good, 1.0, 1.01 * WORSE_THAN_BARE, 1.0)
    even = replace(even, stages=even.stages[:-1])
    assert len(list(asked(worse_than_none, even))) == 1, "the paper's method with even glass"
    assert not asked(worse_than_none, with_stages(good, 1.0, 0.99 * WORSE_THAN_BARE, 1.0))


def test_a_cover_that_is_worse_than_none_with_every_number_estimated(freed: Calibration) -> None:
    (reason,) = asked(worse_than_none, with_stages(freed, 1.0, 2.71, 1.01 * NO_BETTER))
    assert "even with the numbers that the fit found, explains no more" in reason.sentence
    assert not asked(worse_than_none, with_stages(freed, 1.0, 2.71, 0.99 * NO_BETTER)), (
        "the declared numbers were off, as their tolerances allow"
    )
    assert not asked(worse_than_none, with_stages(freed, 1.0, 0.99 * WORSE_THAN_BARE, 1.0))


def test_an_unevenness_that_explains_too_much_with_every_number_held(
    good: Calibration, freed: Calibration
) -> None:
    much = with_stages(good, 1.0, 1.01 * TAKEN_UP * 0.05, 0.05)
    (reason,) = asked(cover_stage, much)
    assert reason.next.endswith("--free all")
    assert reason.suspects == ("cover.inner_radius", "cover.thickness")
    assert not asked(cover_stage, with_stages(good, 1.0, 0.99 * TAKEN_UP * 0.05, 0.05))
    assert not asked(cover_stage, replace(freed, stages=much.stages)), (
        "there the numbers had their say"
    )
    tried = replace(much, request=FitRequest(Settings(free=(AUTO,))))
    assert not asked(cover_stage, tried), "and there, before they were held"
    exact_numbers = {
        name: replace(number, exact=True) for name, number in good.cover.parameters.items()
    }
    declared = good.declared.intrinsics
    fx = replace(declared.fx, exact=True)
    fy = replace(declared.fy, exact=True)
    cx = replace(declared.cx, exact=True)
    cy = replace(declared.cy, exact=True)
    told = Declared(Intrinsics(fx, fy, cx, cy), replace(good.cover, parameters=exact_numbers))
    assert asked(cover_stage, replace(tried, stated=told)), "exact ones had none"


@pytest.mark.parametrize(("error", "doubted"), [(3.4, False), (3.6, True), (12.0, True)])
def test_a_number_that_is_far_from_what_is_declared(
    freed: Calibration, error: float, doubted: bool
) -> None:
    """The estimate ten times surer than what is declared, and so many of the latter's standard
    deviations away.
    """
    declared, estimate = Number(0.003, 1e-4), Number(0.003 + error * 1e-4 * 0.99**0.5, 1e-5)
    told = replace(
        freed.cover, parameters={**freed.declared.cover.parameters, "thickness": declared}
    )
    cover = replace(freed.cover, parameters={**freed.cover.parameters, "thickness": estimate})
    wrong = replace(freed, cover=cover, stated=Declared(freed.declared.intrinsics, told))
    reasons = asked(declared_numbers, wrong)
    assert [reason.suspects for reason in reasons] == [("cover.thickness",)] * doubted
    assert not any(LENS_AGAIN in reason.sentence for reason in reasons)
    from_bare = asked(declared_numbers, with_outcome(wrong, intrinsics_from="bare"))
    assert [LENS_AGAIN in reason.sentence for reason in from_bare] == [True] * doubted
    assert all(
        "declared as 3.00 ± 0.10 mm" in reason.sentence
        and f"{error:.1f} standard" in reason.sentence
        for reason in reasons
    )


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("session.yaml", ["declared as 2500.0 ± 2.0", "picture size, or was made through"]),
        ("bare", ["found in bare/ as 2500.0 ± 2.0", "pictures in bare/ again"]),
        ("views", []),
    ],
)
def test_a_focal_length_is_compared_with_its_source(
    freed: Calibration, where: str, message: list[str]
) -> None:
    """Off by 30 standard deviations: whoever declared nothing has no session.yaml to correct, and
    views do not contradict themselves.
    """
    k = freed.declared.intrinsics
    told = Declared(replace(k, fx=Number(2500.0, 2.0)), freed.declared.cover)
    camera = replace(freed.camera, intrinsics=replace(k, fx=Number(2560.0, 0.1)))
    reasons = asked(
        declared_numbers,
        with_outcome(replace(freed, camera=camera, stated=told), intrinsics_from=where),
    )
    sentences = [reason.sentence for reason in reasons if reason.suspects == ("camera.fx",)]
    assert len(sentences) == bool(message)
    assert all(words in sentence for sentence in sentences for words in message)


def with_unevenness(calibration: Calibration, uneven: float) -> Calibration:
    """The calibration with glass that is uneven by so many m: twisted, which no wedge is."""
    twist = 1e-5 * np.outer(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))
    height = height_spread(
        *replace(calibration, amplitudes=twist).model(), calibration.observations
    )
    return replace(calibration, amplitudes=twist * uneven / height)


@pytest.mark.parametrize(("uneven", "doubted"), [(29e-6, False), (31e-6, True)])
def test_implausibly_uneven_glass_is_reported(
    good: Calibration, freed: Calibration, uneven: float, doubted: bool
) -> None:
    held = asked(unevenness, with_unevenness(good, uneven))
    free = asked(unevenness, with_unevenness(freed, uneven))
    assert len(held) == len(free) == doubted
    if doubted:
        assert held[0].next.endswith("--free all")
        assert 0 < len(held[0].suspects) < 6
        assert free[0].next == DIAGNOSE


def test_uneven_glass_after_a_diagnosis_does_not_ask_for_another_one(freed: Calibration) -> None:
    diagnosed = replace(freed, history=History(diagnosis=DiagnosisRecord()))
    (reason,) = asked(unevenness, with_unevenness(diagnosed, 40e-6))
    assert reason.next.startswith("calib fit ")


@pytest.mark.parametrize(
    ("water", "advised"),
    [
        (Number(1.333), True),
        (Number(1.333, 0.004), False),
        (Number(1.333, exact=True), False),
        (Number(1.0), False),
    ],
    ids=["plain", "tolerant", "exact", "air"],
)
def test_a_plain_index_of_water_may_cause_uneven_glass(
    freed: Calibration, water: Number, advised: bool
) -> None:
    """`calib fit` does not estimate a plain outside_index, and the sea has another one."""
    declared = freed.declared
    cover = declared.cover.replace_numbers({declared.cover.medium_name: water})
    wet = replace(freed, stated=Declared(declared.intrinsics, cover, declared.doubted))
    (reason,) = asked(unevenness, with_unevenness(wet, 40e-6))
    assert ("outside_index: {value: 1.333, sigma: 0.004}" in reason.sentence) == advised
    assert (reason.next != DIAGNOSE) == advised


@pytest.mark.slow
def test_a_stretched_print_is_named(tmp_path: Path) -> None:
    made = scene(
        5,
        views=24,
        noise=0.05,
        depths=(0.35, 1.2),
        board=Stretched(9, 9, 0.020),
        cover=paper_cone(0.00115),
    )
    (reason,) = asked(residual, calibrated(made, tmp_path, FAST))
    assert "board_scale" in reason.suspects
    assert reason.next == DIAGNOSE


@pytest.mark.slow
def test_a_lens_that_is_not_that_of_bare_is_named() -> None:
    """The pictures in bare/ were cropped elsewhere. Uneven glass would imitate that."""
    dome = COVERS["wet-dome"][0]
    made = scene(2, views=24, amplitude=0, noise=0.1, depths=(0.3, 1.1), cover=dome)
    cropped = replace(
        INTRINSICS,
        fx=replace(INTRINSICS.fx, sigma=0.4),
        fy=replace(INTRINSICS.fy, sigma=0.4),
        cx=Number(INTRINSICS.cx.value + 14, 0.4),
        cy=Number(INTRINSICS.cy.value - 9, 0.4),
    )
    declared = fixed_calibration(made, Setup(made.board, CAMERA, cropped, dome), Settings())
    from_bare = with_outcome(declared, intrinsics_from="bare")
    reasons = asked(declared_numbers, from_bare)
    assert [reason.suspects for reason in reasons] == [("camera.cx",), ("camera.cy",)]
    assert all("take the pictures in bare/ again" in reason.sentence for reason in reasons)


@pytest.mark.slow
def test_a_wedge_that_uneven_glass_imitates_is_named() -> None:
    """No error is left, so a diagnosis does not find it."""
    cover = glass("flat", 0.006, **FLAT_PLACE)
    even = scene(3, views=1, amplitude=0, cover=cover)
    wedge = {"wedge.x": torch.tensor(0.012).double(), "wedge.y": torch.tensor(0.0).double()}
    turned = replace(even, path=Wedge("xy").apply(even.path), values={**even.values, **wedge})
    made = held(np.random.default_rng(3), turned, 24, 0.05, (0.3, 1.2))
    setup = Setup(made.board, CAMERA, INTRINSICS, cover)
    (reason,) = asked(unevenness, tolerant(made, setup))
    assert "wedge" in reason.suspects
    assert reason.next.endswith("--effects wedge")


def test_any_error_beyond_noise_is_reported(good: Calibration) -> None:
    last = good.stages[-1].rms_px
    assert not asked(residual, replace(good, noise_px=1.01 * last / BEYOND_NOISE))
    (reason,) = asked(residual, replace(good, noise_px=0.99 * last / BEYOND_NOISE))
    assert "times the corners' noise of about" in reason.sentence
    second_evaluation = replace(good, noise_px=0.01, history=History(diagnosis=DiagnosisRecord()))
    assert asked(residual, second_evaluation)[0].next.startswith("calib report"), (
        "it was diagnosed already"
    )


def test_empty_regions_of_the_picture_are_named(good: Calibration) -> None:
    partial_views = tuple(
        replace(view, weight=np.where(view.corners[:, 0] < 1400, 1.0, 0.0)) for view in good.views
    )
    enough = np.array([np.count_nonzero(view.weight) > 8 for view in partial_views])
    half = replace(good, views=tuple(np.array(partial_views)[enough]), poses=good.poses[enough])
    (reason,) = asked(coverage, half)
    assert "% of the picture has corners" in reason.sentence
    assert reason.next == f"capture '{SESSION}'"


def test_one_distance(good: Calibration) -> None:
    """Views whose corners lie at nearly one distance, and with one that is farther."""
    far = np.linalg.norm(good.poses[:, 3:], axis=1)
    order = np.argsort(far)
    middle_views = order[10:13]
    alike = replace(
        good, views=tuple(good.views[i] for i in middle_views), poses=good.poses[middle_views]
    )
    assert asked(one_depth, alike)
    spread_views = np.append(middle_views, order[[0, -1]])
    assert not asked(
        one_depth,
        replace(
            good, views=tuple(good.views[i] for i in spread_views), poses=good.poses[spread_views]
        ),
    )


def test_trusted_depths_reach_half_of_the_views_span_further() -> None:
    near, far = trusted_depths(0.5, 1.0)  # 1 to 2 per metre, half of that span to either side
    assert (near, far) == pytest.approx((1 / 2.5, 1 / 0.5))
    assert trusted_depths(0.3, 1.2)[1] == np.inf, (
        "to the horizon it is less than half of their span"
    )


def test_depths_asked_for_outside_of_those_seen(good: Calibration) -> None:
    distance = Case(good, (), None, None, "").distance  # type: ignore[arg-type]
    nearest, _ = trusted_depths(distance.min(), distance.max())
    assert not asked(requested_depths, good, (1.01 * nearest, 1.0))
    (reason,) = asked(requested_depths, good, (0.99 * nearest, 1.0))
    assert " 1 m" not in reason.sentence.split(", and corners")[0]


def test_views_are_counted_against_the_unknowns(good: Calibration, freed: Calibration) -> None:
    def first(calibration: Calibration, views: int) -> Calibration:
        return replace(
            calibration, views=calibration.views[:views], poses=calibration.poses[:views]
        )

    assert not asked(too_few_views, first(good, 8)), "15 of the glass, two a view"
    (reason,) = asked(too_few_views, first(good, 7))
    assert "need at least 8. Take 1 more, tilted." in reason.sentence
    assert not asked(too_few_views, first(freed, 8)), (
        "12 numbers of camera and cover have tolerances of their own"
    )
    plain = with_outcome(freed, intrinsics_from="views")
    assert asked(too_few_views, first(plain, 8)), "the lens is no more than these views say"


def test_uncertain_maps_are_reported(good: Calibration) -> None:
    (reason,) = asked(uncertain_maps, replace(good, covariance=1e4 * good.covariance), (0.5,))
    assert "px at 0.5 m" in reason.sentence
    assert not asked(uncertain_maps, good, (0.5,))


@pytest.mark.parametrize(("sigma", "doubted"), [(9.9, False), (10.1, True), (52.0, True)])
def test_an_uncertain_focal_length_is_reported(
    good: Calibration, sigma: float, doubted: bool
) -> None:
    """The sigma is that of a camera without a cover, from its own views, at a focal length of 1000
    px.
    """
    k = Intrinsics(
        Number(1000.0, sigma), Number(1000.0, 1.0), Number(1640.0, 5.0), Number(1232.0, 5.0)
    )
    bare = replace(good, camera=Camera(3280, 2464, intrinsics=k), covariance=np.zeros((0, 0)))
    plain = with_outcome(bare, intrinsics_from="views")
    reasons = asked(uncertain_focal_length, plain)
    assert [reason.suspects for reason in reasons] == [("camera.fx",)] * doubted
    assert all("tilt the board by about 30 degrees" in reason.sentence for reason in reasons)
    assert not asked(uncertain_focal_length, bare), "the session states it"


def told(
    calibration: Calibration, width: int, height: int, f: float, cx: float, cy: float
) -> Calibration:
    k = Intrinsics(Number(f), Number(f), Number(cx), Number(cy))
    declared = Declared(k, calibration.declared.cover)
    return replace(calibration, camera=Camera(width, height, intrinsics=k), stated=declared)


def test_intrinsics_of_another_mode_are_named(good: Calibration) -> None:
    (reason,) = asked(principal_point, told(good, 1640, 1232, 2558.36, 1666.03, 1273.65))
    assert "these look like the intrinsics of 3280x2464" in reason.sentence
    assert reason.word is Trust.DO_NOT_USE
    (reason,) = asked(principal_point, told(good, 3280, 2464, 1279.18, 832.8, 636.6))
    assert "1640x1232" in reason.sentence
    assert not asked(principal_point, told(good, 1640, 1232, 1279.18, 832.8, 636.6))


@pytest.mark.parametrize("size", SENSOR_MODES, ids=str)
def test_no_mode_is_taken_for_another(size: tuple[int, int]) -> None:
    """Lenses mounted up to 40 px off the middle of 1640, two standard deviations."""
    for error in (-0.024, 0.024):
        k = Intrinsics(
            Number(size[0]),
            Number(size[0]),
            Number(size[0] * (0.5 + error)),
            Number(size[1] / 2 + size[0] * error),
        )
        assert other_mode(Camera(*size), k) is None


def test_a_principal_point_outside_of_the_picture(good: Calibration) -> None:
    for cx, word in ((1650.0, Trust.CARE), (5000.0, Trust.DO_NOT_USE)):
        (reason,) = asked(principal_point, told(good, 1640, 1232, 1279.0, cx, 500.0))
        assert (reason.word, reason.suspects) == (word, ("camera.cx", "camera.cy"))
    assert not asked(principal_point, told(good, 1640, 1232, 1279.0, 1600.0, 500.0))


@pytest.mark.parametrize(
    ("glass", "medium_index", "says"),
    [
        (1.333, 1.49, "with the index 1.333, and what is outside with 1.49: are the two swapped?"),
        (1.33, 1.0, "the index of the glass is that of water"),
        (1.49, 1.333, ""),
        (1.5, 1.0, ""),
    ],
)
def test_the_indices_of_the_glass_and_of_what_is_outside(
    good: Calibration, glass: float, medium_index: float, says: str
) -> None:
    def declared(number: Number) -> Calibration:
        indices = {
            COVER.refractive_index(): number,
            COVER.of("outside_index"): Number(medium_index),
        }
        cover = good.declared.cover.replace_numbers(indices)
        return replace(good, stated=replace(good.declared, cover=cover))

    reasons = asked(implausible_indices, declared(Number(glass)))
    assert len(reasons) == bool(says)
    assert all(says in reason.sentence for reason in reasons)
    assert not asked(implausible_indices, declared(Number(glass, 0.05, unknown=True)))


@pytest.mark.parametrize("change_px", [1e-6, 1.0, None])
def test_maps_that_another_shape_hardly_changes_hold(
    good: Calibration, change_px: float | None
) -> None:
    """A cone of which nobody knows whether it is a cylinder straightens all the same."""
    changes = None if change_px is None else {"cylinder": change_px}
    equal = with_outcome(
        good, shape_log_odds={"cone": 0.0, "cylinder": -1.0}, shape_map_changes_px=changes
    )
    (reason,) = asked(unknown_shape, equal)
    sigma = max(map_sigmas(equal, reached_depths(equal)).values())
    assert 1e-6 < sigma < 1.0
    assert reason.maps_hold == (change_px == 1e-6)
    assert ("no more than their sigma" in reason.sentence) == reason.maps_hold
    assert reason.next.startswith("calib fit") != reason.maps_hold


@pytest.mark.slow
def test_water_declared_as_air_is_reported(tmp_path: Path) -> None:
    made = scene(21, views=10, noise=0.05)
    wet = calibrated_from(spoiled(tmp_path / "wet", made, cover__outside_index=1.333))
    (reason,) = asked(medium, wet)
    assert "the board was in air" in reason.sentence
    assert reason.suspects == ("cover.outside_index",)
    thin = spoiled(tmp_path / "thin", made, cover__thickness_mm=1.0)
    assert not asked(medium, calibrated_from(thin)), "that is another number"


@pytest.mark.slow
def test_air_declared_as_water_is_reported(tmp_path: Path) -> None:
    cover = paper_cone()
    wet = replace(cover, parameters={**cover.parameters, "outside_index": Number(1.333)})
    made = scene(21, views=10, noise=0.05, cover=wet)
    assert not asked(medium, calibrated_from(write_session(tmp_path / "right", made)))
    (reason,) = asked(
        medium, calibrated_from(spoiled(tmp_path / "wrong", made, cover__outside_index=1.0))
    )
    assert "the board was in water" in reason.sentence


@pytest.mark.slow
def test_pictures_in_air_among_pictures_in_water_are_reported(tmp_path: Path) -> None:
    cover = COVERS["wet-flat"][0]
    wet = scene(21, views=12, noise=0.05, cover=cover)
    dry = scene(21, views=12, noise=0.05, cover=cover.replace_medium(Number(1.0), None))
    mixed = replace(wet, views=(*wet.views[:6], *dry.views[6:]))
    (reason,) = asked(medium, calibrated_from(write_session(tmp_path / "mixed", mixed)))
    assert "6 of the 12 pictures seem to have been taken in air" in reason.sentence
    assert "calib diagnose" in reason.next


def calibrated_from(session: Path) -> Calibration:
    from calib.fitting.fit import fit
    from calib.session.session import read_session

    return fit(read_session(session), FAST)
