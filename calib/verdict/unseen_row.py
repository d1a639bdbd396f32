"""Whether a board with markers has as many rows as are declared: with fewer, no view shows the last
one, and nothing else would tell; with more, pictures that show markers beyond it are left out, and
the others fit.
"""

from collections.abc import Iterator

import numpy as np

from calib.corners.coded import PAST_LAST_ROW
from calib.session.coding import AprilGrid
from calib.verdict.case import Case
from calib.verdict.thresholds import BESIDE_UNSEEN
from calib.verdict.verdict import Reason


def unseen_row(case: Case) -> Iterator[Reason]:
    """Rows are asked for alone: with other columns, markers lie not as declared."""
    board = case.calibration.board
    if board.coding is None:
        return
    seen = np.array(
        [view.seen.reshape(board.rows, board.columns).any(1) for view in case.calibration.views]
    )
    tags = isinstance(board.coding, AprilGrid)
    rows = (
        seen[:, -1::-2] | seen[:, -2::-2] if tags else seen
    )  # views x rows; tags are numbered from the lower left
    beside = int(rows[:, -2].sum()) if rows.shape[1] > 1 else 0
    if rows[:, -1].any() or beside < BESIDE_UNSEEN:
        return
    row = "uppermost row of tags" if tags else "last row of corners"
    said = (
        f"no view shows the board's {row}, and {beside} show the one beside it: if the board has"
        " fewer rows, correct board.rows; else show it whole in some views."
    )
    yield Reason(said, case.next.fit(), ("board.rows",))


def rows_beyond(case: Case) -> Iterator[Reason]:
    count = sum(PAST_LAST_ROW in rejected.reason for rejected in case.calibration.rejected)
    if count:
        shows = "a picture shows" if count == 1 else f"{count} pictures show"
        said = (
            f"{shows} markers {PAST_LAST_ROW} of the board: it has more rows than are declared, so"
            " correct board.rows."
        )
        yield Reason(said, case.next.fit(), ("board.rows",))
