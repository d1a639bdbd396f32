"""Every screen as it should look, at both sizes: the texts in snapshots/ are what a terminal
without colours shows.

Colours never carry meaning, so the characters are the contract; they are also what a reader of a
diff can judge. `REFRACAL_SNAPSHOTS=write python -m pytest tests/capture/tui/test_snapshots.py`
writes them anew: look at each before it is committed. With REFRACAL_PICTURES=FOLDER each is drawn
there in its colours too.
"""

import os
import shutil
from collections.abc import Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from textual.pilot import Pilot

from calib.corners.detect import eight_bits
from calib.io.images import read_grey
from calib.planning.pose_bank import Reach, project_bare
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.session import session_to_yaml
from capture.coverage import Hint, KeptView, SessionProgress, make_hint
from capture.finders import make_finder
from capture.frames import Frame
from capture.session_file import read_setup
from capture.tui.child import LOADING, Child
from capture.tui.collect import FIT_FIRST, CollectScreen
from capture.tui.diagnosing import as_text
from capture.tui.effects import EffectsScreen
from capture.tui.fit import FitScreen
from capture.tui.fitting import fit_session
from capture.tui.results import ResultsScreen
from capture.tui.working_page import WorkingPage
from fixtures.coded_boards import CHARUCO, LENS
from tests.capture.tui.driving import (
    SIZES,
    describe,
    drive,
    running,
    see,
    shown,
    start_through_cover,
    until,
)
from tests.capture.tui.test_effects import FINDING, NUMBERS, WORDS
from tests.capture.tui.test_session import FIXTURE

CAMERA = "v4l2:/dev/video0"
"""A source that may give more views, unlike a folder that has ended."""
FOLDER = Path(__file__).parent / "snapshots"
PAUSES = 100
"""The pauses in which a screen must have become its snapshot."""
HINT = Hint(
    np.array([[60.0, 150.0], [330, 120], [350, 420], [40, 450]]),
    np.zeros(6),
    "closer, to the left edge, tilt the right side away",
)
PROGRESS = SessionProgress(
    is_enough=False,
    sentence="The maps would be 0.31 px off; 0.10 px is wanted: about 6 more views.",
    sigma_px=0.31,
    views_needed=6,
    image=np.linspace(0, 1, 48).reshape(6, 8),
    depth=np.array([0.0, 0.5, 1.0, 1.0]),
    glass=np.linspace(1, 0, 48).reshape(6, 8),
)
CORNERS = (
    np.stack(np.meshgrid(np.linspace(300, 600, 9), np.linspace(200, 500, 9)), -1)
    .reshape(-1, 2)
    .tolist()
)
DESCRIPTION = [
    {
        "name": "camera",
        "title": "Camera: 640x480 px, lens opencv with 5 coefficients",
        "rows": [
            ["camera.fx", "503.21 ± 0.42 px", "500 ± 10 px", "", "0.3 × tolerance"],
            ["camera.fy", "503.10 ± 0.43 px", "500 ± 10 px", "", "0.3 × tolerance"],
            ["camera.cx", "321.02 ± 0.31 px", "320 ± 13 px", "", "0.1 × tolerance"],
            ["camera.cy", "238.77 ± 0.29 px", "240 ± 13 px", "", "0.1 × tolerance"],
            ["camera.k1", "-0.3121 ± 0.0014", "", "", ""],
            ["camera.k2", "0.1105 ± 0.0031", "", "", ""],
            ["camera.p1", "0.00021 ± 0.00012", "", "", ""],
            ["camera.p2", "-0.00035 ± 0.00011", "", "", ""],
            ["camera.k3", "-0.0212 ± 0.0044", "", "", ""],
        ],
    },
    {
        "name": "cover",
        "title": "Cover: a dome with an even outer surface",
        "rows": [
            ["cover.inner_radius", "49.21 ± 0.31 mm", "50.0 ± 2.0 mm", "", "0.4 × tolerance"],
            ["cover.centre.x", "0.12 ± 0.11 mm", "0.0 ± 2.0 mm", "", "0.1 × tolerance"],
            ["cover.centre.y", "-0.07 ± 0.11 mm", "0.0 ± 2.0 mm", "", "0.0 × tolerance"],
            [
                "cover.centre.z",
                "-4.31 ± 0.45 mm",
                "0.0 ± 2.0 mm",
                "contradicted",
                "2.5 × tolerance",
            ],
            ["cover.thickness", "3.05 ± 0.12 mm", "3.00 ± 0.50 mm", "", "0.1 × tolerance"],
            ["cover.refractive_index", "1.496 ± 0.011", "1.490 ± 0.020", "", "0.3 × tolerance"],
            ["cover.outside_index", "1", "1", "not fitted", ""],
        ],
    },
    {
        "name": "pictures",
        "title": "Pictures",
        "rows": [
            ["coverage", "81 % of the picture", "", "", ""],
            ["depth", "0.3 to 1.2 m", "", "", ""],
            ["squares", "20 mm, as stated", "", "", ""],
        ],
    },
]
ANGLES = np.linspace(-0.6, 0.6, 31)
DOME = np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1)
RESULT = {
    "event": "result",
    "calibration": "session/calibration/calibration.yaml",
    "numbers": DESCRIPTION,
    "cover_section": [(0.045 * DOME).tolist(), (0.048 * DOME).tolist()],
    "stages": [
        {"name": "pinhole", "title": "camera alone", "rms_px": 2.41, "rmse_cm": 0.161},
        {"name": "cover", "title": "smooth cover", "rms_px": 0.412, "rmse_cm": 0.0275},
        {"name": "cover+rbf", "title": "fitted cover", "rms_px": 0.079, "rmse_cm": 0.0053},
    ],
    "noise_px": 0.071,
    "sides": "squares are 20 mm",
    "views": [
        {
            "file": f"{number:04d}.jpg",
            "rms_px": 0.2 / (2 + number),
            "corners": CORNERS,
            "errors": [[0.1, 0.0]] * 80 + [[0.3, 0.4]],
        }
        for number in (1, 2, 3, 5, 7, 9)
    ],
    "rejected": [],
    "verdict": {
        "word": "trusted",
        "sentences": ["You can trust this calibration where the board was in the picture."],
    },
    "sigma_px": [
        {"depth_m": 0.3, "px": 0.021},
        {"depth_m": 0.55, "px": 0.012},
        {"depth_m": 1.2, "px": 0.009},
    ],
}

