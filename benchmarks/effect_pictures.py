"""The pictures of docs/effects: what each effect leaves of a session's corners when a model without
it may only move the boards.

`python -m benchmarks.effect_pictures [NAME...]` draws them and prints the sizes; `--alike` prints
which effects imitate which.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from calib.corners.view import View
from calib.effects.effect import Effect, EffectContext, PlaceOnGlass
from calib.effects.registry import FIELDS, KINDS
from calib.effects.screen_glass import ScreenGlass
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.poses import refit_poses
from calib.estimation.priors import NONE, Priors
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import tuned_score_tests
from calib.optics.board_polynomials import bend_sigma
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.exposure import MIDDLE, Exposure
from calib.optics.flex_bend import FLEX_TERMS
from calib.optics.projection import project
from calib.optics.relief import Relief
from calib.optics.view_blocks import FLEX, MOTION
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.schema import Number

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

Array = NDArray[np.float64]

WIDTH, HEIGHT = 1640, 1232
CAMERA = Intrinsics(Number(1279.18), Number(1279.18), Number(832.765), Number(636.575))
BOARD = Board(9, 9, 0.02)
VIEWS = 20
DEPTHS = (0.25, 0.9)
"""m"""
CONE = Cover(
    "cone",
    {
        name: Number(value)
        for name, value in {
            "inner_radius": 0.04195,
            "radius_slope": -0.105,
            "axis_offset.x": 0.0,
            "axis_offset.z": -0.030,
            "tilt.x": 0.0,
            "tilt.z": 0.0,
            "thickness": 0.003,
            "refractive_index": 1.5,
            "outside_index": 1.0,
        }.items()
    },
)
BARE = Cover("none", {})
GRID = (8, 8)
FOLDER = Path("docs/effects")
SHOWN = 6
"""Views whose own arrows are drawn."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


@dataclass(frozen=True)
class Example:
    """An effect at a size that is drawn."""

    name: str
    cover: Cover
    parameters: dict[str, float]
    """The values by name; for reliefs and fields, the standard deviation of random ones."""
    panels: tuple[str, str]
    """The names of the panels, from PANELS."""
    choice: str = ""
    """The name of the effect's form; empty for the only one."""
    farther: float = 1.0
    """The boards' distance, over the others': water magnifies."""


EXAMPLES = (
    Example("lens", BARE, {"k1": 3e-3}, ("views", "image")),
    Example("entrance_pupil", BARE, {"e2": 3e-3, "e4": 0.0}, ("views", "image")),
    Example("principal_point", BARE, {"x": 5.0, "y": 0.0}, ("views", "image")),
    Example("focal", BARE, {"change": 5e-3}, ("views", "image")),
    Example("rolling_shutter", BARE, {}, ("views", "row")),
    Example(
        "flat_port",
        BARE,
        {"distance": 0.025, "thickness": 6e-3, "outside_index": 1.333},
        ("views", "image"),
        "water",
        1.4,
    ),
    Example("cover_tilt", CONE, {"x": 0.02, "z": 0.0}, ("views", "image")),
    Example(
        "cover_offset", CONE, {"axis_offset.x": 1e-3, "axis_offset.z": 0.0}, ("views", "image")
    ),
    Example("cover_radius", CONE, {"inner_radius": 1e-3}, ("views", "image")),
    Example("thickness", CONE, {"thickness": 5e-4}, ("views", "image")),
    Example("refractive_index", CONE, {"refractive_index": 0.02}, ("views", "image")),
    Example("wedge", CONE, {"x": 0.0, "z": 3e-3}, ("views", "image")),
    Example("inner_surface", CONE, {"amplitudes": 1e-5}, ("views", "image")),
    Example("fine_surface", CONE, {"amplitudes": 2e-6}, ("views", "image")),
    Example("board_shape", BARE, {"xx": 1e-3, "xy": 3e-4, "yy": -5e-4}, ("views", "board")),
    Example("board_flex", BARE, {}, ("views", "board")),
    Example("board_scale", BARE, {"x_over_y": 2e-3}, ("views", "board")),
    Example("screen_glass", BARE, {"thickness": 2e-3}, ("views", "board")),
    Example("detector_bias", BARE, {"x": 0.05, "y": 0.05}, ("views", "phase")),
    Example("free_field", BARE, {"board.x": 1e-4, "board.y": 1e-4}, ("views", "board")),
    Example("lens_field", BARE, {"x": 0.1, "y": 0.1}, ("views", "image")),
)
DRAWN = {
    MOTION: (0.02, 0.02, 0.02, 2e-3, 2e-3, 2e-3),
    FLEX: tuple(bend_sigma(3e-4, term) for term in FLEX_TERMS),
}
"""Rad and m during one readout, and m of bending: the standard deviation over views."""


