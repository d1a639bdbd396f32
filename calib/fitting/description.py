"""The numbers of a calibration as a table: camera, cover, board, and where its corners are.

Terminal, screen, report, notebook and JSON all take their rows from here.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from calib.calibration import Calibration, CalibrationSource
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.description import number_legend
from calib.fitting.corner_range import (
    corners_at,
    covered_fraction,
    distance_range,
    emptiest_region,
)
from calib.fitting.declared import (
    ANY_SHAPE,
    DECLARED,
    EITHER_LENS,
    VIEWS,
    Comparison,
    comparisons,
    effect_comparisons,
)
from calib.fitting.fit_result import EFFECTS_STAGE
from calib.inference.calibration_model import without_own_bend
from calib.session.freeing import AUTO
from calib.session.lens import OPENCV
from calib.session.parameter_names import CAMERA
from calib.session.schema import UNKNOWN
from calib.session.shapes.none import NONE as NO_COVER
from calib.table import Table, TableSection

COLUMNS = ("", "calibrated ± sigma", "declared ± tolerance", "remark", "difference")
"""The headings. The fourth column says whether a number was not fitted, corrected,
contradicted or not improved, the last one how far the calibrated number is from the
declared one.
"""
NOT_FITTED, CORRECTED, UNDETERMINED = "not fitted", "corrected", "not determined"
CONTRADICTED, NOT_IMPROVED = "contradicted", "not improved"
VAGUE = "hardly known"
MAX_VAGUENESS = 0.05
"""The largest sigma of a focal length, relative to it, that gets no mark."""
NOTES = {
    NOT_FITTED: "kept at the value that you gave, or at the default.",
    CORRECTED: (
        "the pictures give another value, by 3 of its own sigmas or more. Your tolerance allows it."
    ),
    NOT_IMPROVED: "these pictures do not narrow the tolerance, yours or the default.",
    UNDETERMINED: "you gave no value, and these pictures do not determine it.",
    CONTRADICTED: "the pictures do not agree with the declared number.",
    ANY_SHAPE: "sigma is for all shapes of the cover that fit these pictures.",
    EITHER_LENS: "sigma is for both lenses that fit these pictures; a note names the other one.",
    VAGUE: "tilted boards, near and far, would measure it.",
}
"""The explanations of the words in the fourth column."""
HELD_AS_ASKED = "None was fitted, as you asked."
HELD_BY_FIT = "None was fitted: some estimates would leave their tolerances, so your values stand."
MAX_UNIMPROVED = 0.9
"""The largest difference from the declared number, in tolerances, of one that is not improved: two
standard deviations of an estimate that leaves 0.9 of the tolerance, 0.44 each.
"""
NOTABLE_DIFFERENCE = 0.1
"""The smallest difference from the declared number that is stated as a number, in tolerances."""
PRINTED_COLUMNS = 4
"""The columns that fit into 80 characters."""


def describe(calibration: CalibrationSource) -> Table:
    """Return the table of a calibration: each number of its camera and cover with its standard
    deviation and what was declared, then the numbers of its effects, and where its corners are.


    Args:
        calibration: the calibration, or the path of its file or folder.
    """
    calibration = Calibration.of(calibration)
    numbers = list(comparisons(calibration))
    of_camera = [number for number in numbers if CAMERA.has(number.name)]
    of_cover = [number for number in numbers if not CAMERA.has(number.name)]
    of_effects = list(effect_comparisons(calibration))
    sections = (
        _section("camera", _camera_title(calibration), of_camera),
        TableSection(
            "cover",
            _cover_title(calibration),
            (*_shape_rows(calibration), *map(_row, of_cover)),
        ),
        TableSection(
            "effects",
            _effects_title(calibration),
            tuple((number.name, number.estimated, "", "", "") for number in of_effects),
        ),
        TableSection("pictures", "Pictures", tuple(_range_rows(calibration)), headed=False),
    )
    shown = tuple(section for section in sections if section.rows)
    words = {row[3].partition(",")[0] for section in shown for row in section.rows}
    notes = (
        *(f"{word}: {note}" for word, note in NOTES.items() if word in words),
        *([_why_held(calibration)] if all(number.held for number in numbers) else []),
        *effect_notes(calibration),
    )
    return Table("What was calibrated", COLUMNS, shown, notes)


def _why_held(calibration: Calibration) -> str:
    """Return why no number was fitted."""
    may_free = AUTO in calibration.request.free
    return HELD_BY_FIT if may_free else HELD_AS_ASKED


def effect_notes(calibration: Calibration) -> Iterator[str]:
    """Yield lines that explain the numbers of effects that session.yaml does not have."""
    names: dict[str, list[str]] = {}
    for number in effect_comparisons(calibration):
        names.setdefault(number.effect, []).append(number.name)
    for effect, numbers in names.items():
        yield from number_legend(effect, numbers)


def calibrated_numbers(calibration: Calibration) -> dict[str, object]:
    """Return the numbers of camera, cover and board as the JSON of commands has them.

    A number is a value and its sigma, 0 if the fit held it; that of a cover has the declared value
    and the unit of its key in session.yaml as well.
    """
    numbers = {number.name: number for number in comparisons(calibration)}
    camera = calibration.camera
    intrinsics = camera.intrinsics
    assert intrinsics
    pinhole = {key: _value_and_sigma(numbers[CAMERA.of(key)]) for key in ("fx", "fy", "cx", "cy")}
    coefficients = [
        _value_and_sigma(numbers[CAMERA.of(name)])
        if CAMERA.of(name) in numbers
        else {"value": number.value, "sigma": number.sigma}
        for name, number in zip(intrinsics.names, intrinsics.distortion, strict=True)
    ]
    return {
        "camera": {
            **pinhole,
            "lens": intrinsics.model,
            "distortion": coefficients,
            "width": camera.width,
            "height": camera.height,
        },
        "cover": {
            _session_key(calibration, name): {
                **_value_and_sigma(numbers[name]),
                "declared": UNKNOWN if numbers[name].unknown else numbers[name].declared,
                "tolerance": numbers[name].tolerance,
                "unit": numbers[name].unit,
            }
            for name in calibration.cover.dimensions
        },
        "board": {
            **_target_size(calibration),
            "shape_mm": {
                number.name.removeprefix(f"{BoardShape.name}."): _value_and_sigma(number)
                for number in effect_comparisons(calibration)
                if number.effect == BoardShape.name
            },
            "shape_removed_px": _shape_errors(calibration),
        },
    }


def _target_size(calibration: Calibration) -> dict[str, object]:
    """Return the size of the board, or the number of points of another target."""
    board = calibration.board
    if not board.has_grid:
        return {"points": board.count}
    return {"columns": board.columns, "rows": board.rows, "square_mm": 1e3 * board.square}


def _shape_errors(calibration: Calibration) -> dict[str, float] | None:
    """Return the errors in px without the board's shape and with it; None if the fit has no
    shape.
    """
    stages = calibration.stages
    names = {added.effect.name for added in calibration.effects}
    if not (BoardShape.name in names and len(stages) > 1):
        return None
    return {"before": stages[-2].rms_px, "after": stages[-1].rms_px}


def _value_and_sigma(number: Comparison) -> dict[str, float]:
    return {"value": number.estimate, "sigma": number.sigma}


def _session_key(calibration: Calibration, name: str) -> str:
    """Return the key in session.yaml of a cover's number, with the component of a list: centre_mm.x
    for cover.centre.x.
    """
    quantity = calibration.cover.dimensions[name].quantity
    number = next(n for n in quantity.names if name.endswith(f".{n}"))
    place = name.removesuffix(number).removeprefix("cover.")
    return f"{place}{quantity.key}{number.removeprefix(quantity.stem)}"


def _section(name: str, title: str, numbers: Iterable[Comparison]) -> TableSection:
    return TableSection(name, title, tuple(map(_row, numbers)))


def _row(number: Comparison) -> tuple[str, ...]:
    if number.source == VIEWS:
        return number.name, number.estimated, "", VAGUE * _is_vague(number), ""
    declared = number.stated if number.source == DECLARED else f"{number.stated} (bare/)"
    is_compared = not number.held and not number.unknown
    difference = _deviation(number) if is_compared else None
    words = "" if difference is None else _describe_difference(difference)
    estimated = number.estimated
    if number.held:  # with the digits of the declared one
        estimated = f"{number.estimate:.6g} {number.unit}".rstrip()
    return number.name, estimated, declared, _note(number), words


def _deviation(number: Comparison) -> float:
    """Return how far a number is from the declared one, in tolerances."""
    return abs(number.estimate - number.declared) / number.tolerance


def _describe_difference(difference: float) -> str:
    """Return a difference from the declared number, in tolerances, as text."""
    if difference < NOTABLE_DIFFERENCE:
        return f"< {NOTABLE_DIFFERENCE} × tolerance"
    return f"{difference:.1f} × tolerance"


def _shape_rows(calibration: Calibration) -> Iterator[tuple[str, ...]]:
    """Yield the row of a shape that the fit chose."""
    outcome = calibration.outcome
    chosen, *rivals = outcome.probable_shapes or ("",)
    if chosen:
        is_open = bool(rivals or outcome.shape_map_changes_px)
        yield "cover.shape", chosen, UNKNOWN, UNDETERMINED * is_open, ""


def _note(number: Comparison) -> str:
    if number.held:
        return NOT_FITTED
    if number.alternatives:
        return number.alternatives
    words = CORRECTED if number.corrected else ""
    if number.is_open:
        words = UNDETERMINED
    if number.contradicted:
        words = CONTRADICTED
    if not words and number.is_uninformed and _deviation(number) < MAX_UNIMPROVED:
        words = NOT_IMPROVED
    if not words and _is_vague(number):
        words = VAGUE
    effect = f"by {number.effect}" if number.effect else ""
    return ", ".join(filter(None, [words, effect]))


def _is_vague(number: Comparison) -> bool:
    """Return True for a focal length that is not known to a twentieth."""
    return number.name in CAMERA.focal and number.sigma > MAX_VAGUENESS * abs(number.estimate)


def _camera_title(calibration: Calibration) -> str:
    camera = calibration.camera
    intrinsics = camera.intrinsics
    assert intrinsics
    lens = intrinsics.model
    if lens == OPENCV:
        count = len(intrinsics.distortion) if intrinsics.distorts else 0
        lens = f"{OPENCV} with {count} coefficients" if count else "without distortion"
    return f"Camera: {camera.width}x{camera.height} px, lens {lens}"


def _cover_title(calibration: Calibration) -> str:
    if calibration.cover.shape == NO_COVER.name:
        return "Cover: none"
    surface = "uneven" if calibration.relief else "even"
    return f"Cover: {calibration.cover.words} with an {surface} outer surface"


def _effects_title(calibration: Calibration) -> str:
    kinds = {type(added.effect) for added in calibration.effects}
    return "Board" if kinds <= {BoardShape, BoardScale} else "Effects"


def _range_rows(calibration: Calibration) -> Iterator[tuple[str, ...]]:
    """Yield the rows that say where the corners are."""
    corners = corners_at(calibration)
    if not len(corners):
        return
    covered = covered_fraction(calibration, corners[:, :2])
    yield "coverage", f"{100 * covered:.0f} % of the picture", "", "", ""
    if region := emptiest_region(calibration, corners[:, :2]):
        yield "least covered", region, "", "", ""
    name = "distance" if calibration.model()[0].lens.wide else "depth"
    distance = corners[:, 2]
    if np.isfinite(distance).any():
        near, far = distance_range(distance[np.isfinite(distance)])
        yield name, f"{near:.3g} to {far:.3g} m", "", "", ""
    board = calibration.board
    if board.has_grid:  # lengths and depths are right if these are
        yield f"{board.cell}s", f"{1e3 * board.square:g} mm, as stated", "", "", ""


def describe_bend(calibration: Calibration, verb: str = "is") -> str:
    """Return a sentence on the board's bend and print; empty if the fit found none.

    Args:
        verb: "may be" where a cover that is not described could explain the same.
    """
    stages = calibration.stages
    if without_own_bend(calibration) is calibration or stages[-1].name != EFFECTS_STAGE:
        return ""
    numbers = {
        name: float(value)
        for effect in calibration.effects
        for name, (value, _) in effect.parameters.items()
    }
    findings = []
    if "board_shape.xx" in numbers:
        findings.append(
            f"bent by {1e3 * numbers['board_shape.xx']:.2f} mm along x and"
            f" {1e3 * numbers['board_shape.yy']:.2f} mm along y"
        )
    if "board_scale.x_over_y" in numbers:
        percent = 100 * numbers["board_scale.x_over_y"]
        findings.append(f"unevenly printed ({percent:.2f} % longer along x than along y)")
    return (
        f"The board {verb} {' and '.join(findings)}: {stages[-2].rms_px:.3f} px with a flat"
        f" board, {stages[-1].rms_px:.3f} px with this one."
    )