Story = Callable[[Pilot[None], Path], Coroutine[Any, Any, None]]


async def new_setup(pilot: Pilot[None], _: Path) -> None:
    await see(pilot, "folder:PATH plays back pictures")
    await see(pilot, "Where pictures come from")


async def full_setup(pilot: Pilot[None], _: Path) -> None:
    await see(pilot, "folder:PATH plays back pictures")
    await see(pilot, "Where pictures come from")
    await describe(pilot, "folder:camera/bare")


async def wrong_setup(pilot: Pilot[None], _: Path) -> None:
    await see(pilot, "folder:PATH plays back pictures")
    await see(pilot, "Where pictures come from")
    await pilot.press("tab", "tab", "tab", "tab", "tab", *"0.02")
    await see(pilot, "if metres were meant")


async def charuco_setup(pilot: Pilot[None], _: Path) -> None:
    await see(pilot, "folder:PATH plays back pictures")
    await pilot.press("tab", "tab", "enter", "down", "enter")
    await see(pilot, "marker_mm")
    await pilot.press("tab", "tab", "tab", *"20", "tab", *"15", "tab", "ctrl+u", *"DICT_9X9")
    await see(pilot, "one of OpenCV's names")


async def aprilgrid_setup(pilot: Pilot[None], _: Path) -> None:
    await see(pilot, "folder:PATH plays back pictures")
    await pilot.press("tab", "tab", "enter", "down", "down", "enter")
    await see(pilot, "tag_mm")
    await pilot.press("tab")
    await see(pilot, "How many tags there are along one row")


async def continued_setup(pilot: Pilot[None], session: Path) -> None:
    del session
    await see(pilot, "continued")


async def collect(pilot: Pilot[None], _: Path) -> None:
    await see(pilot, "continued")
    await start_through_cover(pilot)
    await see(pilot, "no more pictures")
    await see(pilot, "3 views")
    screen = pilot.app.screen
    assert isinstance(screen, CollectScreen)
    await until(
        pilot, lambda: screen._adviser is not None and "by the fit" in screen._adviser.remark
    )  # it has said all that it will
    await pilot.pause(0.5)
    screen.post_message(CollectScreen.AdviceReady(3, HINT, PROGRESS))
    await see(pilot, FIT_FIRST)
    screen._improving = True
    screen.post_message(CollectScreen.AdviceReady(3, HINT, PROGRESS))
    await see(
        pilot, "The fit finds it, and says how accurate the maps are: press f."
    )  # not that it is computed: the lens is not known
    screen.post_message(CollectScreen.GuideImproved(done=True))
    await see(pilot, FIT_FIRST)  # the answer comes once it is there
    screen.post_message(CollectScreen.AdviceReady(3, HINT, PROGRESS))
    await pilot.pause(0.5)
    assert HINT.instruction not in shown(pilot)
    screen.plan = replace(screen.plan, source=CAMERA)
    screen.post_message(CollectScreen.AdviceReady(3, HINT, PROGRESS))
    await see(pilot, f"Next: {HINT.instruction}.")


