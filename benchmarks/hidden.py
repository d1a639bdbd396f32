"""Synthetic sessions with an effect of a known size that nobody declares, for
`benchmarks.diagnosis`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration import Calibration
from calib.corners.view import View
from calib.effects.effect import Effect, EffectContext, EffectParameter, PlaceOnGlass
from calib.effects.entrance_pupil import EntrancePupil
from calib.effects.fine_surface import CENTRES, FineSurface
from calib.effects.flat_port import WALL_THICKNESS, FlatPort
from calib.estimation.poses import refit_poses
from calib.estimation.residuals import residuals
from calib.fit_record.request import Settings
from calib.optics.board_polynomials import bend_sigma
from calib.optics.exposure import MIDDLE
from calib.optics.flex_bend import FLEX_TERMS
from calib.optics.projection import project
from calib.optics.view_blocks import FLEX, MOTION
from calib.session.cover import Cover
from fixtures.calibrated import GLASS, calibrate
from fixtures.synthetic import HEIGHT, WIDTH, Scene, scene

Array = NDArray[np.float64]

NOISE = 0.1
"""px per axis"""
SMALL = {"m": 1e-5, "rad": 1e-4, "px": 0.01, "": 1e-4}
"""The start of the search for the smallest size."""
THICKEST = 0.02
"""m, of a window in air."""
FARTHEST = 5.0
"""Standard deviations of what may well be: no entrance pupil moves farther."""
DRAWN = {MOTION: [1e-4] * 3 + [1e-5] * 3, FLEX: [bend_sigma(1e-5, term) for term in FLEX_TERMS]}
"""rad and m: the same for a board that moves."""


@dataclass(frozen=True, slots=True, eq=False)
class Hidden:
    """One scene and one effect, of which a size of 1 moves some corner by the noise, poses
    refitted.
    """

    made: Scene
    effect: Effect
    direction: dict[str, Tensor]
    own: Tensor
    """(V, 6)"""
    seed: int
    """The seed of the noise."""

    @classmethod
    def drawn(cls, kind: type[Effect], seed: int, views: int) -> Self | None:
        """An effect in a random direction of its parameters, at a random place.

        None: it cannot be seen here.
        """
        rng = np.random.default_rng(seed)
        made = (
            bare(seed, views)
            if kind in (FlatPort, EntrancePupil)
            else scene(1000 + seed, views, (4, 4), 1e-5, 0.0, cover=GLASS)
        )
        outer = made.path.cover[-1] if made.path.cover else None
        place = None
        if outer and outer.relief:
            low = np.array(outer.relief.low)
            high = np.array(outer.relief.high)
            first, second = rng.uniform(low + 0.35 * (high - low), high - 0.35 * (high - low))
            place = PlaceOnGlass((first, second), (1.0, 0.04), 1e-3)
        forms = kind.propose(
            EffectContext(made.board, WIDTH, HEIGHT, made.path, made.values, place=place)
        )
        if not forms:
            return None
        spread = DRAWN.get(forms[0].per_view, ())
        blocks = torch.from_numpy(rng.normal(0, spread, (views, len(spread))))
        return cls(made, forms[0], direction(forms[0], rng), blocks, seed).scaled()

    @classmethod
    def under_water(cls, seed: int, views: int) -> Self:
        """A port in water, which has no size: it is there or not."""
        port = FlatPort("water")
        hidden_values = {
            u.param.name: torch.tensor(u.initial - u.neutral, dtype=torch.float64)
            for u in port.effect_parameters
        }
        return cls(
            bare(seed, views), port, hidden_values, torch.zeros(views, 0, dtype=torch.float64), seed
        )

    def possible(self, size: float) -> bool:
        """Whether there is such a thing, and every corner is still seen."""
        if (
            isinstance(self.effect, FlatPort)
            and size * float(self.direction["flat_port.thickness"]) > THICKEST
        ):
            return False
        if isinstance(self.effect, EntrancePupil):
            spread = {u.param.name: u.sigma for u in self.effect.effect_parameters}
            if (
                max(size * abs(float(step)) / spread[name] for name, step in self.direction.items())
                > FARTHEST
            ):
                return False
        return all(np.isfinite(view.corners).all() for view in self.session(size).views)

    def scaled(self) -> Self:
        size = 1.0
        for _ in range(4):
            size *= NOISE / float(np.linalg.norm(self.shift(size), axis=-1).max())
        return replace(
            self,
            direction={name: size * step for name, step in self.direction.items()},
            own=size * self.own,
        )

    def session(self, size: float, noise: float = NOISE) -> Scene:
        """The scene with its corners where the effect puts them.

        They are NaN where it puts them out of sight.
        """
        path = self.effect.apply(self.made.path)
        moved = {
            u.param.name: u.neutral + size * self.direction.get(u.param.name, torch.zeros(()))
            for u in self.effect.effect_parameters
        }
        values = {**self.made.values, **moved}
        poses = torch.cat([self.made.poses, size * self.own], 1)
        observations = self.made.observations.add_times(
            [float(i) for i in range(len(self.made.views))], HEIGHT
        )
        placed = path.place(
            observations.corners, values, poses[observations.view], observations.exposure
        )
        pixels = project(
            path, values, placed, observations.exposure, start=observations.pixels
        ).numpy()
        return with_corners(self.made, self.noisy(pixels, noise))

    def shift(self, size: float) -> Array:
        """(M, 2) px by which corners are moved, poses refitted to the true path."""
        moved = self.session(size, noise=0.0).observations
        return refit_poses(self.made.path, self.made.values, moved, self.made.poses)[
            1
        ].image.numpy()

    def noisy(self, pixels: Array, sigma: float) -> Array:
        """(M, 2) px with noise that is the same for every size."""
        return np.asarray(pixels + np.random.default_rng(self.seed).normal(0, sigma, pixels.shape))

    def absorbed(self, size: float, fit: Calibration) -> float:
        """The part of the shift's sum of squares that the fit takes up: what is left of it with the
        very same noise is compared.
        """
        pixels = self.made.observations.pixels.numpy()
        difference = left_by(fit) - left_by(
            calibrate(with_corners(self.made, self.noisy(pixels, NOISE)), Settings())
        )
        return 1.0 - float((difference**2).sum() / (self.shift(size) ** 2).sum())


def direction(effect: Effect, rng: np.random.Generator) -> dict[str, Tensor]:
    """Return a random direction: the differences of the parameters from neutral, in proportion to
    plausible sizes.
    """
    match effect:
        case FlatPort():
            return {"flat_port.thickness": torch.tensor(WALL_THICKNESS / 100, dtype=torch.float64)}
        case FineSurface():  # random heights are mostly smooth, and a relief takes them up
            bump = torch.zeros(CENTRES, dtype=torch.float64)
            bump[CENTRES[0] // 2, CENTRES[1] // 2] = SMALL["m"]
            return {"fine_surface.amplitudes": bump}
    widest = {
        u.param.unit: max(
            float(np.max(v.sigma)) for v in effect.effect_parameters if v.param.unit == u.param.unit
        )
        for u in effect.effect_parameters
    }

    def drawn(u: EffectParameter) -> Tensor:
        return torch.from_numpy(
            np.asarray(
                rng.normal(size=u.param.shape)
                * SMALL[u.param.unit]
                * u.sigma
                / widest[u.param.unit]
            )
        )

    return {u.param.name: drawn(u) for u in effect.effect_parameters}


def bare(seed: int, views: int) -> Scene:
    """The same boards without a cover."""
    covered = scene(1000 + seed, views, (4, 4), 1e-5, 0.0, cover=GLASS)
    path = replace(covered.path, cover=())
    values = {name: value for name, value in covered.values.items() if name.startswith("camera.")}
    observations = covered.observations
    pixels = project(
        path,
        values,
        path.place(observations.corners, values, covered.poses[observations.view], MIDDLE),
        MIDDLE,
        start=observations.pixels,
    ).numpy()
    return with_corners(replace(covered, cover=Cover("none", {}), path=path, values=values), pixels)


def with_corners(made: Scene, pixels: Array) -> Scene:
    """The scene with other (M, 2) px."""
    per_view = pixels.reshape(len(made.views), made.board.count, 2)
    return replace(
        made,
        views=tuple(
            View(view.name, row, view.weight)
            for view, row in zip(made.views, per_view, strict=True)
        ),
    )


def left_by(fit: Calibration) -> Array:
    """(M, 2) px that a calibration leaves."""
    path, values = fit.model()
    return residuals(path, values, fit.observations, torch.from_numpy(fit.poses)).image.numpy()
