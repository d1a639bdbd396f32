"""Targets with markers, which sessions cannot read yet: as OpenCV and Kalibr draw them, and found
where the sheet says.
"""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.errors import InputError
from calib.sheet.aprilgrid import AprilGridPattern
from calib.sheet.charuco import CharucoPattern
from calib.sheet.layout import lay_out
from calib.sheet.paper import parse_paper
from calib.sheet.pdf import to_pdf
from calib.sheet.sheet import Sheet
from calib.sheet.svg import to_svg
from calib.sheet.target import Pattern
from tests.sheet.reading import Raster, pdf_polygons, rasterise, svg_polygons

KALIBR = {0: 0xD5D628584, 1: 0xD97F18B49, 2: 0xDD280910E, 5: 0xF31DAB3AC, 35: 0x686D7002A}
"""Tags of kalibr_create_target_pdf: 36 bits, from the upper left, row by row, 1 is white."""

STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)

charucos = pytest.mark.parametrize(
    ("board", "side"),
    [
        (CharucoPattern(9, 6), 20.0),
        (CharucoPattern(6, 9, marker=0.7, dictionary="DICT_5X5_1000"), 20.0),
        (CharucoPattern(7, 5, dictionary="DICT_6X6_250", legacy_pattern=True), 25.0),
        (CharucoPattern(7, 6, legacy_pattern=True), None),
    ],
)
grids = pytest.mark.parametrize(
    ("grid", "side"), [(AprilGridPattern(6, 6), None), (AprilGridPattern(5, 4, spacing=0.25), 30.0)]
)


def made(pattern: Pattern, side: float | None) -> tuple[Sheet, Raster]:
    sizes = parse_paper("A4")
    assert sizes
    sheet = lay_out(pattern, sizes, side)
    pdf = to_pdf(sheet)
    assert np.array_equal(pdf_polygons(pdf), svg_polygons(to_svg(sheet)))
    return sheet, rasterise(pdf)


def measured(raster: Raster, rough: NDArray) -> NDArray[np.float64]:
    """(N, 2) mm, from (N, 2) px that are near."""
    grey = cv2.GaussianBlur(eight_bits(raster.grey), (0, 0), 1.5)
    result = cv2.cornerSubPix(
        grey, rough.reshape(-1, 1, 2).astype(np.float32), (11, 11), (-1, -1), STOP
    )
    return raster.place(result.reshape(-1, 2).astype(np.float64))


def opencv_s(board: CharucoPattern) -> cv2.aruco.CharucoBoard:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    drawn = cv2.aruco.CharucoBoard(
        (board.columns + 1, board.rows + 1), 1.0, board.marker, dictionary
    )
    drawn.setLegacyPattern(board.legacy_pattern)
    return drawn


@charucos
def test_a_charuco_is_opencv_s(board: CharucoPattern, side: float | None) -> None:
    """OpenCV's picture of the board lies over ours: pixels differ along edges alone."""
    sheet, raster = made(board, side)
    extent = np.array(board.extent)
    theirs = opencv_s(board).generateImage(tuple(int(n) for n in 120 * extent), None, 0, 1)
    zero = (np.array(sheet.corners[0]) - sheet.side) / raster.mm
    scale = sheet.side / 120 / raster.mm
    onto = np.array(
        [[scale[0], 0, zero[0] + scale[0] / 2 - 0.5], [0, scale[1], zero[1] + scale[1] / 2 - 0.5]]
    )
    ours = cv2.warpAffine(
        raster.grey, onto, theirs.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    is_uniform = cv2.dilate(theirs, np.ones((5, 5))) == cv2.erode(theirs, np.ones((5, 5)))
    assert is_uniform.mean() > 0.75
    assert np.array_equal(ours[is_uniform] > 127, theirs[is_uniform] > 127)


@charucos
def test_every_corner_of_a_charuco_is_found(board: CharucoPattern, side: float | None) -> None:
    """OpenCV names the corners; before version 5 its places were half a pixel off, so they are
    measured again.
    """
    sheet, raster = made(board, side)
    rough, names, _, _ = cv2.aruco.CharucoDetector(opencv_s(board)).detectBoard(raster.grey)
    assert names.ravel().tolist() == list(range(len(sheet.corners)))
    error = np.linalg.norm(measured(raster, rough) - sheet.corners, axis=1)
    assert error.max() < 0.05, f"{error.max():.4f} mm"


@grids
def test_every_corner_of_an_aprilgrid_is_found(grid: AprilGridPattern, side: float | None) -> None:
    """Each tag's four corners, where the number of a tag says: 0 at the lower left, then to the
    right, then up.
    """
    sheet, raster = made(grid, side)
    options = cv2.aruco.DetectorParameters()
    options.markerBorderBits = 2
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, names, _ = cv2.aruco.ArucoDetector(dictionary, options).detectMarkers(raster.grey)
    assert sorted(names.ravel().tolist()) == list(range(grid.columns * grid.rows))
    expected = np.array(sheet.corners).reshape(2 * grid.rows, 2 * grid.columns, 2)
    for name, rough in zip(names.ravel(), corners, strict=True):
        number = int(name)
        i, j = number % grid.columns, grid.rows - 1 - number // grid.columns
        upper, lower = expected[2 * j, 2 * i : 2 * i + 2], expected[2 * j + 1, 2 * i : 2 * i + 2]
        turned = np.array(
            [lower[1], lower[0], upper[0], upper[1]]
        )  # clockwise from OpenCV's first, which is upside down
        error = np.linalg.norm(measured(raster, np.asarray(rough)) - turned, axis=1)
        assert error.max() < 0.05, f"tag {number}: {error.max():.4f} mm"


def test_tags_have_kalibr_s_bits() -> None:
    grid = AprilGridPattern(6, 6)
    sheet, raster = made(grid, None)
    expected = np.array(sheet.corners).reshape(12, 12, 2)
    for number, code in KALIBR.items():
        i, j = number % 6, 5 - number // 6
        cells = (
            expected[2 * j, 2 * i]
            + (np.indices((10, 10)).transpose(1, 2, 0)[..., ::-1] + 0.5) * sheet.side / 10
        )
        x, y = np.rint(cells / raster.mm - 0.5).astype(int).reshape(-1, 2).T
        white = (raster.grey[y, x] > 127).reshape(10, 10)
        bits = [bool(code >> (35 - k) & 1) for k in range(36)]
        assert white[2:8, 2:8].ravel().tolist() == bits, number
        assert white.sum() == sum(bits), "two cells of black around them"


@pytest.mark.parametrize(
    "board", [CharucoPattern(11, 11, dictionary="DICT_4X4_50"), AprilGridPattern(25, 24)]
)
def test_more_markers_than_the_dictionary_has_are_refused(board: Pattern) -> None:
    with pytest.raises(
        InputError,
        match=(
            r"the board needs (72|600) markers where DICT_\w+ has (50|587): take fewer columns or"
            r" rows"
        ),
    ):
        board.draw(10.0)