async def collect_enough(pilot: Pilot[None], session: Path) -> None:
    await collect(pilot, session)
    done = SessionProgress(
        True,
        "The maps are 0.09 px off, as is wanted.",
        0.09,
        0,
        PROGRESS.image,
        PROGRESS.depth,
        PROGRESS.glass,
    )
    pilot.app.screen.post_message(CollectScreen.AdviceReady(3, None, done))
    await pilot.press("a")
    await see(pilot, "ENOUGH")


async def collect_charuco(pilot: Pilot[None], session: Path) -> None:
    """A board over the left edge, and a hint over the right one."""
    await see(pilot, "continued")
    await pilot.press("ctrl+s")
    await see(pilot, "no more pictures")
    await see(pilot, "1 view")
    screen = pilot.app.screen
    assert isinstance(screen, CollectScreen)
    await until(pilot, lambda: screen._adviser is not None and not screen._improving)
    await pilot.pause(0.5)
    board, camera, _ = read_setup(session / "session.yaml")
    picture = next((session / "frames").glob("*.png"))
    screen._corners = make_finder(board).look(Frame(eight_bits(read_grey(picture)), 0, 1.0)).corners
    assert screen._corners is not None
    pose = np.array([0.0, -0.5, 0.0, 0.15, 0.0, 0.25])
    hint = make_hint(
        pose,
        project_bare(board, camera, pose),
        [KeptView(screen._corners)],
        board,
        camera,
        Reach.of(board, camera),
    )
    screen.plan = replace(screen.plan, source=CAMERA)
    screen.post_message(CollectScreen.AdviceReady(1, hint, PROGRESS))
    await see(pilot, "over the right edge (a part outside)")
    await see(pilot, "The maps would be 0.31 px")


def take_over(screen: WorkingPage) -> Child:
    """End the process that the screen has started, and put this one, which never starts, in its
    place: the story gives its events.
    """
    screen.cancel()
    screen._tasks.clear()
    screen.child = Child(fit_session)
    return screen.child


async def fit(pilot: Pilot[None], session: Path) -> None:
    screen = FitScreen(session / "missing")
    await pilot.app.push_screen(screen)
    child = take_over(screen)
    events = [
        (LOADING, 1, 1, ""),
        ("Corners in session", 12, 12, "12 boards found"),
        ("Joint fit", 12, 4, "0.121 px"),
    ]
    for title, total, done, words in events:
        screen.post_message(
            FitScreen.ProcessReported(child, {"event": "task", "title": title, "total": total})
        )
        screen.post_message(
            FitScreen.ProcessReported(child, {"event": "step", "done": done, "words": words})
        )
    screen.post_message(
        FitScreen.ProcessReported(child, {"event": "step", "done": 7, "words": "0.084 px"})
    )
    await see(pilot, "0.084 px")


async def fit_failed(pilot: Pilot[None], session: Path) -> None:
    await pilot.app.push_screen(FitScreen(session / "missing"))
    await see(pilot, "does not exist")


async def results(pilot: Pilot[None], session: Path) -> None:
    await pilot.app.push_screen(ResultsScreen(session, RESULT, RESULT))
    await see(pilot, "◆ worst: 0.50 px off")
    await see(pilot, "q Quit")


async def results_numbers(pilot: Pilot[None], session: Path) -> None:
    """Camera and cover, in place of the views where the terminal is small."""
    await results(pilot, session)
    await pilot.press("n")
    await see(pilot, "From the side")


async def results_dropped(pilot: Pilot[None], session: Path) -> None:
    await results(pilot, session)
    await pilot.press("down", "down", "d")
    await see(pilot, "is set aside")


async def results_doubtful(pilot: Pilot[None], session: Path) -> None:
    """The longest possible text."""
    reasons = [
        (
            "the error is 0.227 px, 4.8 times the corners' noise of about 0.047 px: it may be"
            " board_shape. A fit with board_shape would have 87 % less error."
        ),
        (
            "cover.thickness 5.49 ± 0.43 mm, declared as 3.00 ± 0.50 mm, 9.8 standard deviations"
            " apart: find what the model lacks first."
        ),
        *[
            "Only 47 % of the picture has corners: take views with the board where the picture is"
            " empty."
        ]
        * 2,
    ]
    rejected = [
        {"file": f"{number:04d}.jpg", "reason": "no board of 9x9 corners was found"}
        for number in (4, 6, 8)
    ]
    doubtful = {
        **RESULT,
        "verdict": {"word": "care", "sentences": ["Take care before you trust it.", *reasons]},
        "rejected": rejected,
    }
    await pilot.app.push_screen(ResultsScreen(session, doubtful))
    await see(pilot, "◆ worst: 0.50 px off")
    await see(pilot, "Press e to find faults, r for the report, x for maps and straight pictures.")


