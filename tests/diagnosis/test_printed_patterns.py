"""Fields that are made of one formula are told by it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.diagnosis.printed_patterns import closed_forms

Array = NDArray[np.float64]
SPACING = 0.02
POINTS: Array = np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0)), -1).reshape(-1, 2) * SPACING
X, Y = (POINTS - POINTS.mean(0)).T
SIZE = 2e-4
NOISE = 1e-5
"""m, of what a fit knows of a field at one corner."""

FIELDS = {
    "a wave of 75 mm along y": (np.zeros_like(X), np.sin(2 * np.pi * Y / 0.075 + 0.4)),
    "a wave of 60 mm at 30 degrees to x": (
        np.cos(2 * np.pi / 0.060 * (X * np.cos(np.pi / 6) + Y * np.sin(np.pi / 6))),
        np.zeros_like(X),
    ),
    "a step across x, +10 mm from the middle": (np.zeros_like(X), (X > 0.005).astype(float)),
    "a cusp across y, -10 mm from the middle": (np.abs(Y + 0.01) / 0.05, np.zeros_like(X)),
    "a polynomial of degree 2": ((X / 0.08) ** 2, X * Y / 0.005),
    "a lattice of the squares": ((-1.0) ** np.round(X / SPACING), np.zeros_like(X)),
}


@pytest.mark.parametrize("words", FIELDS)
def test_a_field_of_one_formula_is_identified(words: str) -> None:
    noise = np.random.default_rng(0).normal(0, NOISE, POINTS.shape)
    best, *alternatives = closed_forms(
        POINTS, SIZE * np.column_stack(FIELDS[words]) + noise, SPACING
    )
    assert best.words == words
    assert (
        best.explains > 0.9
        # noise is (1e-5 / 1.4e-4)^2, below 1 %, of a wave, and up to 10 % of what a pose leaves of
        # the others
    )
    assert all(alternative.explains < best.explains for alternative in alternatives)


def test_shifts_by_a_pose_belong_to_no_formula() -> None:
    """The same field on a board that is elsewhere, turned and nearer."""
    wave = SIZE * np.column_stack(FIELDS["a wave of 75 mm along y"])
    posed = wave + 1e-3 + 0.01 * POINTS + 0.02 * np.column_stack([-Y, X])
    plain_form, *_ = closed_forms(POINTS, wave, SPACING)
    posed_form, *_ = closed_forms(POINTS, posed, SPACING)
    assert posed_form.words == plain_form.words
    assert posed_form.explains == pytest.approx(plain_form.explains, abs=1e-6)


def test_noise_is_no_formula() -> None:
    """158 free values; a form chosen of some hundred explains a tenth of them at most by chance,
    nine times of ten.
    """
    best = [
        closed_forms(POINTS, np.random.default_rng(seed).normal(0, SIZE, POINTS.shape), SPACING)[
            0
        ].explains
        for seed in range(10)
    ]
    assert np.median(best) < 0.2
