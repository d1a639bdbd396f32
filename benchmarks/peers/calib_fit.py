"""The project itself as a person runs it: `calib fit SESSION -o OUT` on a session of corners, all
by default, with its report. It is told the lens and the smooth cover, or nothing but "a cone".
"""

import sys
import tempfile
from functools import partial
from pathlib import Path

import yaml

from benchmarks.peers.case import BOARD, Case
from benchmarks.peers.child import Fitted, main
from benchmarks.peers.command import run
from benchmarks.peers.scenes import left, views
from calib.calibration import Calibration
from calib.corners.corners_file import write_corners
from calib.session.camera import Camera
from calib.session.session import session_to_yaml
from fixtures.synthetic import INTRINSICS, paper_cone

SHAPE = "shape"
"""The word for a session that names the cover's shape, and none of its numbers nor the lens."""


def fit(case: Case, which: str) -> Fitted:
    with tempfile.TemporaryDirectory() as folder:
        session, out = Path(folder, "session"), Path(folder, "out")
        session.mkdir()
        setup = session_to_yaml(
            BOARD, Camera(*case.size, intrinsics=INTRINSICS), paper_cone(case.thickness)
        )
        if which == SHAPE:
            width, height = case.size
            setup |= {"camera": {"width": width, "height": height}, "cover": {"shape": "cone"}}
        (session / "session.yaml").write_text(
            yaml.safe_dump({"format": 1, **setup, "corners": "corners.vnl"})
        )
        write_corners(session / "corners.vnl", views(case.train))
        used = run([sys.executable, "-m", "calib", "fit", str(session), "-o", str(out)])
        if not (out / "report.html").is_file():
            raise SystemExit("calib fit left no report")
        made = Calibration.load(out)
    joint = made.outcome.joint
    assert joint
    return Fitted(
        f"refracal {made.refracal}",
        used.seconds,
        joint.iterations,
        partial(left, *made.model()),
        used,
    )


if __name__ == "__main__":
    main(fit)
