"""The head of a report: the verdict, tiles, and a short list on camera, error and coverage."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.apply.angular_reach import undistortion_limit
from calib.apply.map_uncertainty import describe_sigmas, map_sigmas
from calib.calibration import Calibration
from calib.fitting.declared import comparisons
from calib.fitting.description import describe_bend
from calib.fitting.supported_depths import describe_supported
from calib.io.numerals import counted
from calib.report.evidence import Evidence
from calib.report.patterns import over_board, over_image
from calib.report.tiles import Tile, report_tiles
from calib.session.cover import Cover
from calib.session.parameter_names import INDEX, THICKNESS, layer_number
from calib.session.shapes.layer import WATER, medium_word
from calib.verdict.judge import judge
from calib.verdict.residual import NOT_ALL_NOISE, OF_NOISE, asks_for_cover
from calib.verdict.thresholds import BEYOND_NOISE
from calib.verdict.verdict import Verdict

NOISE_ALONE = 1.3
"""The error over the corners' noise up to which the error counts as noise."""


@dataclass(frozen=True, slots=True)
class Summary:
    sentences: tuple[str, ...]
    """The items of a list."""
    verdict: Verdict
    tiles: tuple[Tile, ...]


def summarise(
    evidence: Evidence, depths: Sequence[float] = (), folder: Path | None = None
) -> Summary:
    """Summarise a calibration.

    Args:
        depths: m, those of the requested maps; by default those that the fit was asked for.
        folder: that of the calibration.
    """
    command = evidence.calibration.request.command
    depths = depths or (command.depths if command else ())
    folder = folder and folder.resolve()
    verdict = judge(evidence.calibration, depths=depths, folder=folder)
    limit = undistortion_limit(evidence.calibration)
    uncertainty = evidence.calibration.outcome.uncertainty
    is_said = any(OF_NOISE in reason.sentence for reason in verdict.reasons)
    sentences = (
        _found(evidence.calibration),
        _subject(evidence),
        describe_bend(evidence.calibration, "may be" if asks_for_cover(verdict) else "is"),
        "" if is_said else _fit(evidence, verdict),
        _overfitting(evidence.calibration),
        " ".join(filter(None, [_coverage(evidence), limit])),
        uncertainty.heavy_sentence if uncertainty else "",
    )
    return Summary(tuple(filter(None, sentences)), verdict, report_tiles(evidence))


def _found(calibration: Calibration) -> str:
    """Return a sentence on the effects that the diagnosis added; empty if it added none."""
    diagnosis = calibration.history.diagnosis
    if not diagnosis:
        return ""
    if not diagnosis.accepted:
        return "" if diagnosis.families else "The diagnosis found nothing that the model lacks."
    if len(diagnosis.qualities) < 2:
        return ""
    first, last = diagnosis.qualities
    names = [effect.name for effect in diagnosis.accepted]
    start = "the earlier effects" if diagnosis.had_effects else "a flat board and no effect"
    return (
        f"The diagnosis found {' and '.join(names)}. The error on held-out views is"
        f" {first.held_out_px:.3f} px with {start}, and {last.held_out_px:.3f} px with what was"
        " found."
    )


def _subject(evidence: Evidence) -> str:
    calibration = evidence.calibration
    covered = calibration.cover.shape != "none"
    undetermined = any(
        number.is_open and THICKNESS in number.name for number in comparisons(calibration)
    )
    behind = ""
    if covered:
        glass = (_glass(cover, undetermined=undetermined) for cover in calibration.cover.covers)
        behind = f" behind {' and '.join(glass)}"
    board = calibration.board
    near, far = evidence.reach
    size = f"{calibration.camera.width}x{calibration.camera.height}"
    camera = (
        calibration.camera.model
        if size in calibration.camera.model
        else f"{calibration.camera.model or 'A camera'} with {size} px"
    )
    if board.has_grid:
        cells = f"{1e3 * board.square:g} mm {board.cell}s ({len(evidence.depth)} corners)"
        target = f"a {board} board with {cells}"
    else:
        target = f"a flat target: {board}" if board.is_flat else f"a target of {board} in space"
    medium = calibration.cover.medium
    if medium and medium_word(medium.value) == WATER:
        behind += f", in water ({medium.value:g})"
    return (
        f"{camera}{behind}: {counted(len(calibration.views), 'view')} of {target}, {near:.2g} to"
        f" {far:.2g} m away."
    )


def _glass(cover: Cover, *, undetermined: bool) -> str:
    """Return the words for a cover and its glass, without a thickness that is undetermined."""
    layers = range(1, cover.layers + 1)
    thickness = sum(cover.parameters[layer_number(layer, THICKNESS)].value for layer in layers)
    indices = [f"{cover.parameters[layer_number(layer, INDEX)].value:.4g}" for layer in layers]
    *inner, last = indices
    index = f"index {last}" if not inner else f"indices {', '.join(inner)} and {last}"
    thick = "of unknown thickness" if undetermined else f"{1e3 * thickness:.3g} mm thick"
    return f"{cover.single_words} ({thick}, {index})"


def _fit(evidence: Evidence, verdict: Verdict) -> str:
    calibration = evidence.calibration
    rms = calibration.stages[-1].rms_px
    noise = calibration.noise_px
    if len(calibration.stages) > 1:
        bare_rms = calibration.stages[0].rms_px
        text = f"The error is {rms:.3f} px (camera alone: {bare_rms:.3f} px)"
    else:
        text = f"The error is {rms:.3f} px"
    if noise is None:
        text += "; there are too few corners to tell how much of it is noise"
    elif rms <= NOISE_ALONE * noise:
        patterns = over_image(evidence).is_pattern or over_board(evidence).is_pattern
        organised = any(reason.sentence.startswith(NOT_ALL_NOISE) for reason in verdict.reasons)
        text += (
            f". The noise of the corners is about {noise:.3f} px: most of the error is noise"
            if patterns or organised
            else f": no more than the corners' noise is left (about {noise:.3f} px,"
            " from how neighbouring corners differ)"
        )
    elif rms <= BEYOND_NOISE * noise:
        text += f". The noise of the corners is about {noise:.3f} px: the error is a little larger"
    elif noise > 0:
        text += (
            f", {rms / noise:.1f} times the noise of the corners (about {noise:.3f} px): the model"
            " lacks something"
        )
    else:
        text += ". The corners show no noise, like computed corners"
    return f"{text}."


def _overfitting(calibration: Calibration) -> str:
    """Return a sentence on overfitting; empty if the fit has no folds."""
    if not (validation := calibration.outcome.cross_validation):
        return ""
    result = "overfits" if validation.overfits else "does not overfit"
    return f"On held-out views the error is {validation.held_out_px:.3f} px: the fit {result}."


def _coverage(evidence: Evidence) -> str:
    if not evidence.sigma:
        return (
            "Outside of the corners the maps are extrapolated. This kind of fit does not predict"
            " the uncertainty of the maps."
        )
    at_corners = describe_sigmas(map_sigmas(evidence.calibration, evidence.depths))
    return (
        f"{describe_supported(*evidence.reach)} The expected error of the maps is"
        f" {at_corners} (median over the corners); the largest is"
        f" {evidence.worst_sigma(evidence.depths)}."
    )
