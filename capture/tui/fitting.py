"""The process that fits: torch is loaded here, and never in the process that draws the screen.

`python -m capture.tui.fitting SESSION OUT` fits and saves. stdout has one JSON object a line: tasks and their steps, and at the end a
result or an error.
"""

import json
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from calib.errors import RefracalError
from calib.progress import Advance

if TYPE_CHECKING:
    from calib.calibration import Calibration

NICENESS = 10  # the screen and the camera go first


class Lines:
    """Progress as JSON lines."""

    def task(self, title: str, total: int) -> Advance:
        say(event="task", title=title, total=total)
        return lambda done, words: say(event="step", done=done, words=words)


def say(**what: object) -> None:
    print(json.dumps(what), flush=True)


def answer(work: Callable[[], Mapping[str, object]]) -> None:
    """Say the result of some work, or the sentence that it ended with."""
    os.nice(NICENESS)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    try:
        say(event="result", **work())
    except RefracalError as error:
        say(event="error", sentence=str(error))
    except ImportError as error:
        say(event="error", sentence=f"This machine cannot fit ({error}): install torch, or copy the session and run calib fit there.")


def main(session: Path, out: Path) -> None:
    answer(lambda: _fit(session, out))


def _fit(session: Path, out: Path) -> dict[str, object]:
    say(event="task", title="Loading torch", total=1)
    from calib.fitting.fit import fit
    from calib.fitting.stages import Settings
    from calib.io.files import check_writable
    from calib.session.session import read_session

    described = read_session(session)
    check_writable(out)
    calibration = fit(described, Settings(), Lines())
    return summary(calibration, calibration.save(out))


def summary(calibration: "Calibration", saved: Path) -> dict[str, object]:
    """What the results screen shows."""
    from torch import from_numpy

    from calib.estimation.residuals import residuals
    from calib.fitting.remarks import remarks

    seen = calibration.observations
    path, values = calibration.model()
    missed = residuals(path, values, seen, from_numpy(calibration.poses))
    views = [
        {"file": view.name, "rms_px": float((own**2).sum(-1).nanmean().sqrt()), "corners": pixels.tolist(), "errors": own.tolist()}
        for view, own, pixels in zip(calibration.views, seen.per_view(missed.image), seen.per_view(seen.pixels), strict=True)
    ]
    return {
        "calibration": str(saved),
        "stages": [{"name": s.name, "rms_px": s.rms_px, "rmse_cm": s.rmse_cm} for s in calibration.stages],
        "noise_px": calibration.noise_px,
        "views": sorted(views, key=lambda view: -float(str(view["rms_px"]))),
        "rejected": [{"file": r.name, "reason": r.reason} for r in calibration.rejected],
        "remarks": remarks(calibration),
    }


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
