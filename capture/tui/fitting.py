"""The fit as the screen's child does it, for torch is never loaded in the process that draws."""

from pathlib import Path
from typing import TYPE_CHECKING

from calib.progress import Progress
from capture.tui.child import LOADING, MOVE_IT

if TYPE_CHECKING:
    from calib.calibration import Calibration


def fit_session(progress: Progress, session: Path, out: Path) -> dict[str, object]:
    """Fit and save as `calib fit` does. Returns the summary."""
    from calib.session.session import read_session

    described = read_session(session)  # what is wrong with it is said before torch is loaded
    progress.task(LOADING, 1)
    from calib.calibration import DERIVED, FILES
    from calib.fitting.fit import fit
    from calib.fitting.stages import Settings
    from calib.io.file_set import FileSet
    from calib.io.output_folder import check_no_link

    output = FileSet(check_no_link(out), inputs=described.files, elsewhere=MOVE_IT, flag="")
    with output as files:
        files.reserve(FILES)
        calibration = fit(described, Settings(), progress)
        saved = calibration.write(files)
        files.commit(instead_of=DERIVED)
    progress.task("Verdict", 1)
    return summary(calibration, saved)


def open_results(progress: Progress, place: Path) -> dict[str, object]:
    """The summary of a calibration that is there already, by its folder.

    Where a diagnosis of this very fit has found effects, the summary of what that made of it, and
    under `before` the fit's own.
    """
    progress.task(LOADING, 1)
    from calib.calibration import Calibration

    progress.task("Verdict", 1)
    fitted, better = Calibration.load(place), place / "diagnosed"
    fit = summary(fitted, place / "calibration.yaml")
    if (better / "calibration.yaml").exists():
        diagnosed = Calibration.load(better)
        if diagnosed.effects and diagnosed.stages[: len(fitted.stages)] == fitted.stages:
            return summary(diagnosed, better / "calibration.yaml") | {"before": fit}
    return fit


def summary(calibration: "Calibration", saved: Path) -> dict[str, object]:
    """What the results screen shows."""
    import numpy as np
    from torch import from_numpy

    from calib.estimation.residuals import residuals
    from calib.fitting.view_noise import VIEW_NOISE, noisier
    from calib.verdict.judge import judge
    from calib.verdict.sureness import map_sigmas

    verdict = judge(calibration, folder=saved.parent)
    seen = calibration.observations
    path, values = calibration.model()
    depth = path.place(
        seen.corners, seen.with_times(values), from_numpy(calibration.poses)[seen.view]
    )[:, 2]
    near, usual, far = (
        float(f"{edge:.2g}") for edge in (depth.min(), np.median(depth), depth.max())
    )  # the verdict's median
    missed = residuals(path, values, seen, from_numpy(calibration.poses))
    views = [
        {
            "file": view.name,
            "rms_px": float((own**2).sum(-1).nanmean().sqrt()),
            "corners": pixels.tolist(),
            "errors": own.tolist(),
        }
        for view, own, pixels in zip(
            calibration.views, seen.per_view(missed.image), seen.per_view(seen.pixels), strict=True
        )
    ]
    return {
        "calibration": str(saved),
        "stages": [
            {"name": s.name, "title": s.title, "rms_px": s.rms_px, "rmse_cm": s.rmse_cm}
            for s in calibration.stages
        ],
        "noise_px": calibration.noise_px,
        "views": sorted(views, key=lambda view: -float(str(view["rms_px"]))),
        "noisier": noisier(calibration.settings.get(VIEW_NOISE, {})),
        "rejected": [{"file": r.name, "reason": r.reason} for r in calibration.rejected],
        "verdict": {"word": verdict.word.value, "sentences": verdict.sentences},
        "sigma_px": [
            {"depth_m": depth, "px": px}
            for depth, px in map_sigmas(calibration, (near, usual, far)).items()
        ],
    }
