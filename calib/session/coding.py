"""The coding of a board: numbered markers, inside its squares or between them, that identify its
corners.
"""

from dataclasses import dataclass

DICTIONARIES = {
    **{
        f"DICT_{bits}X{bits}_{count}": count
        for bits in (4, 5, 6, 7)
        for count in (50, 100, 250, 1000)
    },
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_ARUCO_MIP_36h12": 250,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
}
"""OpenCV's names, and the number of markers in each dictionary."""

TYPES = ("checkerboard", "charuco", "aprilgrid", "gridboard")
"""The names of the board types in session.yaml and on the command line."""
SPACING_LIMITS = (0.05, 1.0)
"""The limits of an AprilGrid's spacing, in sides of a tag."""
BORDERS = (1, 2)
"""The widths, in cells, that the black border of an AprilGrid's tags may have."""
FIRST_ROWS = ("lower_left", "upper_left")
"""The tag with which the numbers of a grid begin; they run along the rows."""
ROTATIONS_DEG = (0, 90, 180, 270)
"""The turns that a grid's tags may have, clockwise against OpenCV's drawing of them."""


@dataclass(frozen=True, slots=True)
class Charuco:
    """A checkerboard with a marker in each white square, as OpenCV draws it."""

    marker: float
    """m, the side of a marker."""
    dictionary: str
    legacy_pattern: bool = False
    """True if a board with an even number of rows of squares starts with a white square, as
    OpenCV's did before 4.6 and calib.io's do.
    """
    first_marker: int = 0
    """The number of the first marker."""
    inverted: bool = False
    """True if the board is printed white on black."""

    @property
    def border(self) -> int:
        """Cells of black around a marker's bits."""
        return 1


@dataclass(frozen=True, slots=True)
class AprilGrid:
    """A grid of tags, whose corners are the board's: Kalibr's board, with small black squares
    between its tags, or OpenCV's GridBoard, without.
    """

    spacing: float
    """The gap between two tags, in sides of a tag."""
    dictionary: str = "DICT_APRILTAG_36h11"
    first_marker: int = 0
    """The number of the first tag."""
    border: int = 2
    """Cells of black around a tag's bits: Kalibr's tags have one more than others."""
    numbered_from: str = "lower_left"
    """The tag with which the numbers begin, one of FIRST_ROWS."""
    rotation_deg: int = 180
    """The turn of the tags, one of ROTATIONS_DEG."""
    inverted: bool = False
    """True if the board is printed white on black."""
    crossings: bool = True
    """True if small squares touch the tags' corners, so that two edges cross in each."""


def grid_board(
    spacing: float, dictionary: str, first_marker: int = 0, *, inverted: bool = False
) -> AprilGrid:
    """Return the coding of OpenCV's GridBoard."""
    return AprilGrid(
        spacing,
        dictionary,
        first_marker,
        border=1,
        numbered_from="upper_left",
        rotation_deg=0,
        inverted=inverted,
        crossings=False,
    )


Coding = Charuco | AprilGrid
