"""Sessions whose target is points: what is read, and what is refused with which words."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import InputError
from calib.session.point_bins import MAX_POINTS, MIN_SIGMA, bin_points
from calib.session.point_target import PointTarget, PointView, in_space
from calib.session.points_file import read_point_view
from calib.session.session import read_session

SESSION = """format: 1
target: {type: points}
camera: {width: 640, height: 480, intrinsics: {fx: 600, fy: 600, cx: 320, cy: 240}}
cover: {shape: none}
"""
TARGET = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])
PIXELS = np.array([[100.0, 100], [500, 110], [490, 400], [90, 380]])
COVARIANCE = np.tile(0.01 * np.eye(2), (4, 1, 1))


def write(folder: Path, **arrays: object) -> Path:
    """Write a session with one view, in which these arrays replace the good ones; None removes."""
    good: dict[str, object] = {"pixels": PIXELS, "target": TARGET, "covariance": COVARIANCE}
    (folder / "points").mkdir(parents=True, exist_ok=True)
    (folder / "session.yaml").write_text(SESSION)
    content = {name: array for name, array in (good | arrays).items() if array is not None}
    np.savez(folder / "points" / "0000.npz", **content)  # type: ignore[arg-type]
    return folder


def test_the_points_are_the_target(tmp_path: Path) -> None:
    session = read_session(write(tmp_path))
    assert isinstance(session.board, PointTarget)
    np.testing.assert_array_equal(session.board.points(), TARGET[:, :2])
    np.testing.assert_array_equal(session.points[0].pixels, PIXELS)
    assert session.point_files == (tmp_path / "points" / "0000.npz",)
    assert "4 points, 1 view" in repr(session)
    assert "4 points" in session._repr_html_()


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"covariance": None}, r"lacks covariance: it needs pixels \(N, 2\) px"),
        ({"target": TARGET[:3]}, r"target is float64 of shape \(3, 3\) where .* \(4, 3\)"),
        ({"pixels": PIXELS[:, :1]}, r"pixels is float64 of shape \(4, 1\)"),
        ({"pixels": np.float64(3)}, r"pixels is float64 of shape \(\)"),
        ({"pixels": PIXELS.astype("U")}, r"pixels is <U"),
        ({"pixels": np.where(PIXELS == 500, np.nan, PIXELS)}, "not finite: leave these points out"),
        ({"pixels": PIXELS + 200}, r"a pixel at \(700, 310\), outside the camera's 640x480 px"),
        ({"covariance": -COVARIANCE}, "not symmetric with variances above 0"),
        ({"covariance": COVARIANCE + np.array([[0, 0.005], [0, 0]])}, "not symmetric"),
    ],
)
def test_bad_points_are_refused(tmp_path: Path, arrays: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        read_session(write(tmp_path, **arrays))
    assert str(tmp_path / "points" / "0000.npz") in str(error.value)


def test_points_with_heights_are_in_space(tmp_path: Path) -> None:
    """A view whose points have z = 0 is then a flat part of the target."""
    write(tmp_path)
    places = TARGET + np.array([0, 0, 0.05])
    np.savez(tmp_path / "points" / "0001.npz", pixels=PIXELS, target=places, covariance=COVARIANCE)
    board = read_session(tmp_path).board
    assert not board.is_flat
    np.testing.assert_array_equal(board.points(), np.concatenate([TARGET, places]))
    assert board.width == pytest.approx(0.1)
    assert board != PointTarget.of(TARGET[:, :2])
    assert board == in_space(PointTarget.of(TARGET[:, :2]))


def test_a_session_of_points_needs_points(tmp_path: Path) -> None:
    (tmp_path / "session.yaml").write_text(SESSION)
    with pytest.raises(InputError, match=r"points has no \.npz files: put a file for each view"):
        read_session(tmp_path)
    write(tmp_path)
    (tmp_path / "points" / "0001.npz").write_bytes(b"PK no zip")
    with pytest.raises(InputError, match=r"0001\.npz is not a whole \.npz file"):
        read_session(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("target: {type: points}", "target: {type: point}"),
            "write points, or describe a board under board",
        ),
        (("target: {type: points}", "target: {type: points, rows: 3}"), "target.rows is not"),
        (
            ("target: {type: points}", "target: {type: points}\nboard: {columns: 9}"),
            "target stands beside board",
        ),
        (("cover:", "corners: a.vnl\ncover:"), "corners stands beside target: drop it"),
    ],
)
def test_a_target_is_described_alone(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    write(tmp_path)
    (tmp_path / "session.yaml").write_text(SESSION.replace(*change))
    with pytest.raises(InputError, match=words):
        read_session(tmp_path)


def test_bare_pictures_need_a_board_of_their_own(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "0000.png").write_bytes(b"")
    with pytest.raises(InputError, match="has no board that they show: describe it"):
        read_session(tmp_path)


def dense_view(noise: float) -> PointView:
    """Return 60,000 points of a strongly tilted plane behind a wavy lens, with noise (px)."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform((0, 0), (1640, 1232), (60000, 2))
    covariance = np.tile(noise**2 * np.eye(2), (len(pixels), 1, 1))
    measured = pixels + rng.normal(0, noise, pixels.shape)
    return PointView("0000.npz", measured, places(pixels), covariance)


def places(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 2) m: where the pixels see the plane."""
    x, y = (pixels - (820, 616)).T / 1300
    x = x + 0.5 / 1300 * np.sin(2 * np.pi * 1300 * y / 500)  # half a pixel in 500
    depth = 1 / (1 + 0.8 * x - 0.5 * y)
    return np.stack([x * depth, y * depth], -1)


def test_averaged_points_are_right_and_know_it() -> None:
    noise = 0.05
    view = bin_points(dense_view(noise))
    assert 0.8 * MAX_POINTS < len(view.pixels) <= MAX_POINTS
    step = 1e-3
    slopes = np.stack(
        [(places(view.pixels + d) - places(view.pixels - d)) / 2 / step for d in step * np.eye(2)],
        -1,
    )
    errors = np.linalg.solve(slopes, (view.places - places(view.pixels))[..., None])[..., 0]
    squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(view.covariance), errors)
    assert 0.8 < np.sqrt(squares.mean() / 2) < 1.25
    assert np.sqrt((errors**2).sum(1).mean()) < 0.02  # of 0.07, by a hundred points in a square


def test_averaging_keeps_the_curvature() -> None:
    """Without noise, what is left is the bend of the target and the lens within a square."""
    view = bin_points(dense_view(1e-6))
    step = 1e-3
    slopes = np.stack(
        [(places(view.pixels + d) - places(view.pixels - d)) / 2 / step for d in step * np.eye(2)],
        -1,
    )
    errors = np.linalg.solve(slopes, (view.places - places(view.pixels))[..., None])[..., 0]
    assert np.abs(errors).max() < 0.01
    assert np.sqrt((errors**2).mean()) < MIN_SIGMA


def test_few_points_stay_as_they_are() -> None:
    view = PointView("0000.npz", PIXELS, TARGET[:, :2], COVARIANCE)
    assert bin_points(view) is view


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "0003.npz").write_bytes(b"")
    with pytest.raises(InputError, match=r"0003\.npz"):
        read_point_view(tmp_path / "0003.npz", 640, 480)