def main() -> None:
    torch.set_num_threads(1)
    if "--alike" in sys.argv:
        _print_alike()
        return
    names = sys.argv[1:]
    for example in EXAMPLES:
        if not names or example.name in names:
            remaining = Left.of(example)
            _draw(example, remaining)
            size = (FOLDER / f"{example.name}.png").stat().st_size
            print(
                f"{example.name:18} leaves {remaining.rms:7.4f} px RMS "
                f" picture {size / 1e3:.0f} kB",
                flush=True,
            )


def base(cover: Cover) -> CameraModel:
    """The model without effects; behind a cover with a relief, which is even."""
    path, values = covered_path(CAMERA, cover)
    if cover.shape == "none":
        return CameraModel(path, values, NONE)
    path = with_relief(path, Relief(*footprint(path, values, WIDTH, HEIGHT), GRID))
    return CameraModel(
        path, values | {"relief.amplitudes": torch.zeros(GRID, dtype=torch.float64)}, NONE
    )


def proposed(kinds: tuple[type[Effect], ...], model: CameraModel) -> list[Effect]:
    """Every form of every effect that is possible; finer glass where the camera looks at left of
    the middle.
    """
    place = None
    if model.path.cover:
        outer = model.path.cover[-1]
        rays = model.path.trace(
            torch.tensor([[0.35 * WIDTH, 0.5 * HEIGHT]], dtype=torch.float64), model.means, MIDDLE
        )
        first, second = outer.surface.chart(outer.frame.at(model.means).enter(rays.origin))
        place = PlaceOnGlass((float(first), float(second)), (1.0, 0.04), 1e-3)
    context = EffectContext(BOARD, WIDTH, HEIGHT, model.path, model.means, place=place)
    return [effect for kind in kinds for effect in kind.propose(context)]


def poses_of(model: CameraModel) -> Array:
    """(VIEWS, 6) with all corners in the image: six side by side, evenly among the others in the
    order of time.
    """
    rng = np.random.default_rng(11)
    points = torch.from_numpy(BOARD.points())
    poses: list[Array] = []
    tiles = dict(
        zip(np.linspace(0, VIEWS - 1, SHOWN).astype(int).tolist(), np.ndindex(3, 2), strict=True)
    )
    while len(poses) < VIEWS:
        depth = rng.uniform(*DEPTHS)
        sideways = rng.uniform(-1, 1, 2) * [0.62, 0.46] * depth
        if len(poses) in tiles:
            depth = rng.uniform(0.42, 0.5)
            sideways = (np.array(tiles[len(poses)]) - [1, 0.5]) * depth * [0.4, 0.43]
        turn = rng.uniform(0.25, 0.6, 2) * rng.choice([-1, 1], 2)
        pose = torch.from_numpy(
            np.concatenate([turn, rng.uniform(-0.3, 0.3, 1), sideways, [depth]])
        )
        pixels = project(
            model.path,
            model.means,
            model.path.place(points, model.means, pose.expand(BOARD.count, 6), MIDDLE),
            MIDDLE,
        )
        if bool(((pixels > 30) & (pixels < torch.tensor([WIDTH - 30, HEIGHT - 30]))).all()):
            poses.append(pose.numpy())
    return np.stack(poses)


def seen(model: CameraModel, values: dict[str, Tensor], poses: Array) -> Observations:
    """The corners of boards at (VIEWS, 6) poses, which move if the model has a shutter."""
    rng = np.random.default_rng(12)
    points = torch.from_numpy(BOARD.points())
    views = []
    for view, pose in enumerate(poses):
        parameters = torch.from_numpy(
            np.concatenate(
                [pose, *(rng.normal(0, DRAWN[block]) for block in model.path.view_blocks[1:])]
            )
        ).expand(BOARD.count, -1)
        time = torch.full((BOARD.count,), view / (VIEWS - 1) - 0.5, dtype=torch.float64)
        pixels = torch.full((BOARD.count, 2), HEIGHT / 2, dtype=torch.float64)
        # A corner's row says when it was read, and its ray where glass lets it appear.
        glass = model.path.target.glass
        for step in range(8 if model.path.shutter or glass else 1):
            exposure = Exposure(time, line=(pixels[:, 1] + 0.5) / HEIGHT - 0.5)
            rays = model.path.trace(pixels, values, exposure) if glass and step else None
            placed = model.path.place(points, values, parameters, exposure, rays)
            pixels = project(model.path, values, placed, exposure)
        views.append(View(f"{view:04d}.png", pixels.numpy(), np.ones(BOARD.count)))
    return Observations.of(views, BOARD).add_times(range(VIEWS), HEIGHT)


