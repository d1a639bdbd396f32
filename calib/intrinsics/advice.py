"""Advice for users whose views without the cover do not determine the intrinsics."""

from calib.errors import NotEnoughDataError

TILT = "tilt the board by about 30 degrees, to each side and up and down, in 6 views"
NO_FIT_OF_POINTS = (
    "No intrinsics fit these views: check that pixels and target of each file in points/ go"
    f" together, and {TILT.replace('board', 'target')}."
)


class NoFitError(NotEnoughDataError):
    """No intrinsics fit the views of a board."""

    def __init__(self) -> None:
        super().__init__(
            f"No intrinsics fit these views: check board.columns and board.rows, and {TILT}."
        )
