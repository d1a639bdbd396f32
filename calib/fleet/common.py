"""The parameters that cameras of one make share, as one vector of numbers and the figure of the
glass, and the likelihood of this vector from each camera's views.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.estimation.likelihood_information import LikelihoodInformation
from calib.estimation.prior_conflict import PRIOR_INFLATION
from calib.estimation.stated_priors import widen_prior
from calib.estimation.surface_prior import figure_height, figure_heights, relief_basis
from calib.fleet.population import Population
from calib.optics.build import covered_path, footprint
from calib.optics.relief import Relief
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.freeing import ALL, free_parameters
from calib.session.glass import Glass, polynomial_degrees
from calib.session.numbers import covariance_of, numbers_of, replace_covariance, replace_numbers
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number

Array = NDArray[np.float64]
Corner = tuple[float, float]

LOOSE = 1e3
"""Factor of a tolerance that makes a prior as good as flat."""
DEGREE = 6
"""Degree of the figure that is learnt, unless the reliefs are coarser. Finer shapes are texture,
which differs from cover to cover.
"""
LATTICE = 24
"""Points along each side of the patch at which figures are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Common:
    """The vector: K numbers in SI units and px, followed by N coefficients of the figure in m."""

    names: tuple[str, ...]
    """The names of the K numbers."""
    intrinsics: Intrinsics
    """The intrinsics that the fleet's sessions declare, with tolerances; likewise the `cover`."""
    cover: Cover
    low: Corner
    """The lower corner of the figure's patch, m; `high` is the upper one."""
    high: Corner
    degree: int
    """The polynomial degree of the figure."""

    @staticmethod
    def of(names: tuple[str, ...], camera: Camera, calibrations: Sequence[Calibration]) -> Common:
        """Return the vector's definition for a fleet.

        Args:
            names: the numbers that all calibrations estimated.
            calibrations: of one kind, each with a relief.
        """
        intrinsics, cover = drawing(calibrations)
        low, high = footprint(*covered_path(intrinsics, cover), camera.width, camera.height)
        grids = [calibration.relief.grid for calibration in calibrations if calibration.relief]
        coarsest = min(min(grid) for grid in grids)
        return Common(names, intrinsics, cover, low, high, min(DEGREE, coarsest - 1))

    @property
    def centre(self) -> Array:
        """Return the declared vector, (K + N,)."""
        drawing = numbers_of(self.intrinsics, self.cover)
        return np.array(
            [
                *(drawing[name].value for name in self.names),
                *np.zeros(len(polynomial_degrees(self.degree))),
            ]
        )

    @property
    def axes(self) -> Array:
        """Return (K + N, K + N) columns in which cameras differ independently, as long as their
        tolerances.

        Each number has its own column. The focal lengths of x and y have their sum and difference,
        because one lens makes both.
        """
        drawing = numbers_of(self.intrinsics, self.cover)
        axes = np.diag(
            [
                *(drawing[name].sigma for name in self.names),
                *(figure_height(i + k) for i, k in polynomial_degrees(self.degree)),
            ]
        )
        if {*CAMERA.focal} <= {*self.names}:
            focal = [self.names.index(name) for name in CAMERA.focal]
            block = np.ix_(focal, focal)
            axes[block] = axes[block] @ np.array([[1, 1], [1, -1]]) / np.sqrt(2)
        return axes

    def likelihood(self, calibration: Calibration) -> LikelihoodInformation:
        """Return the likelihood from a camera's views and measurements: its posterior without the
        prior of the drawing.
        """
        assert calibration.relief
        assert calibration.camera.intrinsics
        model = calibration.camera_model()
        growth = model.path.relief_growth(model.means)
        to_figure = growth * self._to_figure(calibration.relief)
        parameters = model.parameters
        count = parameters.amplitudes
        places = parameters.entries(self.names)
        to_vector = np.zeros((len(self.names) + len(to_figure), parameters.count))
        to_vector[: len(self.names), places] = np.diag(parameters.scales.numpy()[places - count])
        to_vector[len(self.names) :, :count] = to_figure
        estimate = numbers_of(calibration.camera.intrinsics, calibration.cover)
        mean = np.array(
            [
                *(estimate[name].value for name in self.names),
                *to_figure @ calibration.amplitudes.ravel(),
            ]
        )
        stated, prior = self._prior(calibration, to_figure)
        return LikelihoodInformation.between(
            mean, to_vector @ calibration.covariance @ to_vector.T, stated, prior
        )

    def described(self, expected: Population) -> tuple[Intrinsics, Cover]:
        """Return the expected numbers and glass of the next camera, as a session declares them."""
        count = len(self.names)
        plain = {
            name: Number(number.value)
            for name, number in numbers_of(self.intrinsics, self.cover).items()
        }
        numbers = expected.mean[:count], expected.covariance[:count, :count]
        intrinsics, cover = replace_covariance(
            *replace_numbers(self.intrinsics, self.cover, plain), self.names, *numbers
        )
        with_numbers_covariance = expected.covariance[count:, :count]
        glass = Glass(
            self.low,
            self.high,
            self.degree,
            expected.mean[count:],
            expected.covariance[count:, count:],
            self.names,
            with_numbers_covariance,
        )
        return intrinsics, replace(cover, glass=glass)

    def _to_figure(self, relief: Relief) -> Array:
        """Return (N, amplitudes): the linear map from a relief's amplitudes to the nearest figure
        over the patch.
        """
        points = Relief(self.low, self.high, (LATTICE, LATTICE))
        first = self._bells(relief, 0)
        second = self._bells(relief, 1)
        return np.asarray(
            np.linalg.lstsq(
                figure_heights(points, self.low, self.high, self.degree),
                np.kron(first, second),
                rcond=None,
            )[0]
        )

    def _bells(self, relief: Relief, axis: int) -> Array:
        """Return a relief's basis functions along one side of the patch, (LATTICE, functions)."""
        points = torch.linspace(self.low[axis], self.high[axis], LATTICE, dtype=torch.float64)
        return np.asarray(relief.gaussians(points, axis)[0].T.numpy())

    def _prior(self, calibration: Calibration, to_figure: Array) -> tuple[Array, Array]:
        """Return the mean, (K + N,), and covariance, (K + N, K + N), of the prior that a camera's
        fit took from its drawing and from the prior of all glass.
        """
        joint = calibration.outcome.joint
        assert calibration.relief
        assert joint
        assert joint.relief_prior
        intrinsics, cover = calibration.declared.intrinsics, calibration.declared.cover
        declared, drawing = numbers_of(intrinsics, cover), numbers_of(self.intrinsics, self.cover)
        for name in calibration.declared.doubted:
            intrinsics, cover = widen_prior(intrinsics, cover, name, PRIOR_INFLATION)
        for name in self.names:
            if declared[name] != drawing[name]:  # a measurement of this camera, which stays
                intrinsics, cover = widen_prior(intrinsics, cover, name, LOOSE)
        heights = joint.relief_prior.covariance(calibration.relief)
        from_heights = np.linalg.solve(relief_basis(calibration.relief).T, to_figure.T).T
        count = len(self.names)
        prior = np.zeros((count + len(to_figure),) * 2)
        prior[:count, :count] = covariance_of(intrinsics, cover, self.names)
        prior[count:, count:] = from_heights @ heights @ from_heights.T
        return (
            np.array([*(declared[name].value for name in self.names), *np.zeros(len(to_figure))]),
            prior,
        )


def drawing(calibrations: Sequence[Calibration]) -> tuple[Intrinsics, Cover]:
    """Return the numbers that most sessions declare, with their tolerances. A number without a
    majority, such as one that was measured on each camera, has the median and the tolerance of its
    kind.
    """
    first = calibrations[0].declared
    declared: list[Mapping[str, Number]] = [
        numbers_of(calibration.declared.intrinsics, calibration.declared.cover)
        for calibration in calibrations
    ]
    common: dict[str, Number] = {}
    measured: dict[str, Number] = {}
    for name in declared[0]:
        number, times = Counter(numbers[name] for numbers in declared).most_common(1)[0]
        if 2 * times > len(declared):
            common[name] = number
        else:
            median = float(np.median([numbers[name].value for numbers in declared]))
            measured[name] = Number(median)
    by_kind = numbers_of(
        *free_parameters(*replace_numbers(first.intrinsics, first.cover, common | measured), (ALL,))
    )
    return replace_numbers(
        first.intrinsics, first.cover, common | {name: by_kind[name] for name in measured}
    )
