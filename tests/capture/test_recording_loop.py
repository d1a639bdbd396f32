"""From frames to pictures: what a pressed shutter takes."""

from pathlib import Path

import numpy as np

from calib.io.images import read_image
from capture.find import finder_of
from capture.frames import Frame
from capture.recorder import Recorder
from capture.recording_loop import Plan, Shutter, record
from tests.capture.recordings import BOARD, FIXTURE


def photographs(*names: str) -> list[Frame]:
    """Of the fixture; nothing is in `blank`."""
    blank = np.full((1232, 1640), 100, np.uint8)
    read = [blank if name == "blank" else np.asarray(read_image(FIXTURE / "frames" / name), np.uint8) for name in names]
    return [Frame(pixels, 0, 0.0, name=name, alone=True) for name, pixels in zip(names, read, strict=True)]


def test_a_press_takes_the_next_board_but_no_recorded_picture_twice(tmp_path: Path) -> None:
    shutter, finder = Shutter(), finder_of(BOARD)
    shutter.automatic = False
    kept: list[np.ndarray] = []
    with Recorder(tmp_path, BOARD) as recorder:
        for names, taken in ((("blank", "0000.jpg"), "0000.jpg"), (("0000.jpg", "0001.jpg"), "0001.jpg"), (("0000.jpg", "0001.jpg"), None)):
            shutter.press()
            steps = list(record(photographs(*names), finder, recorder, Plan(None), kept, shutter))
            assert [step.frame.name for step in steps if step.picture] == [taken] * bool(taken)
