"""Every effect in every form that it takes: behind each cover of tests.optics.shapes, off-centre
and under water, behind a laminated window in front of a dome, and without a cover.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from torch import Tensor

from calib.calibration import Calibration
from calib.calibration_content import AddedEffect, Stage
from calib.corners.view import View
from calib.effects.effect import Effect, EffectContext, PlaceOnGlass
from calib.effects.registry import KINDS, OF_VIEW
from calib.effects.screen_glass import ScreenGlass
from calib.effects.varying import (
    ALTERNATING,
    FOCAL_LENGTH,
    FROM_VIEW,
    RADIAL_CHANGE,
    WITH_TIME,
    Varying,
)
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.priors import NONE
from calib.optics.build import covered_path, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.optics.view_blocks import CENTRE, FLEX
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.schema import Number
from fixtures.known import NOTHING
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH
from tests.optics.shapes import DOME, EXAMPLES, FLAT

BOARD = Board(5, 4, 0.03)
GRID = (5, 6)
LENS = Intrinsics(
    Number(2558.36),
    Number(2571.0),
    Number(1666.03),
    Number(1273.65),
    tuple(map(Number, (-0.1, 0.05, 1e-3, -2e-3, 0.01))),
)
TIMES = (0.0, 1.0, 5.0, 6.0)
"""s, of the views."""


@dataclass(frozen=True)
class Situation:
    """A camera, perhaps behind a cover whose outer surface is uneven, and what it saw."""

    cover: Cover
    intrinsics: Intrinsics
    relief: Relief | None
    amplitudes: np.ndarray
    views: tuple[View, ...]
    poses: Tensor
    """(V, 6)"""

    @property
    def path(self) -> Path:
        path, _ = covered_path(self.intrinsics, self.cover)
        return with_relief(path, self.relief) if self.relief else path

    @property
    def values(self) -> dict[str, Tensor]:
        _, values = covered_path(self.intrinsics, self.cover)
        return values | (
            {"relief.amplitudes": torch.from_numpy(self.amplitudes)} if self.relief else {}
        )

    @property
    def observations(self) -> Observations:
        return Observations.of(self.views, BOARD).add_times(TIMES, HEIGHT)

    @property
    def model(self) -> CameraModel:
        return CameraModel(self.path, self.values, NONE)

    def surroundings(self, estimated: Sequence[str] = (), placed: bool = True) -> EffectContext:
        place: PlaceOnGlass | None = None
        if self.relief:
            first, second = np.add(self.relief.low, self.relief.high) / 2
            place = PlaceOnGlass((float(first), float(second)), (1.0, 0.04), 5e-3)
        return EffectContext(
            BOARD,
            WIDTH,
            HEIGHT,
            self.path,
            self.values,
            frozenset(estimated),
            None,
            place if placed else None,
        )

    def calibration(
        self, effects: Sequence[AddedEffect] = (), poses: Tensor | None = None
    ) -> Calibration:
        return Calibration(
            board=BOARD,
            camera=Camera(WIDTH, HEIGHT, intrinsics=self.intrinsics),
            cover=self.cover,
            relief=self.relief,
            amplitudes=self.amplitudes,
            exact_hit=True,
            views=self.views,
            poses=(self.poses if poses is None else poses).numpy(),
            covariance=NOTHING,
            rejected=(),
            stages=(Stage("pinhole", 1.0, 0.1),),
            noise_px=0.1,
            gauge="",
            effects=tuple(effects),
        )


def situation(cover: Cover, intrinsics: Intrinsics, relief: Relief | None) -> Situation:
    rng = np.random.default_rng(4)
    amplitudes = rng.normal(0, 2e-5, GRID) if relief else NOTHING
    depth = rng.uniform(0.5, 1.0, len(TIMES))
    sideways = rng.uniform(-0.4, 0.4, (2, len(TIMES))) * depth
    poses = torch.from_numpy(
        np.column_stack([*rng.uniform(-0.6, 0.6, (3, len(TIMES))), *sideways, depth])
    )
    path, values = covered_path(intrinsics, cover)
    views = []
    for view, pose in enumerate(poses):
        # Beside the corners, where the waves of a free field have no nodes in common.
        points = torch.from_numpy(BOARD.points() + rng.uniform(-0.01, 0.01, (BOARD.count, 2)))
        pixels = path.lens.project(path.place(points, values, pose, MIDDLE), values)
        views.append(View(f"{view:04d}.png", pixels.numpy(), np.ones(BOARD.count), TIMES[view]))
    return Situation(cover, intrinsics, relief, amplitudes, tuple(views), poses)


LAMINATED = Cover(
    "flat",
    {
        **FLAT.changed(FLAT.moved).parameters,
        "distance": Number(0.05),
        "layer2.thickness": Number(0.00076),
        "layer2.refractive_index": Number(1.48),
    },
)
"""A window of two layers, tilted and under water."""
SITUATIONS = (
    situation(Cover("none", {}), LENS, None),
    *(
        situation(example.changed(example.moved), INTRINSICS, Relief(*example.patch, GRID))
        for example in EXAMPLES
    ),
    situation(
        replace(DOME.cover, outer=LAMINATED),
        INTRINSICS,
        Relief((-0.03, -0.04), (0.03, 0.04), GRID),
    ),
)


@dataclass(frozen=True)
class Form:
    """One effect in one situation."""

    effect: Effect
    situation: Situation

    @property
    def model(self) -> CameraModel:
        return self.situation.model.with_effect(self.effect)

    def present(self) -> tuple[dict[str, Tensor], Tensor]:
        """Numbers with which it is there, and the (V, B) numbers of the views."""
        rng = np.random.default_rng(5)
        values = dict(self.model.means)
        for unknown in self.effect.effect_parameters:
            error = rng.uniform(0.3, 0.6, unknown.param.shape) * rng.choice(
                [-1.0, 1.0], unknown.param.shape
            )
            values[unknown.param.name] = values[
                unknown.param.name
            ] + unknown.param.scale * torch.from_numpy(np.asarray(error))
        poses = self.model.pad_poses(self.situation.poses)
        size = {FLEX: 3e-4, CENTRE: 5.0}.get(self.effect.per_view, 0.01)
        block_values = torch.from_numpy(rng.uniform(-size, size, (len(poses), poses.shape[1] - 6)))
        return values, torch.cat([poses[:, :6], block_values], 1)

    def __str__(self) -> str:
        choice = str(getattr(self.effect, "behind", getattr(self.effect, "over", "")))
        words = (self.effect.name, self.effect.varies, self.situation.cover.shape, choice)
        return "-".join(filter(None, words))


def varying(situation: Situation) -> Iterator[Varying]:
    """Yield effects whose numbers follow a pattern over the views."""
    yield Varying("focal", WITH_TIME, (FOCAL_LENGTH,), (-1.0, -0.5, 0.5, 1.0))
    yield Varying("lens", ALTERNATING, (FOCAL_LENGTH, RADIAL_CHANGE), (-1.0, 1.0, -1.0, 1.0))
    if situation.path.cover:
        numbers = [
            name for name in situation.values if "tilt" in name or name.endswith("thickness")
        ]
        yield Varying("cover_tilt", FROM_VIEW, tuple(numbers), (-1.0, -1.0, 0.0, 0.0))


FORMS = (
    *(
        Form(effect, situation)
        for kind in (*KINDS, *OF_VIEW)
        for situation in SITUATIONS
        for effect in kind.propose(situation.surroundings())
    ),
    *(Form(effect, situation) for situation in SITUATIONS for effect in varying(situation)),
    *(Form(ScreenGlass(), situation) for situation in SITUATIONS),
)

each_form = pytest.mark.parametrize("form", FORMS, ids=str)
