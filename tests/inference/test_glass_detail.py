"""The surface of the glass in detail, from slopes."""

import numpy as np

from calib.inference.glass_detail import integrate_slopes


def test_slopes_of_a_known_surface_give_its_heights() -> None:
    """Places 0.1 mm apart with a hole, as charts have them: metres along one axis, radians along
    the other. The trapezoidal rule is exact for this surface of degree 2.
    """
    rows, columns = 30, 40
    first, second = np.meshgrid(1e-4 * np.arange(rows), 2e-3 * np.arange(columns), indexing="ij")
    is_glass = np.ones((rows, columns), np.bool_)
    is_glass[10:15, 20:27] = False
    grid = np.full((rows, columns), -1)
    grid[is_glass] = np.arange(is_glass.sum())
    y, angle = first[is_glass], second[is_glass]
    height = 3 * y**2 + 1e-5 * angle**2 + 2e-3 * y * angle
    slopes = np.stack([6 * y + 2e-3 * angle, 2e-5 * angle + 2e-3 * y], -1)
    noise = np.random.default_rng(0).normal(0, 1e-6, slopes.shape) * [1.0, 0.05]
    heights = integrate_slopes(grid, np.stack([y, angle], -1), np.stack([slopes, slopes + noise]))
    expected = height - height.mean()
    assert np.abs(heights[0] - expected).max() < 1e-6 * np.ptp(expected)
    # Noise of 1e-6 over 0.1 mm: some tenths of a nanometre from end to end.
    assert 1e-11 < np.abs(heights[1] - expected).max() < 1e-9
