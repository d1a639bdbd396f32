"""Where the boards would stand beside the cover: a square in centimetres puts them inside it, one
in metres beyond the houses.
"""

from collections.abc import Iterator

import numpy as np

from calib.verdict.case import Case
from calib.verdict.thresholds import FAR_AWAY, INSIDE, SMALL_COVER
from calib.verdict.verdict import Reason, Word


def board_place(case: Case) -> Iterator[Reason]:
    if not case.calibration.model()[0].cover:
        return
    glass = float(np.median(np.linalg.norm(case.rays.origin.stacked().numpy(), axis=-1)))
    board = float(np.median(np.linalg.norm(case.corners, axis=-1)))
    where = (
        f"half of the corners would be nearer than {board:.3g} m, where the cover's outer face is"
        f" at {glass:.3g} m"
    )
    suspects = ("board.square_mm",)
    if board < INSIDE * glass:
        said = (
            f"{where}: the board would stand inside of the cover or touch it. Check"
            " board.square_mm."
        )
        yield Reason(said, case.next.fit(), suspects, Word.DO_NOT_USE)
    elif board > FAR_AWAY * max(glass, SMALL_COVER):
        said = f"{where}: the board would be as large as a house. Check board.square_mm."
        yield Reason(said, case.next.fit(), suspects, Word.DO_NOT_USE)
