"""Calibrations of known truth to report on, and a session folder with pictures."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from calib.calibration import Calibration
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.io.file_set import FileSet
from calib.progress import Silent
from calib.report.effects import EffectRow
from calib.report.write import write_report
from calib.session.session import read_session
from fixtures.synthetic import HEIGHT, WIDTH, Scene
from tests.test_calibration import write_session

SETTINGS = Settings(grid=(6, 6), folds=3, free=("none",))


def calibrated(made: Scene, folder: Path, settings: Settings = SETTINGS) -> Calibration:
    return fit(read_session(write_session(folder, made)), settings, Silent())


def report_in(
    folder: Path,
    calibration: Calibration,
    depths: Sequence[float] = (),
    effects: Sequence[EffectRow] | None = None,
) -> Path:
    """The report of a calibration that a folder would hold."""
    with FileSet(folder) as files:
        path = write_report(calibration, files, Silent(), depths, effects)
        files.commit()
    return path


def add_pictures(session: Path, made: Scene) -> None:
    """A picture for every view: grain of a sensor on a board-like pattern, compressed, the same one
    under every name.
    """
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    picture = 60 + 120 * ((x // 90 + y // 90) % 2) + rng.normal(0, 4, (HEIGHT, WIDTH))
    data = cv2.imencode(".jpg", np.clip(picture, 0, 255).astype(np.uint8))[1].tobytes()
    (session / "frames").mkdir()
    for view in made.views:
        (session / "frames" / view.name).write_bytes(data)