async def effects(pilot: Pilot[None], session: Path) -> None:
    screen = EffectsScreen(session / "missing")
    await pilot.app.push_screen(screen)
    take_over(screen)
    screen.finished(
        {**RESULT, "accepted": ["board_shape"], "text": as_text(FINDING, NUMBERS, WORDS)}
    )
    await see(pilot, "enter Use them")


async def effects_working(pilot: Pilot[None], session: Path) -> None:
    screen = EffectsScreen(session / "missing")
    await pilot.app.push_screen(screen)
    await see(pilot, "esc cancels")
    child = take_over(screen)
    screen.post_message(
        EffectsScreen.ProcessReported(child, {"event": "task", "title": "Diagnosis", "total": 20})
    )
    screen.post_message(
        EffectsScreen.ProcessReported(
            child, {"event": "step", "done": 4, "words": "fit with board_shape"}
        )
    )
    await see(pilot, "fit with board_shape")
    await see(pilot, "esc Back ? Help")


async def export(pilot: Pilot[None], session: Path) -> None:
    await results(pilot, session)
    await pilot.press("x", *" 0.5m")
    await see(pilot, "is not a depth")


async def help_page(pilot: Pilot[None], session: Path) -> None:
    await results(pilot, session)
    await pilot.press("question_mark")
    await see(pilot, "The last line has every key")


NEW: tuple[Story, ...] = (new_setup, full_setup, wrong_setup, charuco_setup, aprilgrid_setup)
CONTINUED: tuple[Story, ...] = (
    *(continued_setup, collect, collect_enough, fit, fit_failed),
    *(
        results,
        results_numbers,
        results_dropped,
        results_doubtful,
        effects,
        effects_working,
        export,
        help_page,
    ),
)


@pytest.mark.parametrize(
    "story",
    [*NEW, *CONTINUED, pytest.param(collect_charuco, marks=pytest.mark.slow)],
    ids=lambda story: story.__name__,
)
def test_screens_look_like_their_snapshots(
    story: Story, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The story is told in the small terminal, which then grows."""
    monkeypatch.chdir(tmp_path)  # so that the paths on the screen are the same everywhere
    for name in ("bare", "frames"):
        shutil.copytree(FIXTURE / name, tmp_path / "camera" / name)
    if story is collect_charuco:
        record_charuco(tmp_path)
    if story in CONTINUED:
        (tmp_path / "session" / "frames").mkdir(parents=True)
        shutil.copy(FIXTURE / "session.yaml", tmp_path / "session")
        for number in (1, 2, 3):
            shutil.copy(FIXTURE / "frames" / f"000{number}.jpg", tmp_path / "session" / "frames")
        shutil.rmtree(tmp_path / "camera" / "frames")
        (tmp_path / "camera" / "frames").mkdir()
        shutil.copy(FIXTURE / "frames" / "0001.jpg", tmp_path / "camera" / "frames")
    drive(_compare(story))


def record_charuco(folder: Path) -> None:
    """A session without a cover, and one photograph for it."""
    (folder / "session").mkdir()
    camera = Camera(LENS.width, LENS.height)
    described = {"format": 1, **session_to_yaml(CHARUCO.board, camera, Cover("none", {}))}
    (folder / "session" / "session.yaml").write_text(yaml.safe_dump(described))
    shutil.rmtree(folder / "camera")
    (folder / "camera").mkdir()
    cv2.imwrite(
        str(folder / "camera" / "0.png"),
        CHARUCO.view(np.array([0.2, 0.3, 0.1, -0.09, 0.0, 0.25])).picture,
    )


async def _compare(story: Story) -> None:
    source = "" if story in NEW else "folder:camera"
    small, *larger = SIZES
    async with running(Path("session"), source, small) as pilot:
        await story(pilot, Path("session"))
        await _compare_screen(pilot, story.__name__, small)
        for size in larger:
            await pilot.resize_terminal(*size)
            await _compare_screen(pilot, story.__name__, size)


async def _compare_screen(pilot: Pilot[None], name: str, size: tuple[int, int]) -> None:
    """Give the screen time to follow the size, then compare it with its snapshot."""
    file = FOLDER / f"{name}-{size[0]}x{size[1]}.txt"
    writes = os.environ.get("REFRACAL_SNAPSHOTS") == "write"
    for _ in range(PAUSES):
        if not writes and shown(pilot) + "\n" == file.read_text():
            break
        await pilot.pause(0.05)
    text = shown(pilot) + "\n"
    if folder := os.environ.get("REFRACAL_PICTURES"):
        (Path(folder) / f"{name}-{size[0]}.svg").write_text(pilot.app.export_screenshot())
    if writes:
        FOLDER.mkdir(exist_ok=True)
        file.write_text(text)
    assert text == file.read_text()
