"""Whether to trust a calibration, in three sentences: what it is of, what is left, and where it holds."""

from dataclasses import dataclass

import numpy as np

from calib.fitting.cross_validation import CrossValidation
from calib.fitting.remarks import remarks
from calib.report.evidence import Evidence
from calib.report.patterns import over_board, over_image

NOISE_ALONE, LACKING = 1.3, 2.0
"""Error over the corners' noise up to which the rest counts as noise, and from which the model lacks something."""
FEW_CELLS = 0.6
"""Of the image: corners in less than that are remarked on."""
ONE_DEPTH = 1.5
"""Farthest over nearest corner."""
UNSURE = 0.5
"""px, of the maps at the corners."""
SHAPES = {"cone": "a cone", "cylinder": "a cylinder", "flat": "a flat window", "dome": "a dome"}


@dataclass(frozen=True, slots=True)
class Summary:
    sentences: tuple[str, str, str]
    care: tuple[str, ...]
    """What speaks against trusting it, a sentence each."""

    @property
    def verdict(self) -> str:
        return "Take care before you trust it" if self.care else "To be trusted where it has corners"


def summarise(evidence: Evidence) -> Summary:
    care = (*remarks(evidence.calibration), *_patterns(evidence), *_gaps(evidence))
    return Summary((_subject(evidence), _fit(evidence), _reach(evidence)), care)


def _subject(evidence: Evidence) -> str:
    c = evidence.calibration
    behind = ""
    if c.cover.shape != "none":
        thickness, index = (c.cover.parameters[name].value for name in ("thickness", "refractive_index"))
        behind = f" behind {SHAPES[c.cover.shape]}, {1e3 * thickness:.3g} mm thick with index {index:.4g},"
    near, far = evidence.depth.min(), evidence.depth.max()
    size = f"{c.camera.width}x{c.camera.height}"
    camera = c.camera.model if size in c.camera.model else f"{c.camera.model or 'A camera'} with {size} px"
    return (
        f"{camera}{behind} was calibrated from {len(c.views)} views of a "
        f"{c.board} board with {1e3 * c.board.square:g} mm squares: {len(evidence.depth)} corners, {near:.2g} to {far:.2g} m away."
    )


def _fit(evidence: Evidence) -> str:
    c = evidence.calibration
    last, noise = c.stages[-1].rms_px, c.noise_px
    said = f"The model leaves {last:.3f} px"
    if len(c.stages) > 1:
        said += f" of the {c.stages[0].rms_px:.3f} px that a pinhole camera leaves"
    if not np.isfinite(noise):
        said += "; there are too few corners to tell how much of that is noise"
    elif last <= NOISE_ALONE * noise:
        rest = "most of what is left" if _patterns(evidence) else "what is left"
        said += f", and the corners' own noise is about {noise:.3f} px: {rest} is noise"
    elif last <= LACKING * noise:
        said += f", where the corners' own noise is about {noise:.3f} px: a little more than noise is left"
    else:
        said += f", {last / noise:.1f} times the corners' own noise of about {noise:.3f} px: the model lacks something"
    if not (kept := c.settings.get("cross_validation")):
        return said + "; whether it overfits was not measured (calib fit --folds 5 does)."
    validation = CrossValidation(**kept)
    does = "overfits" if validation.overfits else "does not overfit"
    return said + f"; views that were held out have {validation.held_out_px:.3f} px, so it {does}."


def _reach(evidence: Evidence) -> str:
    said = f"Corners lie in {100 * evidence.covered:.0f} % of the image"
    if not evidence.sigma:
        return said + "; how sure the maps are there is not predicted for this kind of fit, and elsewhere they are extrapolated from there."
    at = ", ".join(f"{np.median(evidence.sigma_at_corners(depth)):.2g} px at {depth:g} m" for depth in evidence.depths)
    worst = max(float(np.nanmax(evidence.sigma.at_nodes(depth))) for depth in evidence.depths)
    return said + f", where one standard deviation of the maps is predicted to be {at}; elsewhere it grows to {worst:.2g} px."


def _patterns(evidence: Evidence) -> list[str]:
    said = []
    if (means := over_image(evidence)).is_pattern:
        said.append(
            f"the error has a pattern over the image (cells with a mean beyond noise: {means.said}): lens or glass differ from the model."
        )
    if (means := over_board(evidence)).is_pattern:
        said.append(f"the error has a pattern over the board (corners with a mean beyond noise: {means.said}): is it flat and to scale?")
    return said


def _gaps(evidence: Evidence) -> list[str]:
    said = []
    if evidence.covered < FEW_CELLS:
        said.append(f"only {100 * evidence.covered:.0f} % of the image has corners: take views with the board where the picture is empty.")
    near, far = float(evidence.depth.min()), float(evidence.depth.max())
    if evidence.path.cover and far < ONE_DEPTH * near:
        said.append(f"all corners are {near:.2g} to {far:.2g} m away: nearer and farther views show how the cover acts with depth.")
    unsure = [depth for depth in evidence.depths if evidence.sigma and np.median(evidence.sigma_at_corners(depth)) > UNSURE]
    if unsure:
        said.append(
            f"the maps at {', '.join(f'{d:g} m' for d in unsure)} are hardly known even at the corners: take more views, tilted and near."
        )
    return said
