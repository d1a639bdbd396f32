"""The board's bend is part of every fit where the views show one. The oracle is OpenCV's projection
of bent boards.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.requested_effects import with_requested
from calib.fit_record.request import Settings
from calib.fitting.board_turns import describe_turned, turn_back
from calib.fitting.evaluate import evaluate
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.session.board import Board
from calib.session.session import Session, read_session

BOARD = Board(9, 6, 0.025)
SQUARE_BOARD = Board(8, 8, 0.03)
SIZE = (640, 480)
CAMERA = np.array([[600.0, 0, 327], [0, 600, 233], [0, 0, 1]])
LENS = np.array([-0.2, 0.05, 0, 0, 0])
NOISE = 0.05  # px
BEND = (0.0010, 0.0003, -0.0006)  # m: xx, xy, yy

Floats = NDArray[np.float64]


def bent(board: Board, bend: tuple[float, ...]) -> Floats:
    """Return the (count, 3) m points of a board whose middle lies behind its edges, and, with a
    fourth size, whose rows are waves.
    """
    points = np.column_stack([board.points(), np.zeros(board.count)])
    u, v = points[:, 0] / points[:, 0].max(), points[:, 1] / points[:, 1].max()
    points[:, 2] = bend[0] * (1 - u**2) + bend[1] * u * v + bend[2] * (1 - v**2)
    points[:, 2] += sum(bend[3:]) * (5 * u**3 - 3 * u) / 2
    return points


def pictures(
    board: Board,
    bend: tuple[float, ...],
    count: int = 16,
    seed: int = 0,
    change: Callable[[int, Floats], Floats] = lambda _, corners: corners,
) -> tuple[View, ...]:
    """Return views of a board at random poses, wholly in the picture."""
    rng = np.random.default_rng(seed)
    views: list[View] = []
    while len(views) < count:
        depth = rng.uniform(0.3, 0.8)
        place = np.array([rng.uniform(-0.3, 0.3) * depth, rng.uniform(-0.2, 0.2) * depth, depth])
        turn = np.append(np.radians(rng.uniform(-35, 35, 2)), np.radians(rng.uniform(-10, 10)))
        corners = cv2.projectPoints(bent(board, bend), turn, place, CAMERA, LENS)[0].reshape(-1, 2)
        if (corners < 5).any() or (corners > np.array(SIZE) - 5).any():
            continue
        noisy = corners + rng.normal(0, NOISE, corners.shape)
        views.append(View(f"{len(views):02d}.png", change(len(views), noisy), np.ones(board.count)))
    return tuple(views)


def session(folder: Path, board: Board, views: tuple[View, ...]) -> Session:
    folder.mkdir()
    document = {
        "format": 1,
        "board": {"columns": board.columns, "rows": board.rows, "square_mm": 1000 * board.square},
        "camera": {"width": SIZE[0], "height": SIZE[1]},
        "cover": {"shape": "none"},
        "corners": "corners.vnl",
    }
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    write_corners(folder / "corners.vnl", views)
    return read_session(folder)


def bend_mm(calibration: Calibration) -> list[float]:
    """Return xx, xy and yy of the board's bend, mm; nothing for a flat board."""
    return [
        1e3 * float(value)
        for added in calibration.effects
        for value, _ in list(added.parameters.values())[:3]
    ]


@pytest.mark.slow
def test_the_bend_and_the_camera_come_out_together(tmp_path: Path) -> None:
    made = session(tmp_path / "fit", BOARD, pictures(BOARD, BEND))
    held_out = session(tmp_path / "hold", BOARD, pictures(BOARD, BEND, 6, seed=1))
    calibration = fit(made)
    (added,) = calibration.effects
    for name, truth in zip(("xx", "xy", "yy"), BEND, strict=True):
        value, sigma = added.parameters[f"board_shape.{name}"]
        assert abs(value - truth) < 4 * sigma < 2e-4, name
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    for number, truth in zip(
        (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy),
        (600, 600, 327, 233),
        strict=True,
    ):
        assert abs(number.value - truth) < 4 * number.sigma
    flat = fit(made, Settings(flat_board=True))
    assert not flat.effects
    before = evaluate(flat, held_out).rms_px
    after = evaluate(calibration, held_out).rms_px
    print(f"held out {before:.3f} px with a flat board, {after:.3f} px with the bend")
    assert after < 1.1 * NOISE * 2**0.5 < before


