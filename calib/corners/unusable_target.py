"""Find out why no board can be measured in pictures that seem to show one: a grid of circles, or
two equal boards.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.board_size import ShownSize
from calib.corners.detection import Detection
from calib.corners.find import CHECKERBOARD_ADVICE, describe_two_boards, find_board
from calib.corners.other_coding import negative
from calib.corners.picture_scale import reduce_picture, reducing_factor
from calib.session.board import Board

CIRCLES = (
    "The pictures show a grid of circles, which calib does not detect: show a checkerboard, or a"
    " board with markers (charuco, aprilgrid or gridboard)"
)
CIRCLE_GRIDS = (
    ((5, 4), cv2.CALIB_CB_SYMMETRIC_GRID),
    ((7, 6), cv2.CALIB_CB_SYMMETRIC_GRID),
    ((3, 7), cv2.CALIB_CB_ASYMMETRIC_GRID),
    ((4, 9), cv2.CALIB_CB_ASYMMETRIC_GRID),
    ((4, 11), cv2.CALIB_CB_ASYMMETRIC_GRID),
)
"""Columns and rows of the grids that are searched for; a larger grid holds the smaller ones."""
CIRCLE_PICTURES = 4
"""Pictures that are searched for circles."""
CIRCLE_SIDE = 960
"""px, the longer side of these pictures."""
MIN_BLOBS = 20
"""Blobs of the smallest grid."""
MAX_BLOBS = 250
"""Blobs beyond which a picture is not searched: OpenCV takes minutes for the stones of gravel."""
MIN_CIRCULARITY = 0.8
"""4 pi of the area over the square of the circumference: a circle seen at 60 degrees has 0.84, a
square 0.79.
"""


def why_unusable(pictures: Sequence[NDArray[np.uint8]], shown: ShownSize | None) -> str:
    """Return a sentence, without its full stop, on what prevents the corners of the checkerboard
    that (H, W) pictures seem to show from being found; empty if the detector finds them in one of
    the pictures, or if nothing is shown.
    """
    if shown:
        board = Board(shown.columns, shown.rows, 1.0)
        two = describe_two_boards(board)
        reasons = []
        for index in shown.pictures:
            result = find_board(pictures[index], board)
            if isinstance(result, Detection):
                return ""
            reasons.append(result.reason)
        if two in reasons:
            return f"In the pictures {two}"
    if shows_circles(pictures):
        return CIRCLES
    if shown:
        return (
            f"The pictures seem to show a checkerboard of {board} inner corners, and its corners"
            f" cannot be measured: {CHECKERBOARD_ADVICE}"
        )
    return ""


def shows_circles(pictures: Sequence[NDArray[np.uint8]]) -> bool:
    """Return True if most of the first (H, W) pictures show a grid of circles, dark or light."""
    reduced = [
        reduce_picture(picture, reducing_factor(picture, CIRCLE_SIDE))
        for picture in pictures[:CIRCLE_PICTURES]
    ]
    hits = sum(_has_circles(picture) or _has_circles(negative(picture)) for picture in reduced)
    return 2 * hits > len(reduced)


def _has_circles(picture: NDArray[np.uint8]) -> bool:
    settings = cv2.SimpleBlobDetector.Params()
    settings.filterByCircularity = True
    settings.minCircularity = MIN_CIRCULARITY
    detector = cv2.SimpleBlobDetector.create(settings)
    count = len(detector.detect(picture))
    if not MIN_BLOBS <= count <= MAX_BLOBS:
        return False
    return any(
        cv2.findCirclesGrid(picture, size, flags=flags, blobDetector=detector)[0]
        for size, flags in CIRCLE_GRIDS
    )
