"""Checks: the board has a plausible size at a plausible distance, and its size is known. Squares
given in centimetres put the boards inside the cover, squares given in metres put them too far away.
"""

from collections.abc import Iterator

import numpy as np

from calib.calibration import Calibration
from calib.session.board import Board
from calib.session.coding import AprilGrid
from calib.session.parameter_names import number_of
from calib.verdict.case import Case
from calib.verdict.thresholds import (
    FAR_AWAY,
    INSIDE,
    LARGEST_BOARD,
    REACHED_GLASS,
    SMALL_COVER,
    SMALL_RADIUS,
    SMALLEST_BOARD,
    TINY,
    UNSURE_SQUARE,
)
from calib.verdict.verdict import Reason, Trust


def board_place(case: Case) -> Iterator[Reason]:
    """Check the distance of the boards before a cover."""
    if not case.calibration.model()[0].cover:
        return
    to_glass = np.linalg.norm(case.rays.origin.stacked().numpy(), axis=-1)
    to_corner = np.linalg.norm(case.corners, axis=-1)
    inside = float(np.mean(to_corner < to_glass))
    glass, board = float(np.median(to_glass)), float(np.median(to_corner))
    key = _key(case.calibration.board)
    distances = (
        f"half of the corners would be nearer than {board:.3g} m, where the cover's outer face is"
        f" at {glass:.3g} m"
    )
    if board < INSIDE * glass:
        sentence = (
            f"{distances}: the board would stand inside of the cover or touch it. Check {key}."
        )
        yield Reason(sentence, case.next.fit(), (key,), Trust.DO_NOT_USE)
    elif inside > REACHED_GLASS:
        sentence = (
            f"{100 * inside:.0f} % of the corners would be inside of the cover, where the board"
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
        return
    key = _key(board)
    width = 2 * max(board.half)
    if not SMALLEST_BOARD <= width <= LARGEST_BOARD:
        sentence = (
            f"the board would be {width:.3g} m wide, with {board.cell}s of {board.square:.3g} m:"
            f" check {key}, whose unit is the millimetre."
        )
        yield Reason(sentence, case.next.fit(), (key,))
    radius = max(_declared_radii(case.calibration).values(), default=0.0)
    if SMALLEST_BOARD <= width < radius:
        sentence = (
            f"the board would be {1e3 * width:.3g} mm wide, less than the cover's radius of"
            f" {1e3 * radius:.3g} mm: check {key}, whose unit is the millimetre."
        )
        word = Trust.DO_NOT_USE if width < TINY * radius else Trust.CARE
        yield Reason(sentence, case.next.fit(), (key,), word)
    if board.square_sigma is not None and board.relative_sigma > UNSURE_SQUARE:
        sentence = (
            f"{key} is known to {100 * board.relative_sigma:.2g} % only"
            f" ({1e3 * board.square:.4g} ± {1e3 * board.square_sigma:.2g} mm), and so is every"
            " length and every distance that this calibration gives: measure it over many"
            f" {board.cell}s."
        )
        yield Reason(sentence, case.next.fit(), (key,))


def cover_size(case: Case) -> Iterator[Reason]:
    """Check that a declared radius is in the right unit."""
    for name, radius in _declared_radii(case.calibration).items():
        if radius < SMALL_RADIUS:
            sentence = (
                f"{name} is declared as {1e3 * radius:.3g} mm, and hardly any cover is so small:"
                " lengths are in millimetres, check it."
            )
            yield Reason(sentence, case.next.fit(), (name,))


def _declared_radii(calibration: Calibration) -> dict[str, float]:
    """Return the declared inner radii in m by their names."""
    return {
        name: number.value
        for name, number in calibration.declared.cover.numbers.items()
        if number_of(name) == "inner_radius" and not number.unknown
    }


def _key(board: Board) -> str:
    if not board.has_grid:
        return "the target's coordinates, which are metres"
    return "board.tag_mm" if isinstance(board.coding, AprilGrid) else "board.square_mm"