def test_a_flat_board_stays_flat(tmp_path: Path) -> None:
    """The control: three sessions of flat boards without any bend."""
    for seed in range(3):
        views = pictures(BOARD, (0, 0, 0), seed=10 + seed)
        calibration = fit(session(tmp_path / f"{seed}", BOARD, views))
        assert not calibration.effects
        assert [stage.name for stage in calibration.stages] == ["pinhole"]


def test_a_bent_board_asks_for_no_further_coefficients(tmp_path: Path) -> None:
    """The lens has two radial coefficients. A flat board would make it have more."""
    calibration = fit(session(tmp_path / "fit", BOARD, pictures(BOARD, (0.003, 0.0, -0.002), 24)))
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    assert len(intrinsics.distortion) == 4
    assert bend_mm(calibration) == pytest.approx([3, 0, -2], abs=0.1)


@pytest.mark.slow
def test_a_fit_without_a_cover_ends_at_its_optimum(tmp_path: Path) -> None:
    """A fit of its own result moves nothing by a tenth of its standard deviation."""
    made = session(tmp_path / "fit", BOARD, pictures(BOARD, BEND))
    first = fit(made)
    _, values = first.model()
    again = fit(made)
    assert first.digest == again.digest
    model = first.camera_model()
    joint = model.fit(first.observations, torch.from_numpy(first.poses))
    for name, number in joint.estimates().items():
        assert abs(number.value - float(values[name])) < 0.1 * number.sigma, name


@pytest.mark.slow
def test_a_diagnosis_questions_the_bend_anew(tmp_path: Path) -> None:
    """Its figures begin with the flat board, so that the error before and after is that of the
    bend.
    """
    calibration = fit(session(tmp_path / "fit", BOARD, pictures(BOARD, BEND)))
    diagnosed, finding = diagnose(calibration, Silent())
    assert finding.accepted == ("board_shape",)
    assert finding.base_quality.rms_px > 2 * finding.final_quality.rms_px
    assert bend_mm(diagnosed) == pytest.approx(bend_mm(calibration), abs=0.02)


@pytest.mark.slow
def test_noisy_views_leave_the_error_with_a_flat_board(tmp_path: Path) -> None:
    """They make a further fit, which begins with the bend. Its lens with a flat board would leave
    0.32 px, and a flat board's own lens 0.26.
    """
    rng = np.random.default_rng(3)

    def shake(index: int, corners: Floats) -> Floats:
        return corners + (index < 3) * rng.normal(0, 2 * NOISE, corners.shape)

    made = session(tmp_path / "fit", BOARD, pictures(BOARD, BEND, 20, change=shake))
    calibration = fit(made)
    assert calibration.outcome.view_noise
    flat = fit(made, Settings(flat_board=True))
    assert calibration.stages[0].rms_px == pytest.approx(flat.stages[0].rms_px, rel=0.05)


def test_a_requested_print_leaves_the_bend(tmp_path: Path) -> None:
    calibration = fit(session(tmp_path / "fit", BOARD, pictures(BOARD, BEND)))
    requested = with_requested(calibration, ("board_scale",), Silent())
    assert [added.effect.name for added in requested.effects] == ["board_shape", "board_scale"]
    assert bend_mm(requested)[:3] == pytest.approx([1, 0.3, -0.6], abs=0.1)


@pytest.mark.slow
def test_a_quarter_turn_in_every_other_view_is_found(tmp_path: Path) -> None:
    """The corners of the turned views are renumbered, and the bend is the whole one."""

    def turn(index: int, corners: Floats) -> Floats:
        grid = corners.reshape(8, 8, 2)
        return (np.rot90(grid) if index % 2 else grid).reshape(-1, 2)

    bend = (0.002, 0.0005, 0.0)
    straight = fit(session(tmp_path / "straight", SQUARE_BOARD, pictures(SQUARE_BOARD, bend, 20)))
    views = pictures(SQUARE_BOARD, bend, 20, change=turn)
    turned = fit(session(tmp_path / "turned", SQUARE_BOARD, views))
    names = turned.outcome.turned_boards or ()
    assert len(names) == 10
    assert {int(name[:2]) % 2 for name in names} in ({0}, {1})
    assert sorted(map(abs, bend_mm(turned))) == pytest.approx(
        sorted(map(abs, bend_mm(straight))), abs=0.02
    )
    assert not straight.outcome.turned_boards
    assert "The board is turned by a quarter turn in 10 views" in describe_turned(names)
    assert turned.stages[-1].rms_px == pytest.approx(straight.stages[-1].rms_px, rel=0.05)


