"""The fit in the screen's child process: the process that draws never loads torch."""

from pathlib import Path
from typing import TYPE_CHECKING

from calib.io.result_names import CALIBRATION_FILE
from calib.progress import Progress
from capture.tui.child import LOADING, MOVE_IT

if TYPE_CHECKING:
    from calib.calibration import Calibration


def fit_session(progress: Progress, session: Path, out: Path) -> dict[str, object]:
    """Fit and save as `calib fit` does. Return the summary."""
    from calib.session.session import read_session

    session_input = read_session(session)  # its errors are reported before torch is loaded
    progress.task(LOADING, 1)
    from calib.calibration_file import DERIVED, FILES
    from calib.fit_record.request import Settings
    from calib.fitting.fit import fit
    from calib.io.file_set import FileSet
    from calib.io.output_folder import check_no_link

    inputs = session_input.files
    with FileSet(check_no_link(out), inputs=inputs, elsewhere=MOVE_IT, flag="") as files:
        files.reserve(FILES)
        calibration = fit(session_input, Settings(), progress)
        saved = calibration.write(files)
        files.commit(instead_of=DERIVED)
    progress.task("Verdict", 1)
    return results_summary(calibration, saved)


def open_results(progress: Progress, place: Path) -> dict[str, object]:
    """Return the summary of an existing calibration, by its folder.

    If a diagnosis of this very fit has found effects, return the summary of its result, with the
    fit's own summary under `before`.
    """
    progress.task(LOADING, 1)
    from calib.calibration import Calibration

    progress.task("Verdict", 1)
    fitted = Calibration.load(place)
    diagnosed_folder = place / "diagnosed"
    fit = results_summary(fitted, place / CALIBRATION_FILE)
    if (diagnosed_folder / CALIBRATION_FILE).exists():
        diagnosed = Calibration.load(diagnosed_folder)
        if diagnosed.effects and diagnosed.stages[: len(fitted.stages)] == fitted.stages:
            return results_summary(diagnosed, diagnosed_folder / CALIBRATION_FILE) | {"before": fit}
    return fit


def results_summary(calibration: "Calibration", saved: Path) -> dict[str, object]:
    """Return the data that the results screen shows."""
    from torch import from_numpy

    from calib.apply.map_uncertainty import map_sigmas
    from calib.estimation.residuals import residuals
    from calib.fitting.corner_outliers import describe_outlier_corners
    from calib.fitting.cover_section import cover_section
    from calib.fitting.description import describe
    from calib.fitting.view_noise import describe_noisy_views
    from calib.session.shapes.layer import medium_word
    from calib.undistortion.crop import has_black_border
    from calib.verdict.judge import judge
    from calib.verdict.uncertainty import reached_depths
    from capture.tui.corrected_fields import suspected_fields
    from capture.tui.farewell import propose_depth

    verdict = judge(calibration, folder=saved.parent, in_form=True)
    observations = calibration.observations
    path, values = calibration.model()
    declared, board = calibration.declared, calibration.board
    medium = declared.cover.medium
    is_lens_declared = calibration.outcome.intrinsics_from in (None, "session.yaml")
    has_lens = is_lens_declared and declared.intrinsics is not None
    outliers = describe_outlier_corners(calibration.outcome.outlier_corners)
    noisy_views = describe_noisy_views(calibration.outcome.view_noise)
    residual = residuals(path, values, observations, from_numpy(calibration.poses))
    views = [
        {
            "file": view.name,
            "rms_px": float((errors**2).sum(-1).nanmean().sqrt()),
            "corners": pixels.tolist(),
            "errors": errors.tolist(),
        }
        for view, errors, pixels in zip(
            calibration.views,
            observations.per_view(residual.image),
            observations.per_view(observations.pixels),
            strict=True,
        )
    ]
    sigmas = map_sigmas(calibration, reached_depths(calibration))
    depth = sorted(sigmas)[len(sigmas) // 2] if sigmas else propose_depth(saved.parent)
    return {
        "calibration": str(saved),
        "numbers": describe(calibration).as_json(),
        "cover_section": [surface.tolist() for surface in cover_section(calibration)],
        "stages": [
            {"name": s.name, "title": s.title, "rms_px": s.rms_px, "rmse_cm": s.rmse_cm}
            for s in calibration.stages
        ],
        "noise_px": calibration.noise_px,
        "views": sorted(views, key=lambda view: -float(str(view["rms_px"]))),
        "noisier": " ".join(filter(None, (outliers, noisy_views))),
        "rejected": [{"file": r.name, "reason": r.reason} for r in calibration.rejected],
        "verdict": {
            "word": verdict.word.value,
            "sentences": verdict.sentences,
            "maps_hold": verdict.maps_hold,
            "fields": suspected_fields(verdict.to_correct, declared.cover.shape, has_lens=has_lens),
        },
        "notes": verdict.notes,
        "black_border": has_black_border(calibration.ray_field(), depth),
        "medium": medium_word(medium.value) if medium else "",
        "sides": f"{board.cell}s are {1e3 * board.square:g} mm" if board.has_grid else "",
        "sigma_px": [{"depth_m": metres, "px": px} for metres, px in sigmas.items()],
    }
