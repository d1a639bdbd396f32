"""Declared numbers that views confirm, contradict or leave open, by what they cost in depth and
length.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.fitting.fit import fit
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.schema import Number
from calib.session.session import read_session, session_to_yaml
from calib.verdict.confirmation import contradicted_numbers, unconfirmed_numbers
from calib.verdict.judge import judge
from calib.verdict.scale_evidence import scale_evidence
from calib.verdict.thresholds import UNSURE_FOCAL
from calib.verdict.verdict import Trust
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, bare_views, paper_cone, scene
from tests.report.made import calibrated
from tests.verdict.cases import SESSION, asked
from tests.verdict.conftest import FAST

BOARD = Board(9, 9, 0.020)
FOCAL = INTRINSICS.fx.value
PARALLEL = 0.01
"""rad: boards that a person holds parallel to the picture, as well as hands can."""
NAMES = ("camera.fx", "camera.fy")


def bare(folder: Path, views: tuple[View, ...], focal: Number) -> Calibration:
    """Return the calibration of a camera without a cover, with its focal length declared."""
    intrinsics = replace(INTRINSICS, fx=focal, fy=focal)
    setup = session_to_yaml(BOARD, Camera(WIDTH, HEIGHT, intrinsics=intrinsics), Cover("none", {}))
    folder.mkdir()
    written = {"format": 1, **setup, "corners": "corners.vnl"}
    (folder / "session.yaml").write_text(yaml.safe_dump(written))
    write_corners(folder / "corners.vnl", views)
    return fit(read_session(folder))


def declared(times: float) -> tuple[Number, ...]:
    """A focal length by itself, with a standard deviation, and exact."""
    value = times * FOCAL
    return Number(value), Number(value, 0.004 * value), Number(value, exact=True)


@pytest.mark.parametrize("times", [1.0, 1.1])
def test_parallel_boards_confirm_no_focal_length(tmp_path: Path, times: float) -> None:
    """Neither the right one nor one that is 10 % wrong, however it is declared."""
    views = bare_views(1, 16, 0.1, tilt=PARALLEL)
    for index, focal in enumerate(declared(times)):
        estimate = bare(tmp_path / str(index), views, focal)
        (reason,) = asked(unconfirmed_numbers, estimate)
        assert (reason.word, reason.suspects) == (Trust.CARE, NAMES)
        assert "taken as declared, not confirmed by these views" in reason.sentence
        assert "To confirm them, tilt the board by 20 to 40 degrees" in reason.sentence
        assert reason.next == f"capture '{SESSION}'"
        assert not asked(contradicted_numbers, estimate)
        assert judge(estimate).word is Trust.CARE


def test_tilted_boards_confirm_the_right_focal_length(tmp_path: Path) -> None:
    views = bare_views(1, 16, 0.1)
    for index, focal in enumerate(declared(1.0)):
        estimate = bare(tmp_path / str(index), views, focal)
        assert not asked(unconfirmed_numbers, estimate)
        assert not asked(contradicted_numbers, estimate)
        assert judge(estimate).word is Trust.TRUSTED


@pytest.mark.parametrize(("times", "ways"), [(1.02, 2), (1.1, 3)])
@pytest.mark.slow
def test_tilted_boards_contradict_a_wrong_focal_length(
    tmp_path: Path, times: float, ways: int
) -> None:
    """The reason names the value that the views ask for, to a tenth of the error, and the change of
    lengths. A number with a standard deviation is estimated, and the declared one contradicted.
    """
    views = bare_views(1, 16, 0.1)
    for index, focal in enumerate(declared(times)[:ways]):
        estimate = bare(tmp_path / str(index), views, focal)
        if focal.sigma:
            intrinsics = estimate.camera.intrinsics
            assert intrinsics
            assert abs(intrinsics.fx.value - FOCAL) < 3 * intrinsics.fx.sigma
            assert judge(estimate).word is Trust.CARE
            assert set(judge(estimate).suspects) == set(NAMES)
            assert len(judge(estimate).reasons) == 2, "the residual is noise"
            continue
        (reason,) = asked(contradicted_numbers, estimate)
        assert (reason.word, reason.suspects) == (Trust.CARE, NAMES)
        assert f"declared as {times * FOCAL:.6g}" in reason.sentence
        assert "the file is of another focus or picture size: leave --intrinsics" in reason.sentence
        assert reason.next.startswith("calib fit")
        evidence = scale_evidence(estimate)
        assert evidence.change == pytest.approx(times - 1, rel=0.1)
        estimated_focal = times * FOCAL + evidence.corrections["camera.fx"].change
        assert estimated_focal == pytest.approx(FOCAL, rel=0.1 * (times - 1))
        assert judge(estimate).suspects[:2] == NAMES


def test_an_exact_number_with_a_small_error_is_not_contradicted(tmp_path: Path) -> None:
    """The change of depth is 0.2 %, which is less than any reason mentions."""
    estimate = bare(tmp_path / "near", bare_views(1, 16, 0.1), Number(1.002 * FOCAL, exact=True))
    assert scale_evidence(estimate).change == pytest.approx(0.002, rel=0.1)
    assert not asked(contradicted_numbers, estimate)


def test_copies_of_pictures_are_no_further_evidence(tmp_path: Path) -> None:
    views = bare_views(1, 8, 0.1)
    copies = tuple(replace(view, name=f"copy-{view.name}") for view in views)
    once = scale_evidence(bare(tmp_path / "once", views, Number(FOCAL)))
    twice = scale_evidence(bare(tmp_path / "twice", (*views, *copies), Number(FOCAL)))
    assert twice.sigma == pytest.approx(once.sigma, rel=1e-3)


@pytest.mark.parametrize("exact", [False, True])
def test_parallel_boards_behind_a_cone_leave_only_the_focal_length_unconfirmed(
    tmp_path: Path, exact: bool
) -> None:
    """The cover does not tell it either, and its own numbers are not what depth rests on."""
    glass = paper_cone(0.00115)
    parameters = {name: replace(item, exact=exact) for name, item in glass.parameters.items()}
    made = scene(
        3, 16, noise=0.1, depths=(0.35, 1.2), cover=replace(glass, parameters=parameters), tilt=0.01
    )
    (reason,) = asked(unconfirmed_numbers, calibrated(made, tmp_path, FAST))
    assert reason.suspects == NAMES


def test_a_good_cone_is_confirmed_by_a_wide_margin(good: Calibration, freed: Calibration) -> None:
    for calibration in (good, freed):
        evidence = scale_evidence(calibration)
        assert 0 < evidence.sigma < UNSURE_FOCAL / 10
        assert abs(evidence.change) < 1e-3
        assert evidence.change_sigma < evidence.sigma * 1.5


def test_the_sigma_of_the_scale_equals_the_scatter(tmp_path: Path) -> None:
    """The views ask, if every declared number is true, for a change as large as its standard
    deviation: by the root mean square over ten sessions, to three standard deviations of that.
    """
    ratios = []
    for seed in range(10):
        estimate = bare(tmp_path / str(seed), bare_views(seed, 10, 0.1), Number(FOCAL))
        evidence = scale_evidence(estimate)
        ratios.append(evidence.change / evidence.change_sigma)
    assert 0.33 < np.sqrt(np.mean(np.square(ratios))) < 1.67