@dataclass(frozen=True)
class Left:
    """The residual of the corners when only poses are fitted, without the effect."""

    observations: Observations
    errors: Array
    """(M, 2) px, seen minus model."""

    @property
    def rms(self) -> float:
        return float(np.sqrt((self.errors**2).sum(1).mean()))

    @staticmethod
    def of(example: Example) -> Left:
        without = base(example.cover)
        effect = next(
            e
            for e in (*proposed(KINDS, without), ScreenGlass())
            if e.name == example.name and example.choice in _choices(e)
        )
        true = without.with_effect(effect)
        rng = np.random.default_rng(3)
        values = dict(true.means)
        for unknown in effect.effect_parameters:
            size = example.parameters.get(unknown.param.name.removeprefix(f"{effect.name}."))
            if size is not None:
                drawn = rng.normal(0, size, unknown.param.shape) if unknown.param.shape else size
                values[unknown.param.name] = torch.as_tensor(drawn, dtype=torch.float64)
        poses = poses_of(without)
        poses[:, 5] *= example.farther
        observations = seen(true, values, poses)
        _, residual = refit_poses(
            without.path, without.means, observations, torch.from_numpy(poses)
        )
        return Left(observations, -residual.image.numpy())


def _choices(effect: Effect) -> tuple[str, ...]:
    return "", effect.form


def _draw(example: Example, remaining: Left) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.4), layout="constrained")
    for panel, kind in zip(axes, example.panels, strict=True):
        PANELS[kind](panel, remaining)
        panel.tick_params(labelsize=7)
        panel.xaxis.label.set_fontsize(8)
        panel.yaxis.label.set_fontsize(8)
    drawn = BytesIO()
    figure.savefig(drawn, dpi=84)
    plt.close(figure)
    Image.open(drawn).convert("RGB").quantize(64).save(
        FOLDER / f"{example.name}.png", optimize=True
    )


def _views(panel: Axes, remaining: Left) -> None:
    """The arrows of some views."""
    pixels, view = remaining.observations.pixels.numpy(), remaining.observations.view.numpy()
    shown = np.linspace(0, VIEWS - 1, SHOWN).astype(int)
    in_shown = np.isin(view, shown)
    scale = _magnified(remaining.errors[in_shown], 60.0)
    for colour, number in zip(COLOURS, shown, strict=True):
        in_view = view == number
        _arrows(panel, pixels[in_view], remaining.errors[in_view] * scale, colour)
    _picture(panel)
    _title(panel, f"{SHOWN} of {VIEWS} views, corners as seen less the model, x{scale:,.0f}")


def _image(panel: Axes, remaining: Left) -> None:
    """The mean over parts of the image."""
    pixels = remaining.observations.pixels.numpy()
    cell = np.floor(pixels / [WIDTH / 14, HEIGHT / 10]).astype(int) @ [100, 1]
    at, mean = _means(cell, pixels, remaining.errors, min_count=4)
    scale = _magnified(mean, 70.0)
    _arrows(panel, at, mean * scale, "#222222")
    _picture(panel)
    _title(panel, f"mean over the image, x{scale:,.0f}")


def _board(panel: Axes, remaining: Left) -> None:
    """The mean of each corner, turned back into the board's directions."""
    corners, errors = remaining.observations.corners.numpy(), remaining.errors.copy()
    for view_rows in remaining.observations.per_view(torch.arange(len(errors))):
        rows = view_rows.numpy()
        affine = np.column_stack([corners[rows], np.ones(len(rows))])
        jacobian, *_ = np.linalg.lstsq(
            affine, remaining.observations.pixels.numpy()[rows], rcond=None
        )
        errors[rows] = np.linalg.solve(jacobian[:2].T, errors[rows].T).T
    _, place = np.unique(corners.round(9), axis=0, return_inverse=True)
    at, mean = _means(place.ravel(), corners, errors, min_count=1)
    scale = _magnified(mean, 0.012)
    _arrows(panel, at * 1e3, mean * scale * 1e3, "#222222", width=0.004)
    panel.set(aspect="equal", xlim=(-100, 100), ylim=(100, -100), xlabel="mm")
    _title(panel, f"mean over views, on the board, x{scale:,.0f}")


