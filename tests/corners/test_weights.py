"""From covariances to weights."""

import numpy as np

from calib.corners.view import View
from calib.corners.weights import weigh_views


def test_the_better_half_has_weight_one_and_the_others_by_their_spread() -> None:
    spread = np.array([0.01, 0.02, 0.03, 0.04, 0.06])
    covariance = spread[:, None, None] ** 2 * np.eye(2)
    measured = View("a", np.zeros((5, 2)), np.ones(5), covariance=covariance)
    hidden = View("b", np.full((5, 2), np.nan), np.zeros(5), covariance=np.full((5, 2, 2), np.nan))
    plain = View("c", np.zeros((5, 2)), np.full(5, 0.25))
    weighted, two, three = weigh_views([measured, hidden, plain])
    np.testing.assert_allclose(weighted.weight, [1, 1, 1, 0.75, 0.5])
    assert not two.seen.any()
    assert three is plain
    assert weigh_views([plain]) == (plain,)
