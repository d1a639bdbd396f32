"""What a diagnosis says in sentences."""

from collections.abc import Iterator, Sequence

from calib.diagnosis.loop import LEAST_GAIN, Loop, Trial
from calib.diagnosis.organised import Share

ABSORBED = 0.95
"""The part of an effect that the fitted numbers can imitate, from which it is said to be absorbed."""

SEPARATES = {
    "board_bow": "tilt the board by 40 degrees and more, in both directions, so that its middle and its edges lie at different depths",
    "board_scale": "turn the board by 90 degrees in half of the views",
    "free_field": "turn the board by 90 degrees in some views, and move it over the whole picture",
    "lens": "take pictures without the cover (bare/), and boards at very different depths",
    "focal": "tilt the board, and hold it near and far",
    "principal_point": "turn the camera, or the board, by 90 degrees in some views",
    "focal_drift": "take the same board pose at the beginning and at the end",
    "rolling_shutter": "hold the board still, or on a tripod, for some views",
    "flat_port": "hold the board near and far: what a window does depends on depth, what a lens does not",
    "cover_tilt": "hold the board as near as it fits into the picture",
    "cover_offset": "hold the board as near as it fits into the picture",
    "cover_radius": "hold the board as near as it fits into the picture",
    "thickness": "hold the board as near as it fits into the picture",
    "refractive_index": "measure the glass: views tell its index hardly from its thickness",
    "wedge": "hold the board as near as it fits into the picture, at its left and its right side",
    "inner_surface": "hold the board as near as it fits into the picture, where parallax tells the two surfaces apart",
    "fine_surface": "fill the place in question with corners: a board with smaller squares, or more views there",
    "detector_bias": "take sharper pictures, at a higher resolution",
}
"""The board pose, or whatever else, that tells an effect from its like."""
ELSE = "take views at other depths, tilts and turns of the board"


def verdict(trial: Trial, *, taken: bool) -> str:
    """What became of a candidate."""
    if taken:
        return "found"
    if trial.columns.absorbed > ABSORBED:
        return "absorbed"
    if not trial.gain:
        return "not asked for"
    if trial.confirmed and trial.gain.relative <= LEAST_GAIN:
        return "too small"
    if trial.confirmed:
        return "another helped more"
    return "not confirmed"


def remarks(loop: Loop, accepted: Sequence[str], left: Sequence[Share], *, timed: bool) -> Iterator[str]:
    """What cannot be told, and what is left."""
    for name in accepted:
        like = sorted(loop.confounded.get(name, ()))
        if like:
            yield f"These views cannot tell {name} from {' or '.join(like)}. To separate them, {SEPARATES.get(name, ELSE)}."
    if "free_field" in accepted:
        yield "free_field has no name: it describes the error and mends it, but what causes it is not known."
    if not timed and "focal_drift" in accepted:
        yield "There are no times in frames.csv, so the order of the files stood for them."
    for share in left[:1]:
        yield (
            f"{100 * share.fraction:.0f} % of what is left goes with {share.organised_by}, where noise would give "
            f"{100 * share.chance:.0f} %: something there is not explained."
        )
