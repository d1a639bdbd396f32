"""Checks: a board with markers has the declared number of rows. With fewer, no view shows the last
row, without any other sign. With more, pictures that show the extra markers are rejected, and the
others fit.
"""

from collections.abc import Iterator

import numpy as np

from calib.corners.board_markers import PAST_LAST_ROW
from calib.session.coding import AprilGrid
from calib.verdict.case import Case
from calib.verdict.thresholds import BESIDE_UNSEEN
from calib.verdict.verdict import Reason


def unseen_row(case: Case) -> Iterator[Reason]:
    """Check for a row that no view shows.

    Wrong columns are noticed elsewhere, by displaced markers.
    """
    board = case.calibration.board
    if board.coding is None:
        return
    visible = np.array(
        [view.seen.reshape(board.rows, board.columns).any(1) for view in case.calibration.views]
    )
    tags = isinstance(board.coding, AprilGrid)
    rows = (
        visible[:, -1::-2] | visible[:, -2::-2] if tags else visible
    )  # views x rows; tags are numbered from the lower left
    adjacent = int(rows[:, -2].sum()) if rows.shape[1] > 1 else 0
    if rows[:, -1].any() or adjacent < BESIDE_UNSEEN:
        return
    row = "uppermost row of tags" if tags else "last row of corners"
    sentence = (
        f"no view shows the board's {row}, and {adjacent} show the one beside it: if the board has"
        " fewer rows, correct board.rows; else show it whole in some views."
    )
    yield Reason(sentence, case.next.fit(), ("board.rows",))


def extra_rows(case: Case) -> Iterator[Reason]:
    count = sum(PAST_LAST_ROW in rejected.reason for rejected in case.calibration.rejected)
    if count:
        shows = "a picture shows" if count == 1 else f"{count} pictures show"
        sentence = (
            f"{shows} markers {PAST_LAST_ROW} of the board: it has more rows than are declared, so"
            " correct board.rows."
        )
        yield Reason(sentence, case.next.fit(), ("board.rows",))
