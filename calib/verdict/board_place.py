"""Checks: the board has a plausible size at a plausible distance, and its size is known. Squares
given in centimetres put the boards inside the cover, squares given in metres put them too far away.
"""

from collections.abc import Iterator

import numpy as np

from calib.rounding import with_sigma
from calib.session.board import Board
from calib.session.coding import AprilGrid
from calib.session.cover import Cover
from calib.session.parameter_names import THICKNESS, number_of
from calib.session.shapes.flat import FLAT
from calib.verdict.case import Case
from calib.verdict.thresholds import (
    FAR_AWAY,
    INSIDE,
    LARGEST_BOARD,
    REACHED_GLASS,
    SMALL_BOARD,
    SMALL_COVER,
    SMALL_RADIUS,
    SMALLEST_BOARD,
    THIN_COVER,
    TINY,
    UNSURE_SQUARE,
)
from calib.verdict.unit_words import BOARD_UNIT, COVER_UNIT, TARGET_UNIT
from calib.verdict.verdict import Reason, Trust

RADIUS = "inner_radius"


def board_place(case: Case) -> Iterator[Reason]:
    """Check the distance of the boards before a cover."""
    if not case.calibration.model()[0].cover:
        return
    to_glass, to_corner = case.distances_of_glass
    share_inside = float(np.mean(to_corner < to_glass))
    glass, board = float(np.median(to_glass)), float(np.median(to_corner))
    key = _key(case.calibration.board)
    distances = (
        f"half of the corners would be nearer than {board:.3g} m, where the cover's outer face is"
        f" at {glass:.3g} m"
    )
    if board < INSIDE * glass:
        sentence = f"{distances}: the board would stand inside the cover or touch it. Check {key}."
        yield Reason(sentence, case.next.fit(), (key,), Trust.DO_NOT_USE)
    elif share_inside > REACHED_GLASS:
        sentence = (
            f"{100 * share_inside:.0f} % of the corners would be inside the cover, where the board"
            f" cannot have been: check {key} and the cover's size."
        )
        yield Reason(sentence, case.next.fit(), (key,), Trust.DO_NOT_USE)
    elif board > FAR_AWAY * max(glass, SMALL_COVER):
        sentence = f"{distances}: the board would be as large as a house. Check {key}."
        yield Reason(sentence, case.next.fit(), (key,), Trust.DO_NOT_USE)


def board_size(case: Case) -> Iterator[Reason]:
    """Check that the declared size is in the right unit, and that it is known."""
    board = case.calibration.board
    if not board.has_grid:
        yield from _target_size(case)
        return
    key = _key(board)
    width = board.width
    if not SMALLEST_BOARD <= width <= LARGEST_BOARD:
        sentence = (
            f"the board would be {width:.3g} m wide, with {board.cell}s of {board.square:.3g} m:"
            f" check {key}, {BOARD_UNIT}."
        )
        yield Reason(sentence, case.next.fit(), (key,))
    radius = max(_declared_lengths(case.calibration.declared.cover, RADIUS).values(), default=0.0)
    if SMALLEST_BOARD <= width < radius:
        sentence = (
            f"the board would be {1e3 * width:.3g} mm wide, less than the cover's radius of"
            f" {1e3 * radius:.3g} mm: check {key}, {BOARD_UNIT}."
        )
        word = Trust.DO_NOT_USE if width < TINY * radius else Trust.CARE
        yield Reason(sentence, case.next.fit(), (key,), word)
    elif not radius and SMALLEST_BOARD <= width < SMALL_BOARD and case.calibration.model()[0].cover:
        sentence = f"the board would be {1e3 * width:.3g} mm wide: check {key}, {BOARD_UNIT}."
        yield Reason(sentence, case.next.fit(), (key,))
    if board.square_sigma is not None and board.relative_sigma > UNSURE_SQUARE:
        sentence = (
            f"{key} is known to {100 * board.relative_sigma:.2g} % only"
            f" ({with_sigma(1e3 * board.square, 1e3 * board.square_sigma)} mm), and so is every"
            " length and every distance that this calibration gives: measure it over many"
            f" {board.cell}s."
        )
        yield Reason(sentence, case.next.fit(), (key,))


def _target_size(case: Case) -> Iterator[Reason]:
    """Check that a target of points, whose unit is the metre, has a plausible width."""
    board = case.calibration.board
    key, width = _key(board), board.width
    radius = max(_declared_lengths(case.calibration.declared.cover, RADIUS).values(), default=0.0)
    if not SMALLEST_BOARD <= width <= LARGEST_BOARD:
        yield Reason(
            f"the target would be {width:.3g} m wide: check {key}.", case.next.fit(), (key,)
        )
    elif width < radius:
        sentence = (
            f"the target would be {1e3 * width:.3g} mm wide, less than the cover's radius of"
            f" {1e3 * radius:.3g} mm: check {key}."
        )
        word = Trust.DO_NOT_USE if width < TINY * radius else Trust.CARE
        yield Reason(sentence, case.next.fit(), (key,), word)


def small_board(case: Case) -> Iterator[str]:
    """Yield a note where a bare camera's board is so small that its unit is doubted. The squares
    scale what is measured, and no map depends on them.
    """
    board = case.calibration.board
    is_doubted = board.has_grid and SMALLEST_BOARD <= board.width < SMALL_BOARD
    if is_doubted and not case.calibration.model()[0].cover:
        yield (
            f"the board would be {1e3 * board.width:.3g} mm wide, and every length that you measure"
            f" depends on it: check {_key(board)}, {BOARD_UNIT}."
        )


def cover_size(case: Case) -> Iterator[Reason]:
    """Check that declared radii and thicknesses are in the right unit."""
    cover = case.calibration.declared.cover
    kinds = [(RADIUS, SMALL_RADIUS, "small")]
    if cover.shape != FLAT.name and len(_declared_lengths(cover, THICKNESS)) == 1:
        kinds.append((THICKNESS, THIN_COVER, "thin"))
    for kind, minimum, adjective in kinds:
        for name, metres in _declared_lengths(cover, kind).items():
            if metres < minimum:
                sentence = (
                    f"{name} is declared as {1e3 * metres:.3g} mm, and hardly any cover is so"
                    f" {adjective}: {COVER_UNIT}, check it."
                )
                yield Reason(sentence, case.next.fit(), (name,))


def _declared_lengths(cover: Cover, kind: str) -> dict[str, float]:
    """Return the declared lengths of a kind in m by their names."""
    return {
        name: number.value
        for name, number in cover.numbers.items()
        if number_of(name) == kind and not number.unknown
    }


def _key(board: Board) -> str:
    if not board.has_grid:
        return TARGET_UNIT
    return "board.tag_mm" if isinstance(board.coding, AprilGrid) else "board.square_mm"
