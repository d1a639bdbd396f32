"""The handshake with a page that speaks as a browser's: whole poses, again and again, and nothing
lost.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("aiohttp", reason="the extra `serve` is not installed")

from calib.fringes.decode import ScreenPoints
from calib.session.session import read_session
from capture.screen import eye, timing
from capture.screen.pitch import known_pitch
from fixtures.screen import ScreenCamera, place_errors
from fixtures.simulated_screen import (
    LAG_S,
    PITCH,
    SCREEN,
    Drawing,
    Light,
    SimulatedCamera,
    StandIn,
    Told,
    recording,
)

NEAR = ScreenCamera(width=80, height=60, jpeg=None)
FAR = replace(NEAR, scale=2.4)


@pytest.fixture(autouse=True)
def _short_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulated screen is fast."""
    monkeypatch.setattr(eye, "WATCHED_S", 8 * LAG_S)
    monkeypatch.setattr(timing, "MIN_LAG_S", LAG_S)
    monkeypatch.setattr(timing, "MARGIN_S", 0.0)


def points_of(path: Path) -> ScreenPoints:
    with np.load(path) as arrays:
        return ScreenPoints(arrays["pixels"], arrays["target"], arrays["covariance"])


def check_pose(path: Path, camera: ScreenCamera) -> None:
    """Every point lies where the camera's ray truly meets the screen."""
    errors = place_errors(points_of(path), camera, SCREEN)
    assert errors.rms_px < 0.02
    assert 0.75 < errors.deviation < 1.25  # with some hundred points


@pytest.mark.slow
def test_poses_are_a_session_of_points_and_go_on_where_they_were(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    listener = Told()
    camera = SimulatedCamera(light := Light(), [NEAR, FAR])
    with (
        recording(folder, camera, poses=1, listener=listener) as (made, page),
        StandIn(light).open(page.address),
    ):
        made.run()
    check_pose(folder / "points" / "0000.npz", NEAR)
    first = (folder / "points" / "0000.npz").read_bytes()
    written = yaml.safe_load((folder / "session.yaml").read_text())["target"]
    assert written["pitch_mm"]["value"] == pytest.approx(1000 * PITCH)
    assert 0.002 < written["pitch_mm"]["sigma"] / written["pitch_mm"]["value"] < 0.004

    camera = SimulatedCamera(light := Light(), [FAR])
    page_without_browser = StandIn(light)
    with (
        recording(folder, camera, poses=2, listener=listener) as (made, page),
        page_without_browser.open(page.address),
    ):
        made.run()
    assert not any("large is a pixel" in line for line in page_without_browser.sentences)
    assert (folder / "points" / "0000.npz").read_bytes() == first
    check_pose(folder / "points" / "0001.npz", FAR)
    session = read_session(folder)
    assert len(session.points) == 2
    assert session.board.relative_sigma == pytest.approx(
        written["pitch_mm"]["sigma"] / written["pitch_mm"]["value"]
    )


@pytest.mark.slow
def test_a_browser_that_is_closed_and_opened_costs_a_pose_and_nothing_else(tmp_path: Path) -> None:
    """The page goes in the middle of the first pose, and once more while the second begins."""
    seen: Iterator[int] = iter(range(1000))

    def close_sometimes(_: int) -> None:
        if next(seen) in (12, 60):
            page_without_browser.reopen()

    listener = Told()
    camera = SimulatedCamera(light := Light(), [NEAR])
    page_without_browser = StandIn(light, close_sometimes)
    pitch = known_pitch(1000 * PITCH)
    with (
        recording(tmp_path, camera, poses=2, listener=listener, pitch=pitch) as (made, page),
        page_without_browser.open(page.address),
    ):
        made.run()
    lost = [line for line in listener.sentences if "closed" in line or "opened anew" in line]
    assert len(lost) >= 2
    for name in ("0000.npz", "0001.npz"):
        check_pose(tmp_path / "points" / name, NEAR)


@pytest.mark.slow
def test_a_pose_that_moved_is_taken_again(tmp_path: Path) -> None:
    """The screen is pushed by a tenth of a pixel between two fringes."""
    pushed = replace(NEAR, scale=NEAR.scale * 1.003)
    count = iter(range(1000))

    def push(_: int) -> None:
        if next(count) == 20:
            camera.pose = 1

    listener = Told()
    camera = SimulatedCamera(light := Light(), [NEAR, pushed, NEAR])
    with (
        recording(tmp_path, camera, poses=1, listener=listener) as (made, page),
        StandIn(light, push).open(page.address),
    ):
        made.run()
    assert any("moved by" in line for line in listener.sentences)
    check_pose(tmp_path / "points" / "0000.npz", pushed)


class LateLight(Light):
    """A screen whose lower half shows one pattern after the next one has begun."""

    def __init__(self, late: int) -> None:
        super().__init__()
        self._until_late = late

    def draw(self, drawing: Drawing) -> None:
        self._until_late -= 1
        if self._until_late == 0:
            half = SCREEN.height // 2
            drawing = np.concatenate([drawing[:half], self.drawings[-1][1][half:]])
        super().draw(drawing)


@pytest.mark.slow
def test_a_pose_with_a_torn_picture_is_taken_again(tmp_path: Path) -> None:
    listener = Told()
    camera = SimulatedCamera(light := LateLight(30), [NEAR])
    pitch = known_pitch(1000 * PITCH)
    with (
        recording(tmp_path, camera, poses=1, listener=listener, pitch=pitch) as (made, page),
        StandIn(light).open(page.address),
    ):
        made.run()
    assert sum("two patterns at once" in line for line in listener.sentences) == 1
    check_pose(tmp_path / "points" / "0000.npz", NEAR)


@pytest.mark.slow
def test_a_pose_takes_less_than_15_seconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera takes 30 pictures a second, and sees a pattern 0.15 s after it was drawn; the page
    waits for two frames of 60 Hz. The first pose also measures this delay.
    """
    monkeypatch.undo()  # the screen is watched as long as a real one
    listener = Told()
    camera = SimulatedCamera(light := Light(lag_s=0.15), [NEAR], pause_s=1 / 30)
    page_without_browser = StandIn(light, answer_s=2 / 60)
    pitch = known_pitch(1000 * PITCH)
    with (
        recording(tmp_path, camera, poses=2, listener=listener, pitch=pitch, period=None) as (
            made,
            page,
        ),
        page_without_browser.open(page.address),
    ):
        made.run()
    seconds = [int(sentence.split()[-2]) for _, sentence in listener.poses]
    print(f"poses in {seconds} s")
    assert seconds[0] < 20
    assert seconds[1] < 15
    check_pose(tmp_path / "points" / "0001.npz", NEAR)
