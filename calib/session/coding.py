"""What makes a board's corners tell which they are: markers with numbers, beside the corners or
between them.
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
"""OpenCV's names, and how many markers each has."""

TYPES = ("checkerboard", "charuco", "aprilgrid")
"""As session.yaml and the command line call them."""
SPACING_LIMITS = (0.05, 1.0)
"""Of an AprilGrid, in sides of a tag."""


@dataclass(frozen=True, slots=True)
class Charuco:
    """A marker in each white square of a checkerboard, as OpenCV draws it."""

    marker: float
    """m, side of a marker."""
    dictionary: str
    legacy_pattern: bool = False
    """Whether a board with an even number of rows of squares begins with a white one, as OpenCV's
    did before 4.6 and calib.io's do.
    """


@dataclass(frozen=True, slots=True)
class AprilGrid:
    """Kalibr's: the corners are those of tags of one family, which touch small black squares."""

    spacing: float
    """Between two tags, in sides of a tag."""
    dictionary: str = "DICT_APRILTAG_36h11"


Coding = Charuco | AprilGrid