def _row(panel: Axes, remaining: Left) -> None:
    """The horizontal error by row."""
    pixels, view = remaining.observations.pixels.numpy(), remaining.observations.view.numpy()
    for colour, number in zip(COLOURS, np.linspace(0, VIEWS - 1, SHOWN).astype(int), strict=True):
        in_view = view == number
        panel.plot(
            remaining.errors[in_view, 0], pixels[in_view, 1], ".", color=colour, markersize=2.5
        )
    panel.set(ylim=(HEIGHT, 0), ylabel="row, px", xlabel="error to the right, px")
    _title(panel, "by row, the same views")


def _phase(panel: Axes, remaining: Left) -> None:
    """The error to the right by the corner's place in its pixel."""
    x = remaining.observations.pixels.numpy()[:, 0]
    panel.plot(x - np.round(x), remaining.errors[:, 0], ".", color="#222222", markersize=2)
    panel.set(
        xlabel="corner's place in its pixel, px right of its middle",
        ylabel="error to the right, px",
    )
    _title(panel, "by sub-pixel phase")


PANELS = {
    "views": _views,
    "image": _image,
    "board": _board,
    "row": _row,
    "phase": _phase,
}


def _means(
    label: NDArray[np.int64], at: Array, errors: Array, min_count: int
) -> tuple[Array, Array]:
    """(K, 2) places and (K, 2) mean errors of the labels that occur often enough."""
    _, index, count = np.unique(label, return_inverse=True, return_counts=True)
    sums = [
        np.stack([np.bincount(index, array[:, axis]) for axis in range(2)], -1) / count[:, None]
        for array in (at, errors)
    ]
    return sums[0][count >= min_count], sums[1][count >= min_count]


def _magnified(errors: Array, longest: float) -> float:
    """A round factor with which a long arrow is as long as asked for."""
    exact = longest / np.quantile(np.linalg.norm(errors, axis=1), 0.95)
    step = 10.0 ** np.floor(np.log10(exact))
    return float(step * np.floor(exact / step))


def _arrows(panel: Axes, at: Array, shift: Array, colour: str, width: float = 0.0022) -> None:
    panel.quiver(
        *at.T,
        *shift.T,
        angles="xy",
        scale_units="xy",
        scale=1,
        color=colour,
        width=width,
        headwidth=4,
        headlength=4,
    )


def _title(panel: Axes, words: str) -> None:
    panel.set_title(words, fontsize=8.5)


def _picture(panel: Axes) -> None:
    panel.set(aspect="equal", xlim=(0, WIDTH), ylim=(HEIGHT, 0), xticks=[], yticks=[])


def _print_alike() -> None:
    """Print which effects are alike in clean sessions of 20 views with 0.1 px of noise."""
    for cover in (BARE, CONE):
        model = base(cover)
        if cover is BARE:  # as a fit whose intrinsics come from the same views
            model = replace(
                model,
                priors=Priors(
                    {"camera.fx": 60.0, "camera.fy": 60.0, "camera.cx": 100.0, "camera.cy": 100.0}
                ),
            )
        poses = poses_of(model)
        observations = seen(model, dict(model.means), poses)
        noise = torch.from_numpy(np.random.default_rng(1).normal(0, 0.1, observations.pixels.shape))
        observations = replace(observations, pixels=observations.pixels + noise)
        at = FittedModel(model, observations, model.fit(observations, torch.from_numpy(poses)))
        columns = tuned_score_tests(at, proposed(tuple(k for k in KINDS if k not in FIELDS), model))
        spans = {
            c.effect.name + _choices(c.effect)[1].join("()" * bool(_choices(c.effect)[1])): c
            for c in columns
            if c.jacobian.size
        }
        print(f"cover: {cover.shape}")
        for name, item in spans.items():
            alike = []
            for other_name, two in spans.items():
                if two.effect.name != item.effect.name:
                    cosines = np.linalg.svd(item.span().T @ two.span(), compute_uv=False)
                    alike.append((float(cosines[0] ** 2), other_name))
            best = ", ".join(
                f"{other_name} {size:.2f}" for size, other_name in sorted(alike, reverse=True)[:3]
            )
            print(f"  {name:22} absorbed {item.absorbed:.4f}  most alike: {best}")


if __name__ == "__main__":
    main()
