"""The benefit of following the guide: `python -m benchmarks.guidance [--seeds 20] [--first 2000]
[--bumps 4]`.

Each seed has its own glass (random bumps that nobody declared), camera noise of 0.1 px per axis,
and a person who holds a 9x9 board of 20 mm squares between 0.6 and 1.2 m: at random wherever the
gate agrees, or near where the guide asks, with 3 % of the depth of error sideways, 5 % in depth and
6 degrees in each angle (standard deviations; what the gate refuses is tried again). The guide knows
the nominal cover, is told of each view, and is computed anew after every fourth, so between these a
view counts as the pose of the bank next to it. A map's error is that of the undistorted position
over the middles of 9x12 cells of the whole picture at three depths, after the rigid motion of all
rays that fits best there.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.workers import add_workers, workers_of
from calib.corners.view import View
from calib.fitting.setup import Setup
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.planning.design import Design
from calib.planning.information import PlanningFit, estimate
from calib.planning.pose_bank import Reach, make_pose_bank
from calib.session.board import Board
from calib.session.camera import Camera
from calib.threads import single_thread
from capture.coverage import COVERAGE_CELLS, InformedGuide, KeptView, PlainGuide
from capture.gate import check_novelty
from capture.guidance import RELIEF_GRID
from capture.live_detection import LiveDetection
from fixtures.map_errors import motions, rays_of, seen_at
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, paper_cone, scene

Array = NDArray[np.float64]

GLASS = paper_cone(thickness=0.00115)
BOARD = Board(9, 9, 0.020)
CAMERA = Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS)
SETUP = Setup(BOARD, CAMERA, INTRINSICS, GLASS)
REACH = Reach(0.6, 1.2)
NOISE = 0.1  # px per axis
BORDER = 20.0  # px, nearer to which the gate refuses a corner
SIDEWAYS, DEPTH, ANGLE = 0.03, 0.05, np.radians(6)
AFRESH = 4  # views, after which the guide is computed anew
GUIDED, RANDOM = 12, 20  # views


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """Holds the board, wherever it is wanted, until the gate agrees."""

    truth: Scene
    rng: np.random.Generator
    views: list[View]

    def at_random(self) -> None:
        self._hold(self._anywhere)

    def near(self, pose: Array) -> None:
        depth = pose[5]
        error = np.array([ANGLE] * 3 + [SIDEWAYS * depth] * 2 + [DEPTH * depth])
        self._hold(lambda: pose + self.rng.normal(0, error))

    def _anywhere(self) -> Array:
        """Return a random pose, as in fixtures.synthetic."""
        depth = self.rng.uniform(REACH.near, REACH.far)
        sideways = self.rng.uniform(-1, 1, 2) * [0.62, 0.46] * depth
        return np.concatenate(
            [self.rng.uniform(-0.6, 0.6, 2), self.rng.uniform(-0.3, 0.3, 1), sideways, [depth]]
        )

    def _hold(self, draw: Callable[[], Array]) -> None:
        while True:
            points = self.truth.path.place(
                torch.from_numpy(BOARD.points()),
                self.truth.values,
                torch.from_numpy(draw()),
                MIDDLE,
            )
            corners = project(self.truth.path, self.truth.values, points, MIDDLE).numpy()
            if not np.all((corners >= BORDER) & (corners <= [WIDTH - BORDER, HEIGHT - BORDER])):
                continue
            corners = corners + self.rng.normal(0, NOISE, corners.shape)
            square = float(
                np.linalg.norm(np.diff(corners.reshape(9, 9, 2), axis=1), axis=-1).mean()
            )
            if (
                check_novelty(
                    LiveDetection(corners, WIDTH, HEIGHT, 0.0, square=square),
                    None,
                    [view.corners for view in self.views],
                )
                is None
            ):
                self.views.append(View(f"{len(self.views):04d}", corners, np.ones(BOARD.count)))
                return


def follow(person: Person, nominal: Design, count: int, interval: int) -> None:
    """Take views where the guide asks, or only every so-manieth of them; the others at random."""
    design = nominal
    for number in range(count):
        if number and number % AFRESH == 0:
            design = design_of(estimate(SETUP, person.views, RELIEF_GRID))
        if number % interval:
            person.at_random()
            continue
        hint = InformedGuide(BOARD, CAMERA, REACH, design).next_pose(seen(person.views))
        assert hint
        person.near(hint.pose)


def follow_plainly(person: Person, count: int) -> None:
    """The same with the plain rule."""
    guide = PlainGuide(BOARD, CAMERA, REACH)
    for _ in range(count):
        hint = guide.next_pose(seen(person.views))
        assert hint
        person.near(hint.pose)


def go_anywhere(person: Person, count: int) -> None:
    for _ in range(count):
        person.at_random()


def seen(views: Sequence[View]) -> list[KeptView]:
    return [KeptView(view.corners) for view in views]


def design_of(planning_fit: PlanningFit) -> Design:
    return planning_fit.design(
        SETUP, make_pose_bank(BOARD, CAMERA, REACH).poses, COVERAGE_CELLS, REACH.levels()
    )


def judged(person: Person) -> tuple[float, float]:
    """The error of the map that these views give, and what the guide predicts for it, px."""
    planning_fit = estimate(SETUP, person.views, RELIEF_GRID)
    design = design_of(planning_fit)
    rows, columns = COVERAGE_CELLS
    x = (np.arange(columns) + 0.5) / columns * WIDTH - 0.5
    y = (np.arange(rows) + 0.5) / rows * HEIGHT - 0.5
    pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    ours = rays_of(planning_fit.model.path, dict(planning_fit.model.means), pixels)
    true = rays_of(person.truth.path, dict(person.truth.values), pixels)
    at = [np.full(len(pixels), depth) for depth in REACH.levels()]
    error = np.concatenate(
        [(seen_at(*true, depth) - seen_at(*ours, depth)).ravel() for depth in at]
    )
    moved = np.concatenate([motions(*ours, depth) for depth in at])
    remainder = error - moved @ np.linalg.lstsq(moved, error, rcond=None)[0]
    return float(np.sqrt((remainder**2).mean() * 2)), design.sigma(design.precision())


Judged = dict[str, tuple[float, float]]


def ways_of(seed: int, bumps: int) -> Judged:
    """Return for each way of taking views the map's error, and the guide's prediction of it, px."""
    with single_thread():
        nominal = design_of(estimate(SETUP, (), RELIEF_GRID))
        methods: dict[str, Callable[[Person], None]] = {
            f"{GUIDED} views, guided": lambda person: follow(person, nominal, GUIDED, 1),
            f"{GUIDED} views, every second hint": lambda person: follow(person, nominal, GUIDED, 2),
            f"{GUIDED} views, plain rule": lambda person: follow_plainly(person, GUIDED),
            f"{GUIDED} views at random": lambda person: go_anywhere(person, GUIDED),
            f"{RANDOM} views at random": lambda person: go_anywhere(person, RANDOM),
        }
        truth = scene(seed, 1, (bumps, bumps), 1e-5, cover=GLASS)
        results: Judged = {}
        for method, (name, take) in enumerate(methods.items()):
            person = Person(truth, np.random.default_rng([seed, method]), [])
            take(person)
            results[name] = judged(person)
        return results


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=2000, help="the first seed")
    parser.add_argument(
        "--bumps",
        type=int,
        default=4,
        help="of the true glass, along each side of the paper's patch",
    )
    add_workers(parser)
    options = parser.parse_args()
    with workers_of(options) as pool:
        seeds = list(
            pool.each(
                ways_of,
                [
                    (seed, options.bumps)
                    for seed in range(options.first, options.first + options.seeds)
                ],
                "seeds",
            )
        )
        scaled = pool.scaled
    results = {name: [item[name] for item in seeds] for name in seeds[0]}
    table = Table(
        "",
        "map error, px: median",
        "10 % to 90 %",
        "predicted, median",
        "error / predicted, RMS",
        "median",
        "10 % to 90 %",
    )
    for name, pairs in results.items():
        error, sigma = np.array(pairs).T
        ratio = error / sigma
        spread = " to ".join(f"{v:.2f}" for v in np.quantile(error, (0.1, 0.9)))
        ratios = " to ".join(f"{v:.2f}" for v in np.quantile(ratio, (0.1, 0.9)))
        cells = (
            f"{np.median(error):.3f}",
            spread,
            f"{np.median(sigma):.3f}",
            f"{np.sqrt((error**2).mean() / (sigma**2).mean()):.2f}",
        )
        table.add_row(name, *cells, f"{np.median(ratio):.2f}", ratios)
    Console(width=150).print(table)
    print(
        f"{options.bumps}x{options.bumps} bumps, seeds {options.first} to"
        f" {options.first + options.seeds - 1}"
    )
    print(scaled)


if __name__ == "__main__":
    main()
