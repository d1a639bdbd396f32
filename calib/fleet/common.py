"""What cameras of one make have in common: their numbers and the figure of their glass, as one
vector, and what each camera says of it.
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
from calib.estimation.surface_prior import Smoothness, figure_height, figure_heights, relief_basis
from calib.fleet.population import Population
from calib.optics.build import covered_path, footprint
from calib.optics.relief import Relief
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.freeing import ALL, free_parameters
from calib.session.glass import Glass, polynomial_degrees
from calib.session.numbers import covariance_of, numbers_of, replace_covariance, replace_numbers
from calib.session.schema import Number

Array = NDArray[np.float64]
Corner = tuple[float, float]

LOOSE = 1e3
"""Times its tolerance: as good as no prior at all."""
DEGREE = 6
"""Of the figure that is learnt, where the reliefs are not coarser; what is finer is texture, by
which covers differ.
"""
LATTICE = 24
"""Points along each side of the patch at which a figure is compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Common:
    """The vector: K numbers, in SI units and px, then the N coefficients of the figure, in m."""

    names: tuple[str, ...]
    """Of the numbers."""
    intrinsics: Intrinsics
    """What the fleet's sessions declare, each number with its tolerance, and the `cover`."""
    cover: Cover
    low: Corner
    """Of the patch over which the figure is told, and `high`."""
    high: Corner
    degree: int
    """Of the figure."""

    @staticmethod
    def of(names: tuple[str, ...], camera: Camera, found: Sequence[Calibration]) -> Common:
        """Args: found: calibrations of one kind, each with a relief; `names`: the numbers that all
        estimated.
        """
        intrinsics, cover = drawing(found)
        low, high = footprint(*covered_path(intrinsics, cover), camera.width, camera.height)
        coarsest = min(min(one.relief.grid) for one in found if one.relief)
        return Common(names, intrinsics, cover, low, high, min(DEGREE, coarsest - 1))

    @property
    def centre(self) -> Array:
        """(K + N,) what is declared."""
        drawing = numbers_of(self.intrinsics, self.cover)
        return np.array(
            [
                *(drawing[name].value for name in self.names),
                *np.zeros(len(polynomial_degrees(self.degree))),
            ]
        )

    @property
    def axes(self) -> Array:
        """(K + N, K + N) in whose columns cameras differ independently, as long as their
        tolerances: each number by itself, but the focal lengths of x and y together and against
        each other, for one lens makes both.
        """
        drawing = numbers_of(self.intrinsics, self.cover)
        axes = np.diag(
            [
                *(drawing[name].sigma for name in self.names),
                *(figure_height(i + k) for i, k in polynomial_degrees(self.degree)),
            ]
        )
        if {"camera.fx", "camera.fy"} <= {*self.names}:
            both = [self.names.index("camera.fx"), self.names.index("camera.fy")]
            axes[np.ix_(both, both)] = (
                axes[np.ix_(both, both)] @ np.array([[1, 1], [1, -1]]) / np.sqrt(2)
            )
        return axes

    def told(self, one: Calibration) -> LikelihoodInformation:
        """What a camera's views say, and its own measurements: its calibration, less what the
        drawing had put in.
        """
        assert one.relief
        assert one.camera.intrinsics
        to_figure = self._to_figure(one.relief)
        parameters = one.camera_model().parameters
        count = parameters.amplitudes
        places = parameters.entries(self.names)
        own = np.zeros((len(self.names) + len(to_figure), parameters.count))
        own[: len(self.names), places] = np.diag(parameters.scales.numpy()[places - count])
        own[len(self.names) :, :count] = to_figure
        estimate = numbers_of(one.camera.intrinsics, one.cover)
        mean = np.array(
            [*(estimate[name].value for name in self.names), *to_figure @ one.amplitudes.ravel()]
        )
        stated, prior = self._prior(one, to_figure)
        return LikelihoodInformation.between(mean, own @ one.covariance @ own.T, stated, prior)

    def described(self, known: Population) -> tuple[Intrinsics, Cover]:
        """What is expected of the next camera, in the words of a session."""
        count = len(self.names)
        plain = {
            name: Number(number.value)
            for name, number in numbers_of(self.intrinsics, self.cover).items()
        }
        numbers = known.mean[:count], known.covariance[:count, :count]
        intrinsics, cover = replace_covariance(
            *replace_numbers(self.intrinsics, self.cover, plain), self.names, *numbers
        )
        beside = known.covariance[count:, :count]
        glass = Glass(
            self.low,
            self.high,
            self.degree,
            known.mean[count:],
            known.covariance[count:, count:],
            self.names,
            beside,
        )
        return intrinsics, replace(cover, glass=glass)

    def _to_figure(self, relief: Relief) -> Array:
        """(N, amplitudes): the figure over the patch that comes nearest to a relief."""
        points = Relief(self.low, self.high, (LATTICE, LATTICE))
        first, second = (
            relief.gaussians(torch.linspace(low, high, LATTICE, dtype=torch.float64), axis)[
                0
            ].T.numpy()
            for axis, (low, high) in enumerate(zip(self.low, self.high, strict=True))
        )
        return np.asarray(
            np.linalg.lstsq(
                figure_heights(points, self.low, self.high, self.degree),
                np.kron(first, second),
                rcond=None,
            )[0]
        )

    def _prior(self, one: Calibration, to_figure: Array) -> tuple[Array, Array]:
        """(K + N,) and (K + N, K + N): what a camera's fit took from its drawing, and from what
        holds for any glass.
        """
        assert one.relief
        intrinsics, cover = one.declared.intrinsics, one.declared.cover
        declared, drawing = numbers_of(intrinsics, cover), numbers_of(self.intrinsics, self.cover)
        for name in one.declared.doubted:
            intrinsics, cover = widen_prior(intrinsics, cover, name, PRIOR_INFLATION)
        for name in self.names:
            if declared[name] != drawing[name]:  # a measurement of this camera, which stays
                intrinsics, cover = widen_prior(intrinsics, cover, name, LOOSE)
        said = one.settings["relief_prior"]
        heights = Smoothness(said["height_m"], said["length_of_patch"]).covariance(one.relief)
        from_heights = np.linalg.solve(relief_basis(one.relief).T, to_figure.T).T
        count = len(self.names)
        prior = np.zeros((count + len(to_figure),) * 2)
        prior[:count, :count] = covariance_of(intrinsics, cover, self.names)
        prior[count:, count:] = from_heights @ heights @ from_heights.T
        return (
            np.array([*(declared[name].value for name in self.names), *np.zeros(len(to_figure))]),
            prior,
        )


def drawing(found: Sequence[Calibration]) -> tuple[Intrinsics, Cover]:
    """What most sessions declare, each number with its tolerance; where they differ, as measured
    numbers do, their median, by the tolerance of its kind.
    """
    first = found[0].declared
    said: list[Mapping[str, Number]] = [
        numbers_of(one.declared.intrinsics, one.declared.cover) for one in found
    ]
    common: dict[str, Number] = {}
    measured: dict[str, Number] = {}
    for name in said[0]:
        number, times = Counter(one[name] for one in said).most_common(1)[0]
        if 2 * times > len(said):
            common[name] = number
        else:
            measured[name] = Number(float(np.median([one[name].value for one in said])))
    by_kind = numbers_of(
        *free_parameters(*replace_numbers(first.intrinsics, first.cover, common | measured), (ALL,))
    )
    return replace_numbers(
        first.intrinsics, first.cover, common | {name: by_kind[name] for name in measured}
    )
