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
