"""Print a calibrated rig and its evaluation, as tables or as JSON."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.commands.left_out_lines import left_out_lines
from calib.errors import harmless
from calib.io.numerals import counted
from calib.rig.central_rig import CentralRig
from calib.rig.depth import DepthPicture
from calib.rig.evaluate_rig import RigEvaluation
from calib.rig.feature_matches import FeatureMatches, PairAgreement
from calib.rig.rectify import RectifiedPair
from calib.rig.rig import Rig
from calib.rig.rig_content import RejectedView
from calib.rig.shared_medium import shared_media
from calib.rounding import with_sigma

MAX_LISTED = 3
"""The most turned views that a sentence names."""


def rig_json(rig: Rig, seconds: float) -> dict[str, object]:
    """Return the JSON object of the command contract."""
    cameras = {}
    for name, calibration in rig.calibrations.items():
        mounting = rig.mounting(name)
        cameras[name] = {
            "rms_px": calibration.stages[-1].rms_px,
            "rms_alone_px": rig.record.alone_px.get(name),
            "frames_used": len(calibration.views),
            "T_camera_reference": mounting.T_camera_reference.tolist(),
            "sigma": mounting.sigma.tolist(),
            "ray_sigma": mounting.ray_sigma.tolist(),
            "effects": [added.effect.name for added in calibration.effects],
        }
    return {
        "reference": rig.reference,
        "cameras": cameras,
        "baselines": [baseline.as_mapping() for baseline in rig.baselines],
        "effects": [effect.as_mapping() for effect in rig.record.effects],
        "shared_media": [medium.as_mapping() for medium in shared_media(rig)],
        "placements": len(rig.placements),
        "placement_scatter": rig.record.scatter,
        "turned_boards": {name: list(views) for name, views in rig.record.turned.items()},
        "frames_rejected": [_rejected_json(view) for view in rig.record.rejected],
        "seconds": seconds,
    }


def evaluation_json(evaluation: RigEvaluation) -> dict[str, object]:
    """Return the JSON object of an evaluation."""
    return {
        "rms_px": evaluation.rms_px,
        "cameras": {name: {"rms_px": error} for name, error in evaluation.cameras.items()},
        "placements": evaluation.placements,
        "shared_placements": evaluation.shared_placements,
        "lengths": [
            {
                "from_m": band.from_m,
                "to_m": band.to_m,
                "rms_mm": band.rms_mm,
                "sigma_mm": band.sigma_mm,
                "error_over_sigma": band.normalised,
                "lengths": band.lengths,
                "placements": band.placements,
            }
            for band in evaluation.lengths
        ],
        "frames_rejected": [_rejected_json(view) for view in evaluation.rejected],
    }


def print_rig(rig: Rig, seconds: float) -> None:
    """Print the cameras' errors and mountings, the distances between them, and what was left
    out.
    """
    console = Console()
    columns = ("camera", "views", "alone", "in the rig", "turned", "x, y, z of the pinhole")
    table = Table(*columns, title="The rig (root mean square reprojection errors)")
    for column in table.columns[1:]:
        column.justify = "right"
    for name, calibration in rig.calibrations.items():
        mounting = rig.mounting(name)
        matrix = mounting.T_camera_reference
        centre = -1000 * matrix[:3, :3].T @ matrix[:3, 3] + 0.0  # no minus before a zero
        cosine = (np.trace(matrix[:3, :3]) - 1) / 2
        error = calibration.stages[-1].rms_px
        table.add_row(
            name,
            str(len(calibration.views)),
            f"{rig.record.alone_px.get(name, error):.3f} px",
            f"{error:.3f} px",
            "reference"
            if name == rig.reference
            else f"{np.degrees(np.arccos(np.clip(cosine, -1, 1))):.2f} deg",
            ", ".join(f"{value:.2f}" for value in centre) + " mm",
        )
    console.print(table)
    for baseline in rig.baselines:
        _print(
            console,
            f"{baseline.first} to {baseline.second}:"
            f" {with_sigma(1000 * baseline.metres, 1000 * baseline.sigma)} mm.",
        )
    for medium in shared_media(rig):
        _print(console, f"{medium}.")
    for name, views in rig.record.turned.items():
        listed = ", ".join(views[:MAX_LISTED]) + " ..." * (len(views) > MAX_LISTED)
        _print(
            console,
            f"The board looks turned in {counted(len(views), 'view')} of {name}, and the corners"
            f" there are renumbered: {listed}.",
        )
    placements = f"{len(rig.placements)} placements of the board"
    if len(rig.names) > 1:
        placements += f", {(rig.cameras_seeing > 1).sum()} of which several cameras saw"
    _print(console, f"{placements}; fit in {seconds:.1f} s.")
    _list_rejected(console, rig.record.rejected)


def print_rig_evaluation(evaluation: RigEvaluation) -> None:
    """Print the held-out errors of a rig."""
    console = Console()
    table = Table(
        "depth", "lengths", "error", "sigma", title="Lengths on held-out boards (root mean square)"
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for band in evaluation.lengths:
        table.add_row(
            f"{band.from_m:g} to {band.to_m:g} m",
            str(band.lengths),
            f"{band.rms_mm:.3f} mm",
            f"{band.sigma_mm:.3f} mm",
        )
    if evaluation.lengths:
        console.print(table)
    else:
        _print(console, "No corner was seen by two cameras, so there are no lengths.")
    errors = ", ".join(f"{name} {error:.3f} px" for name, error in evaluation.cameras.items())
    _print(
        console,
        f"Reprojection error {evaluation.rms_px:.3f} px with one pose for all cameras ({errors}),"
        f" in {evaluation.placements} placements, {evaluation.shared_placements} of which several"
        " cameras saw.",
    )
    _list_rejected(console, evaluation.rejected)


def rectification_json(pair: RectifiedPair) -> dict[str, object]:
    """Return the JSON object of a rectified pair."""
    return {
        "left": pair.names[0],
        "right": pair.names[1],
        "depth_m": pair.depth,
        "baseline_m": pair.baseline,
        "focal_px": pair.focal,
        "rows": [
            {"depth_m": row.depth, "rms_px": row.rms_px, "worst_px": row.worst_px}
            for row in pair.rows
        ],
    }


def print_rows(pair: RectifiedPair) -> None:
    """Print how far the rows of a rectified pair are off, by depth."""
    console = Console()
    table = Table("depth", "RMS", "at worst", title="How far rows are off")
    for column in table.columns:
        column.justify = "right"
    for row in pair.rows:
        table.add_row(f"{row.depth:.3g} m", f"{row.rms_px:.3f} px", f"{row.worst_px:.3f} px")
    console.print(table)


def depth_json(picture: DepthPicture) -> dict[str, object]:
    """Return the JSON object of a depth picture."""
    measured = np.isfinite(picture.depth)
    features = {
        "swapped": picture.is_swapped,
        "features": {
            "matches": picture.features.matches,
            "agreeing": picture.features.agreeing,
            "agreement": picture.features.agreement.value,
        },
    }
    if not measured.any():
        return {"pixels": 0} | features
    return features | {
        "pixels": int(measured.sum()),
        "fraction": float(measured.mean()),
        "median_m": float(np.median(picture.depth[measured])),
        "median_sigma_m": float(np.median(picture.sigma[measured])),
    }


def print_depth(picture: DepthPicture) -> None:
    """Print how many pixels of a depth picture have a depth, and how sure these are."""
    measured = np.isfinite(picture.depth)
    console = Console()
    _print_agreement(console, picture.features)
    if not measured.any():
        _print(console, "No pixel has a match: search other depths, or light the scene.")
        return
    depth = float(np.median(picture.depth[measured]))
    sigma = float(np.median(picture.sigma[measured]))
    _print(
        console,
        f"{100 * measured.mean():.0f} % of the pixels have a depth, in the middle"
        f" {with_sigma(depth, sigma)} m.",
    )


def _print_agreement(console: Console, features: FeatureMatches) -> None:
    """Print whether the two pictures of a pair belong together, unless they do."""
    share = f"Of {features.matches} points that look alike in both pictures, {features.agreeing}"
    sentences = {
        PairAgreement.SWAPPED: f"{share} agree with the rig, and {features.agreeing_swapped} in the"
        " other order: do not use these depths, and give the picture of the left camera first.",
        PairAgreement.DISAGREES: f"{share} agree with the rig: do not use these depths. The"
        " pictures are not of the same moment, or a camera has moved since the calibration (test"
        " it: calib rig check).",
        PairAgreement.UNDECIDED: "Too few points look alike in both pictures"
        f" ({features.matches}) to test whether the pictures belong together.",
    }
    if features.agreement in sentences:
        _print(console, sentences[features.agreement])


def misfits_json(rig: CentralRig) -> dict[str, object]:
    """Return the JSON object of the central cameras of a rig."""
    return {
        "cameras": {
            name: {
                "lens": model.lens.name,
                "misfits": [
                    {"depth_m": m.depth, "rms_px": m.rms_px, "worst_px": m.worst_px}
                    for m in model.misfits
                ],
            }
            for name, model in rig.models.items()
        }
    }


def print_misfits(rig: CentralRig) -> None:
    """Print how far each central camera is from the one behind the cover."""
    console = Console()
    for name, model in rig.models.items():
        _print(console, f"{name}: misfit {model.misfit_at_depth}.")
        for remark in model.remarks():
            _print(console, f"{name}: {remark}")


def _rejected_json(view: RejectedView) -> Mapping[str, str]:
    return {"camera": view.camera, "file": view.file, "reason": view.reason}


def _list_rejected(console: Console, rejected: tuple[RejectedView, ...]) -> None:
    pictures = ((f"{view.file} of {view.camera}", view.reason) for view in rejected)
    for line in left_out_lines(pictures, "Not used:"):
        _print(console, line)


def _print(console: Console, line: str) -> None:
    console.print(harmless(line), markup=False, highlight=False, soft_wrap=True)
