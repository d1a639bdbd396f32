"""Check: the distance of the boards is plausible. Squares given in centimetres put them inside the
cover, squares given in metres put them too far away.
"""

from collections.abc import Iterator

import numpy as np

from calib.verdict.case import Case
from calib.verdict.thresholds import FAR_AWAY, INSIDE, SMALL_COVER
from calib.verdict.verdict import Reason, Trust


def board_place(case: Case) -> Iterator[Reason]:
    if not case.calibration.model()[0].cover:
        return
    glass = float(np.median(np.linalg.norm(case.rays.origin.stacked().numpy(), axis=-1)))
    board = float(np.median(np.linalg.norm(case.corners, axis=-1)))
    distances = (
        f"half of the corners would be nearer than {board:.3g} m, where the cover's outer face is"
        f" at {glass:.3g} m"
    )
    suspects = ("board.square_mm",)
    if board < INSIDE * glass:
        sentence = (
            f"{distances}: the board would stand inside of the cover or touch it. Check"
            " board.square_mm."
        )
        yield Reason(sentence, case.next.fit(), suspects, Trust.DO_NOT_USE)
    elif board > FAR_AWAY * max(glass, SMALL_COVER):
        sentence = f"{distances}: the board would be as large as a house. Check board.square_mm."
        yield Reason(sentence, case.next.fit(), suspects, Trust.DO_NOT_USE)
