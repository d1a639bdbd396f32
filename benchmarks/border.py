"""What boards that reach out of the picture are worth at its border: the tables of docs/corners.md.

Three sessions of one camera behind one glass, of 24 views each: whole checkerboards, and boards with markers of which a third reach out.
Held out are views whose boards all do. A view's pose is fitted to all of its corners, as by `calib evaluate`.

python -m benchmarks.border
"""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views
from calib.progress import Silent
from calib.session.session import Session, read_session
from calib.threads import single_thread

FIXTURES = Path(__file__).parents[1] / "fixtures"
CHECKERBOARD = "bumps"
WITH_MARKERS = ("charuco", "aprilgrid")
BORDER = 0.1
"""Of the picture's width and height, on every side."""


def held_out(calibration: Calibration, session: Session) -> tuple[np.ndarray, np.ndarray]:
    """(N,) px that every corner is off with the pose of its view fitted, and whether it is at the picture's border."""
    views, _ = read_views(session, Silent())
    observations = Observations.of(views, session.board)
    path, values = calibration.model()
    with single_thread():
        _, missed = refit_poses(path, values, observations, pinhole_poses(observations, values))
    size = np.array([session.camera.width, session.camera.height])
    inwards = np.minimum(observations.pixels.numpy() + 0.5, size - 0.5 - observations.pixels.numpy()) / size
    return missed.image.norm(dim=-1).numpy(), (inwards < BORDER).any(1)


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).mean()))


def main() -> None:
    names = (CHECKERBOARD, *WITH_MARKERS)
    calibrations = {name: fit(read_session(FIXTURES / name)) for name in names}
    judges = {f"{name}/holdout": read_session(FIXTURES / name / "holdout") for name in (*WITH_MARKERS, CHECKERBOARD)}
    table = Table("judged on", "corners there", *names, *(f"{name}, lower by" for name in WITH_MARKERS), title="px RMS")
    for where in ("border", "rest"):
        for judge, session in judges.items():
            found = {name: held_out(calibrations[name], session) for name in names}
            _, at_border = found[CHECKERBOARD]
            chosen = at_border if where == "border" else ~at_border
            left = {name: rms(errors[chosen]) for name, (errors, _) in found.items()}
            lower = (f"{100 * (1 - left[name] / left[CHECKERBOARD]):.0f} %" for name in WITH_MARKERS)
            table.add_row(f"{judge}, {where}", str(chosen.sum()), *(f"{value:.4f}" for value in left.values()), *lower)
    Console(width=160).print(table)
    for name, calibration in calibrations.items():
        print(f"{name}: {len(calibration.views)} views, {sum(view.count for view in calibration.views)} corners")


if __name__ == "__main__":
    main()