def test_turning_back_takes_all_of_a_view_along() -> None:
    """Corners, weights, covariances and blurs; the blur along a row becomes that along a column."""
    rng = np.random.default_rng(3)
    straight = View(
        "0.png",
        rng.uniform(0, 400, (64, 2)),
        rng.uniform(0.1, 1, 64),
        covariance=rng.uniform(0, 1, (64, 2, 2)),
        blur=rng.uniform(0.5, 2, (64, 2)),
    )
    assert straight.covariance is not None
    assert straight.blur is not None
    order = np.rot90(np.arange(64).reshape(8, 8), 3).ravel()
    turned = View(
        "0.png",
        straight.corners[order],
        straight.weight[order],
        covariance=straight.covariance[order],
        blur=straight.blur[order][:, ::-1],
    )
    back = turn_back(turned, SQUARE_BOARD)
    for name in ("corners", "weight", "covariance", "blur"):
        assert (getattr(back, name) == getattr(straight, name)).all(), name


def half_turned(index: int, corners: Floats) -> Floats:
    """Return the corners of a picture, from the last to the first in every third one."""
    return corners[::-1] if index % 3 == 0 else corners


def test_half_a_turn_changes_nothing(tmp_path: Path) -> None:
    """The control: a bend of degree 2 looks the same after half a turn."""
    views = pictures(SQUARE_BOARD, (0.002, 0.0005, 0.0), 20, change=half_turned)
    calibration = fit(session(tmp_path / "turned", SQUARE_BOARD, views))
    assert not calibration.outcome.turned_boards
    assert not calibration.outcome.half_turned_boards
    assert bend_mm(calibration) == pytest.approx([2, 0.5, 0], abs=0.05)


@pytest.mark.slow
def test_half_a_turn_is_found_by_the_odd_part_of_the_bend(tmp_path: Path) -> None:
    """But in a frontal view, in which a bend moves corners by less than the noise."""
    bend = (0.001, 0.0, 0.0, 0.0005)
    views = pictures(BOARD, bend, 20)
    straight = fit(session(tmp_path / "straight", BOARD, views))
    assert not straight.outcome.half_turned_boards
    views = pictures(BOARD, bend, 20, change=half_turned)
    turned = fit(session(tmp_path / "turned", BOARD, views))
    names = turned.outcome.half_turned_boards or ()
    assert len({int(name[:2]) for name in names} ^ set(range(0, 20, 3))) <= 1
    assert "half a turn in" in describe_turned(names, "half a turn")
    assert bend_mm(turned) == pytest.approx(bend_mm(straight), abs=0.02)
    assert turned.stages[-1].rms_px == pytest.approx(straight.stages[-1].rms_px, rel=0.05)


@pytest.mark.slow
def test_two_boards_are_no_half_turn(tmp_path: Path) -> None:
    """A flat board and one with waves: the renumbered corners of either explain nothing."""
    flat, waves = pictures(BOARD, (0.0, 0.0, 0.0), 20), pictures(BOARD, (0.0, 0.0, 0.0, 0.001), 20)
    views = tuple(waves[index] if index % 3 else flat[index] for index in range(20))
    calibration = fit(session(tmp_path / "two", BOARD, views))
    assert not calibration.outcome.half_turned_boards


@pytest.mark.slow
def test_a_wide_lens_is_fitted_as_a_fisheye_without_being_asked(tmp_path: Path) -> None:
    from fixtures.wide import BOARD as WIDE_BOARD
    from fixtures.wide import CAMERA as WIDE_CAMERA
    from fixtures.wide import INTRINSICS, wide_views

    made = session(tmp_path / "fit", WIDE_BOARD, wide_views(1, 20, NOISE))
    made = replace(made, camera=replace(WIDE_CAMERA, intrinsics=None, lens=None))
    intrinsics = fit(made).camera.intrinsics
    assert intrinsics
    assert intrinsics.model == "fisheye"
    assert intrinsics.fx.value == pytest.approx(INTRINSICS.fx.value, abs=4 * intrinsics.fx.sigma)


def test_views_of_another_board_are_measured_without_this_one_s_bend(tmp_path: Path) -> None:
    other = Board(7, 5, 0.03)
    calibration = fit(session(tmp_path / "fit", BOARD, pictures(BOARD, BEND)))
    flat = session(tmp_path / "flat", other, pictures(other, (0, 0, 0), 6, seed=2))
    assert calibration.effects
    assert evaluate(calibration, flat).rms_px < 1.15 * NOISE * 2**0.5
