"""Rotation vectors, over all angles and through zero, where both the matrix and its derivative
change from a formula to its series.
"""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.optics import rotation

unit = st.floats(-1, 1)
angles = st.one_of(
    st.floats(0, 7),  # rad: a whole turn, and more
    st.floats(-12, 0).map(lambda power: 10.0**power),
    st.sampled_from(
        [0.0, *(near * (1 + step) for near in (1e-4, 1e-3) for step in (-1e-9, 1e-9))]
    ),  # where the series take over
)
directions = st.tuples(unit, unit, unit).filter(lambda v: float(np.hypot.reduce(v)) > 0.1)
rotvecs = st.builds(
    lambda direction, angle: angle * np.array(direction) / np.linalg.norm(direction),
    directions,
    angles,
)

STEP = 1e-5


@given(directions)
def test_a_direction_is_turned_onto_the_axis(direction: tuple[float, float, float]) -> None:
    """The matrix is a rotation for every direction."""
    unit = torch.tensor(direction, dtype=torch.float64)
    unit = unit / unit.norm()
    turn = rotation.onto_z(unit)
    axis = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    assert (turn @ unit - axis).abs().max() < 1e-14
    assert (turn @ turn.mT - torch.eye(3, dtype=torch.float64)).abs().max() < 1e-14
    assert torch.linalg.det(turn) > 0


@given(rotvecs)
def test_the_matrix_is_scipy_s(rotvec: np.ndarray) -> None:
    """To some roundings of its entries, none of which is larger than one."""
    ours = rotation.matrix(torch.from_numpy(rotvec)).numpy()
    assert np.abs(ours - Rotation.from_rotvec(rotvec).as_matrix()).max() < 1e-14


@given(rotvecs)
def test_the_derivative_is_that_of_central_differences(rotvec: np.ndarray) -> None:
    """The differences are of scipy's matrices.

    Their error is STEP^2 / 6 times the third derivative, and the roundings of the matrices over
    STEP: 2e-11 each, times some.
    """
    vector = torch.from_numpy(rotvec)
    derivatives = rotation.derivatives(vector, rotation.matrix(vector)).numpy()
    for axis, step in enumerate(STEP * np.eye(3)):
        forward = Rotation.from_rotvec(rotvec + step).as_matrix()
        back = Rotation.from_rotvec(rotvec - step).as_matrix()
        assert np.abs(derivatives[axis] - (forward - back) / (2 * STEP)).max() < 2e-10


@given(directions, st.floats(-12, -2))
def test_both_functions_are_smooth_at_zero(
    direction: tuple[float, float, float], power: float
) -> None:
    """A turn and the same turn back are none, and the derivative's second difference across zero is
    of the second order: no step where the series take over.
    """
    axis = torch.tensor(direction, dtype=torch.float64)
    axis = axis / axis.norm()
    line = 10.0**power * axis * torch.tensor([[-1.0], [0.0], [1.0]], dtype=torch.float64)
    initial, at, final = rotation.matrix(line)
    assert torch.equal(at, torch.eye(3, dtype=torch.float64))
    assert (initial @ final - at).abs().max() < 1e-15, "turning back undoes it"
    derivatives = rotation.derivatives(line, rotation.matrix(line))
    assert (derivatives[0] + derivatives[2] - 2 * derivatives[1]).abs().max() < 10.0 ** (
        2 * power
    ) + 1e-15


def test_many_vectors_are_turned_as_each_alone() -> None:
    many = torch.from_numpy(np.random.default_rng(0).normal(size=(4, 3, 3)))
    turns = rotation.matrix(many)
    alone = torch.stack([rotation.matrix(vector) for vector in many.reshape(-1, 3)])
    assert turns.reshape(-1, 3, 3).numpy() == pytest.approx(alone.numpy(), abs=1e-15)
