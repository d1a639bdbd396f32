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

TYPES = ("checkerboard", "charuco", "aprilgrid")
"""The names of the board types in session.yaml and on the command line."""
SPACING_LIMITS = (0.05, 1.0)
"""The limits of an AprilGrid's spacing, in sides of a tag."""


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


@dataclass(frozen=True, slots=True)
class AprilGrid:
    """Kalibr's board: its corners are those of tags of one family, with small black squares between
    them.
    """

    spacing: float
    """The gap between two tags, in sides of a tag."""
    dictionary: str = "DICT_APRILTAG_36h11"


Coding = Charuco | AprilGrid
