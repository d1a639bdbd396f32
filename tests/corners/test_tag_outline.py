"""A tag's corners where its edges meet: against squares that are drawn by counting which points lie
within.
"""

from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from calib.corners.tag_outline import measure_outlines

Array = NDArray[np.float64]

STRATA = 16
SIZE = 120
CORNERS = np.array([[30.3, 25.8], [88.1, 33.4], [92.7, 90.2], [24.6, 84.9]])
ROUGH = np.array([[0.4, -0.3], [-0.5, 0.2], [0.3, 0.5], [-0.2, -0.4]])
CELLS = 8


@lru_cache
def light(bends: tuple[float, ...], blur: float) -> Array:
    """Grey levels of a square that is black within four edges, each bent outwards by so many px at
    its middle, as a parabola.
    """
    at = (np.arange(SIZE * STRATA) + 0.5) / STRATA - 0.5
    x, y = np.meshgrid(at, at)
    mask = np.ones(x.shape, bool)
    for corner, following, bend in zip(CORNERS, np.roll(CORNERS, -1, 0), bends, strict=True):
        step = following - corner
        length = float(np.hypot(*step))
        share = ((x - corner[0]) * step[0] + (y - corner[1]) * step[1]) / length**2
        distance = ((x - corner[0]) * step[1] - (y - corner[1]) * step[0]) / length
        mask &= distance <= 4 * bend * share * (1 - share)
    sharp = np.where(mask, 25.0, 190.0)
    return np.asarray(
        gaussian_filter(sharp, blur * STRATA, mode="nearest")
        .reshape(SIZE, STRATA, SIZE, STRATA)
        .mean((1, 3))
    )


def drawn(
    bends: tuple[float, ...] = (0, 0, 0, 0), blur: float = 0.6, noise: float = 0.0, seed: int = 1
) -> NDArray[np.uint8]:
    uneven = light(bends, blur) * (1 + 0.05 * np.linspace(-1, 1, SIZE))
    return np.clip(
        np.rint(uneven + np.random.default_rng(seed).normal(0, noise, uneven.shape)), 0, 255
    ).astype(np.uint8)


@pytest.mark.parametrize("blur", [0.4, 0.6, 1.5])
def test_corners_are_where_the_edges_meet(blur: float) -> None:
    outlines = measure_outlines(drawn(blur=blur), (CORNERS + ROUGH)[None], CELLS)
    assert (
        np.abs(outlines.corners[0] - CORNERS).max() < 0.012
    )  # rounding, and the sampling of 16 points across a pixel


def test_pictures_of_16_bits_give_the_same_result() -> None:
    picture = drawn()
    low_bits = measure_outlines(picture, (CORNERS + ROUGH)[None], CELLS)
    many = measure_outlines(picture.astype(np.uint16) * 257, (CORNERS + ROUGH)[None], CELLS)
    assert np.allclose(low_bits.corners, many.corners, atol=1e-9)
    assert np.allclose(low_bits.covariances, many.covariances, rtol=1e-6)


def test_a_known_bend_is_corrected_and_an_unknown_one_biases_the_corners() -> None:
    bends = (0.3, -0.2, 0.25, 0.3)
    picture = drawn(bends)
    corrected = measure_outlines(picture, (CORNERS + ROUGH)[None], CELLS, np.array([bends]))
    unknown = measure_outlines(picture, (CORNERS + ROUGH)[None], CELLS, None)
    assert np.abs(corrected.corners[0] - CORNERS).max() < 0.012
    assert (
        0.1 < np.abs(unknown.corners[0] - CORNERS).max() < 0.4
    )  # about two thirds of the bend, of each edge


def test_covariance_equals_the_scatter_over_repeated_noise() -> None:
    pictures = [drawn(noise=4.0, seed=seed) for seed in range(60)]
    outlines = [measure_outlines(picture, (CORNERS + ROUGH)[None], CELLS) for picture in pictures]
    error = np.array([item.corners[0].ravel() for item in outlines])
    error -= error.mean(0)
    predicted = np.mean([item.covariances[0] for item in outlines], 0)
    chi2 = np.mean(np.einsum("ni,ij,nj->n", error, np.linalg.inv(predicted), error)) / 8 * 60 / 59
    assert 0.7 < chi2 < 1.3  # 480 numbers scatter by 7 %; the noise itself is estimated
    along_one_edge = np.corrcoef(error[:, 1], error[:, 3])[
        0, 1
    ]  # y of the two ends of the upper edge: an extrapolated line
    expected = predicted[1, 3] / np.sqrt(predicted[1, 1] * predicted[3, 3])
    assert abs(along_one_edge - expected) < 0.3


@pytest.mark.parametrize("spoilt", ["flat", "negative", "outside"])
def test_an_outline_that_is_no_black_square_is_rejected(spoilt: str) -> None:
    picture = drawn()
    if spoilt == "flat":
        picture[:] = 128
    shown = 255 - picture if spoilt == "negative" else picture
    rough = CORNERS + (500 if spoilt == "outside" else 0)
    outlines = measure_outlines(shown, np.stack([rough, rough]), CELLS)
    assert np.isnan(outlines.corners).all()
    assert np.isnan(outlines.covariances).all()


def test_no_tags_are_none() -> None:
    assert measure_outlines(drawn(), np.zeros((0, 4, 2)), CELLS).corners.shape == (0, 4, 2)


def test_a_picture_without_noise_is_still_rounded() -> None:
    picture = np.full((SIZE, SIZE), 200, np.uint8)
    picture[30:90, 30:90] = 20
    corners = np.array([[29.5, 29.5], [89.5, 29.5], [89.5, 89.5], [29.5, 89.5]])
    outlines = measure_outlines(picture, corners[None], CELLS)
    assert np.abs(outlines.corners[0] - corners).max() < 0.01
    assert np.linalg.eigvalsh(outlines.covariances[0]).min() > 0
