"""The estimate of how much larger black looks, on tags that are drawn with moved edges."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter

from calib.corners.ink_spread import NO_INK_SPREAD, measure_ink_spread, remove_ink_spread
from calib.corners.markers import black_cells
from calib.corners.tag_outline import measure_outlines

Array = NDArray[np.float64]

STRATA = 8
CELL = 10
"""px"""
DICTIONARY = "DICT_APRILTAG_36h11"
EDGE = 45
CORNERS = EDGE - 0.5 + 8 * CELL * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])


def drawn(number: int, grown: int, noise: float = 2.0) -> NDArray[np.uint8]:
    """A tag whose black is wider by so many eighths of a pixel at every edge."""
    fine = np.kron(
        np.pad(black_cells(DICTIONARY, number, 1), 1), np.ones((CELL * STRATA, CELL * STRATA), bool)
    )
    padded = np.pad(fine, (EDGE - CELL) * STRATA)
    cross = np.ones((3, 3), bool)
    if grown:
        padded = (binary_dilation if grown > 0 else binary_erosion)(padded, cross, abs(grown))
    light: Array = gaussian_filter(np.where(padded, 25.0, 190.0), 0.6 * STRATA)
    size = len(padded) // STRATA
    grey: Array = light.reshape(size, STRATA, size, STRATA).mean((1, 3))
    grey += np.random.default_rng(number).normal(0, noise, (size, size))
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("grown", [-3, -1, 0, 1, 3])
def test_growth_is_found_and_taken_off(grown: int) -> None:
    picture = drawn(5, grown)
    outlines = measure_outlines(picture, (CORNERS + 0.3)[None], 8)
    growth = measure_ink_spread(picture, outlines.corners, [black_cells(DICTIONARY, 5, 1)])
    assert abs(growth.px - grown / STRATA) < max(4 * growth.sigma, 0.012)
    assert growth.sigma < 0.01
    assert growth.is_significant == (grown != 0)
    corrected = remove_ink_spread(growth, outlines)
    assert np.abs(corrected.corners[0] - CORNERS).max() < 0.03
    assert (np.linalg.eigvalsh(corrected.covariances[0] - outlines.covariances[0]) > -1e-12).all()


def test_a_turned_tag_gives_the_same_ink_spread() -> None:
    """Each edge is looked at from its own black to its own white, whichever way the tag lies in the
    picture.
    """
    black = black_cells(DICTIONARY, 9, 1)
    picture = drawn(9, 2)
    for quarter in range(4):
        turned = np.rot90(picture, -quarter)  # clockwise
        outlines = measure_outlines(turned, CORNERS[None], 8)
        growth = measure_ink_spread(turned, np.roll(outlines.corners, -quarter, 1), [black])
        assert growth.px == pytest.approx(2 / STRATA, abs=0.02)


def test_other_outlines_give_no_ink_spread() -> None:
    plain = np.full((170, 170), 128, np.uint8)
    assert (
        measure_ink_spread(plain, CORNERS[None], [black_cells(DICTIONARY, 5, 1)]) == NO_INK_SPREAD
    )
    assert measure_ink_spread(plain, np.zeros((0, 4, 2)), []) == NO_INK_SPREAD
