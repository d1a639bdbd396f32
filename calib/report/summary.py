"""What opens a report: the verdict, and three sentences on what the calibration is of, what is
left, and where it holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.apply.angular_reach import undistortion_limit
from calib.fitting.cross_validation import CrossValidation
from calib.fitting.provenance import KEY
from calib.report.evidence import Evidence
from calib.report.patterns import over_board, over_image
from calib.verdict.judge import judge
from calib.verdict.residual import NOT_ALL_NOISE
from calib.verdict.thresholds import BEYOND_NOISE
from calib.verdict.verdict import Verdict

NOISE_ALONE = 1.3
"""Error over the corners' noise up to which the rest counts as noise."""
HERE = Path()
"""What commands call the calibration's folder in a report, which lies there and tells of its
author's disk no more than names.
"""
SHAPES = {"cone": "a cone", "cylinder": "a cylinder", "flat": "a flat window", "dome": "a dome"}


@dataclass(frozen=True, slots=True)
class Summary:
    sentences: tuple[str, str, str]
    verdict: Verdict


def summarise(evidence: Evidence, depths: Sequence[float] = ()) -> Summary:
    """Args: depths: m, for which maps are wanted."""
    session = Path(evidence.calibration.settings.get(KEY, {}).get("session", "SESSION")).name
    verdict = judge(evidence.calibration, depths=depths, folder=HERE, session=Path(session))
    reach = " ".join(filter(None, [_reach(evidence), undistortion_limit(evidence.calibration)]))
    return Summary((_subject(evidence), _fit(evidence, verdict), reach), verdict)


def _subject(evidence: Evidence) -> str:
    c = evidence.calibration
    behind = ""
    if c.cover.shape != "none":
        thickness, index = (
            c.cover.parameters[name].value for name in ("thickness", "refractive_index")
        )
        behind = (
            f" behind {SHAPES[c.cover.shape]}, {1e3 * thickness:.3g} mm thick with index"
            f" {index:.4g},"
        )
    near, far = evidence.reach
    size = f"{c.camera.width}x{c.camera.height}"
    camera = (
        c.camera.model
        if size in c.camera.model
        else f"{c.camera.model or 'A camera'} with {size} px"
    )
    return (
        f"{camera}{behind} was calibrated from {len(c.views)} views of a {c.board} board with"
        f" {1e3 * c.board.square:g} mm {c.board.part}s: {len(evidence.depth)} corners, {near:.2g}"
        f" to {far:.2g} m away."
    )


def _fit(evidence: Evidence, verdict: Verdict) -> str:
    c = evidence.calibration
    last, noise = c.stages[-1].rms_px, c.noise_px
    said = f"The model leaves {last:.3f} px"
    if len(c.stages) > 1:
        said += f" of the {c.stages[0].rms_px:.3f} px that the camera alone leaves"
    if not np.isfinite(noise):
        said += "; there are too few corners to tell how much of that is noise"
    elif last <= NOISE_ALONE * noise:
        patterns = over_image(evidence).is_pattern or over_board(evidence).is_pattern
        doubted = any(reason.sentence.startswith(NOT_ALL_NOISE) for reason in verdict.reasons)
        rest = "most of what is left" if patterns or doubted else "what is left"
        said += f", and the corners' own noise is about {noise:.3f} px: {rest} is noise"
    elif last <= BEYOND_NOISE * noise:
        said += (
            f", where the corners' own noise is about {noise:.3f} px: a little more than noise is"
            " left"
        )
    else:
        said += (
            f", {last / noise:.1f} times the corners' own noise of about {noise:.3f} px: the model"
            " lacks something"
        )
    if not (kept := c.settings.get("cross_validation")):
        return said + "; whether it overfits was not measured (calib fit --folds 5 does)."
    validation = CrossValidation(**kept)
    does = "overfits" if validation.overfits else "does not overfit"
    return said + f"; views that were held out have {validation.held_out_px:.3f} px, so it {does}."


def _reach(evidence: Evidence) -> str:
    said = f"Corners lie in {100 * evidence.covered:.0f} % of the image"
    if not evidence.sigma:
        return (
            said
            + "; how sure the maps are there is not predicted for this kind of fit, and elsewhere"
            " they are extrapolated from there."
        )
    at = ", ".join(
        f"{np.median(evidence.sigma_at_corners(depth)):.2g} px at {depth:g} m"
        for depth in evidence.depths
    )
    worst = max(float(np.nanmax(evidence.sigma_at_nodes(depth))) for depth in evidence.depths)
    return (
        said
        + f", where one standard deviation of the maps is predicted to be {at}; elsewhere it grows"
        f" to {worst:.2g} px."
    )
