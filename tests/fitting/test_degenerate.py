"""Views that say too little of a camera: refused with a sentence that says what is missing, or a
sigma that is honest, or at least not trusted.

`fixtures.degenerate` draws them; `python -m benchmarks.degenerate` counts.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.cli import main
from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.intrinsics.calibrate import calibrate_bare
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.session import session_to_yaml
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust
from fixtures.calibrated import CAMERA
from fixtures.degenerate import WRONG, bare_session, calibration_of, covered_session
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, bare_views

BOARD = Board(9, 9, 0.020)
BARE = replace(CAMERA, intrinsics=None, lens_coefficients=0)


def without(views: tuple[View, ...], index: int, corners: np.ndarray) -> tuple[View, ...]:
    return tuple(
        replace(view, corners=corners) if i == index else view for i, view in enumerate(views)
    )


@pytest.mark.parametrize("place", [0, 2], ids=["first", "third"])
@pytest.mark.parametrize("shape", ["point", "line"])
@pytest.mark.parametrize("count", [0, None], ids=["pinhole", "count chosen"])
def test_a_view_whose_pixels_are_a_line_is_rejected(
    place: int, shape: str, count: int | None
) -> None:
    views = bare_views(3, 8, 0.1)
    flat = (
        np.full((81, 2), 300.0)
        if shape == "point"
        else np.stack([np.linspace(100, 900, 81), np.linspace(50, 250, 81)], -1)
    )
    estimate = calibrate_bare(
        without(views, place, flat), BOARD, replace(BARE, lens_coefficients=count), Silent()
    )
    assert [item.name for item in estimate.rejected] == [views[place].name]
    assert "one line or point" in estimate.rejected[0].reason
    assert estimate.intrinsics.fx.value == pytest.approx(2558.36, rel=0.005)


@pytest.mark.slow
def test_corners_that_are_no_board_end_with_a_sentence() -> None:
    """Not even a pose follows from them, for which OpenCV raises."""
    rng = np.random.default_rng(0)
    views = tuple(View(f"{i}.png", rng.uniform(0, 2000, (81, 2)), np.ones(81)) for i in range(6))
    with pytest.raises(NotEnoughDataError, match="tilt the board by about 30 degrees"):
        calibrate_bare(views, BOARD, replace(BARE, lens_coefficients=None), Silent())


def test_one_burst_is_too_little_to_choose_a_lens() -> None:
    """Pictures of one pose of the board: nothing can be held out."""
    views = tuple(replace(view, pose_id="only") for view in bare_views(3, 8, 0.1))
    with pytest.raises(NotEnoughDataError, match="poses of the board"):
        calibrate_bare(views, BOARD, replace(BARE, lens_coefficients=None), Silent())


@pytest.mark.parametrize(
    ("kind", "seed"),
    [("flat", 5010), ("flat", 5016), ("one depth", 5005)],
)
@pytest.mark.slow
def test_the_truth_is_within_five_sigma(kind: str, seed: int) -> None:
    """Or there is no calibration.

    The linearised sigma at the first minimum put the truth 26 to 53 of it away.
    """
    shown = bare_session(kind, seed)
    try:
        k = calibrate_bare(shown.views, shown.board, shown.camera, Silent()).intrinsics
    except NotEnoughDataError:
        return
    errors = [
        abs(n.value - true) / n.sigma
        for n, true in zip((k.fx, k.fy, k.cx, k.cy), shown.pinhole, strict=True)
    ]
    assert max(errors) < WRONG


@pytest.mark.parametrize("kind", ["same corners", "two pictures"])
def test_copies_of_pictures_do_not_determine_a_lens(kind: str) -> None:
    shown = bare_session(kind, 5000)
    with pytest.raises(NotEnoughDataError, match="poses of the board"):
        calibrate_bare(shown.views, shown.board, shown.camera, Silent())


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["same corners", "two pictures"])
def test_copies_of_pictures_behind_a_cone_are_not_trusted(kind: str, tmp_path: Path) -> None:
    try:
        estimate = calibration_of(covered_session(kind, 5000), tmp_path)
    except NotEnoughDataError as error:
        assert "counts once" in str(error)  # noqa: PT017
    else:
        assert judge(estimate).word is not Trust.TRUSTED


def copies(count: int) -> tuple[View, ...]:
    """Six views of so many pictures."""
    views = bare_views(3, count, 0.05)
    return tuple(replace(views[index % count], name=f"{index}.png") for index in range(6))


COPIES = ("same corners", "two pictures")
"""Copies of so few pictures are too few views."""
DEGENERATE: dict[str, Callable[[], tuple[View, ...]]] = {
    "same corners": lambda: copies(1),
    "two pictures": lambda: copies(2),
    "one picture twice": lambda: copies(5),
    "exact corners": lambda: bare_views(3, 6, 0.0),
    "exact and parallel": lambda: bare_views(3, 6, 0.0, tilt=0.0),
}


def session(folder: Path, views: tuple[View, ...]) -> Path:
    """Without a cover, intrinsics declared."""
    setup = session_to_yaml(BOARD, Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS), Cover("none", {}))
    written = {"format": 1, **setup, "corners": "corners.vnl"}
    (folder / "session.yaml").write_text(yaml.safe_dump(written))
    write_corners(folder / "corners.vnl", views)
    return folder


@pytest.mark.parametrize("kind", DEGENERATE)
def test_no_command_ends_as_a_bug(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Fitted, judged, evaluated, checked and reported; trusted only where exact corners are those
    of tilted boards.
    """
    folder = session(tmp_path, DEGENERATE[kind]())
    out = str(folder / "out")
    code = main(["fit", str(folder), "-o", out, "--json"])
    if kind in COPIES:
        assert code == 3
        assert "counts once" in capsys.readouterr().err
        return
    assert code == 0
    verdict = json.loads(capsys.readouterr().out)["verdict"]
    assert verdict["word"] == "care" or kind == "exact corners"
    assert main(["evaluate", out, str(folder), "--json"]) == 0
    assert main(["check", out, str(folder)]) in (0, 5)
    assert main(["report", out]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in DEGENERATE if kind not in COPIES])
def test_no_diagnosis_ends_as_a_bug(kind: str, tmp_path: Path) -> None:
    folder = session(tmp_path, DEGENERATE[kind]())
    assert main(["fit", str(folder), "-o", str(folder / "out")]) == 0
    assert main(["diagnose", str(folder / "out"), "-o", str(folder / "diagnosed")]) in (0, 3)
