"""The recording loop: which frames a pressed shutter takes."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.io.images import read_image
from capture.finders import make_finder
from capture.frames import Frame
from capture.recorder import Recorder
from capture.recording_loop import RecordingPlan, ShutterButton, record_views, refusal_reason
from capture.tui.drop import drop_picture
from tests.capture.recordings import BOARD, FIXTURE


def photographs(*names: str) -> list[Frame]:
    """Yield photographs of the fixture; `blank` shows no board."""
    blank = np.full((1232, 1640), 100, np.uint8)
    read = [
        blank if name == "blank" else np.asarray(read_image(FIXTURE / "frames" / name), np.uint8)
        for name in names
    ]
    return [
        Frame(pixels, 0, 0.0, name=name, isolated=True)
        for name, pixels in zip(names, read, strict=True)
    ]


def test_a_press_takes_the_next_board_but_no_recorded_picture_twice(tmp_path: Path) -> None:
    shutter, finder = ShutterButton(), make_finder(BOARD)
    shutter.automatic = False
    recorded: list[np.ndarray] = []
    with Recorder(tmp_path, BOARD) as recorder:
        for names, taken in (
            (("blank", "0000.jpg"), "0000.jpg"),
            (("0000.jpg", "0001.jpg"), "0001.jpg"),
            (("0000.jpg", "0001.jpg"), None),
        ):
            shutter.press()
            steps = list(
                record_views(
                    photographs(*names), finder, recorder, RecordingPlan(None), recorded, shutter
                )
            )
            assert [step.frame.name for step in steps if step.picture] == [taken] * bool(taken)


def test_pictures_that_were_set_aside_are_not_taken_again_from_a_folder(tmp_path: Path) -> None:
    """A camera's frames have no name: there the person wants a better picture of that view."""
    finder = make_finder(BOARD)
    with Recorder(tmp_path, BOARD) as recorder:
        (step,) = record_views(photographs("0000.jpg"), finder, recorder, RecordingPlan(None), [])
        taken = step.picture
        assert taken
        drop_picture(tmp_path, taken.name)
        shutter = ShutterButton()
        for press in (False, True):
            if press:
                shutter.press()
            steps = list(
                record_views(
                    photographs("0000.jpg", "0001.jpg"),
                    finder,
                    recorder,
                    RecordingPlan(None),
                    [],
                    shutter,
                )
            )
            assert [(step.frame.name, bool(step.picture)) for step in steps] == [
                ("0000.jpg", False),
                ("0001.jpg", True),
            ]
            assert "set aside" in steps[0].decision.sentence
            assert "set aside" in refusal_reason(steps[0])
        (frame,) = photographs("0000.jpg")
        (step,) = record_views([replace(frame, name="")], finder, recorder, RecordingPlan(None), [])
        assert step.picture


def moving_board(*, pause: bool) -> list[Frame]:
    """A video at 15 frames a second of a board that moves by 90 px/s, and rests in its middle if
    asked for.
    """
    picture = np.asarray(read_image(FIXTURE / "frames" / "0000.jpg"), np.uint8)
    shifts = [6 * k for k in range(-15, 1)] + [0] * (4 * pause) + [6 * k for k in range(1, 16)]
    return [
        Frame(np.roll(picture, shift, 1), k, k / 15, metadata={"shift": shift})
        for k, shift in enumerate(shifts)
    ]


def test_a_board_that_never_rests_is_kept_from_a_video_alone(tmp_path: Path) -> None:
    """From a camera, the person is asked to hold it still; a video is as it is. Where the board
    rests, that frame is taken.
    """
    for played, pause, kept in ((False, False, 0), (True, False, 1), (True, True, 1)):
        folder = tmp_path / f"{played} {pause}"
        plan = RecordingPlan(None, played=played)
        with Recorder(folder, BOARD) as recorder:
            steps = list(
                record_views(moving_board(pause=pause), make_finder(BOARD), recorder, plan, [])
            )
            assert len(recorder.pictures) >= kept
            assert bool(recorder.pictures) == bool(kept)
        shifts = [step.frame.metadata["shift"] for step in steps if step.picture]
        assert len(shifts) == len(set(shifts))
        assert (0 in shifts) or not pause
