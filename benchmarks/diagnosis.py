"""What the diagnosis names when an effect of known size is hidden: `python -m benchmarks.diagnosis [--seeds 3] [--clean 40]`.

Each session has 20 views of 81 corners, 0.1 px noise per axis, uneven glass of 1.15 mm (or no cover, for what only a bare camera shows),
and one effect at once, three and ten times the smallest size that moves a corner by the noise: the largest shift over all corners, poses
refitted, is then 0.1, 0.3 and 1 px.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.uncertainty import GLASS, calibrate
from calib.calibration import Calibration
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.record import Diagnosis
from calib.diagnosis.words import ABSORBED
from calib.effects.effect import Effect, Surroundings
from calib.effects.registry import EFFECTS
from calib.optics.params import Values
from calib.optics.project import project
from calib.poses import refit_poses
from calib.progress import Silent
from calib.stages import Settings
from calib.threads import single_thread
from calib.views import View
from tests.scenes import HEIGHT, WIDTH, Scene, scene

Array = NDArray[np.float64]

NOISE = 0.1
"""px per axis"""
SIZES = (1, 3, 10)
SMALL = {"m": 1e-5, "rad": 1e-4, "px": 0.01, "": 1e-4}
"""What the search for the smallest size begins with."""


def hidden(made: Scene, effect: Effect, direction: Values, size: float, motions: torch.Tensor, noise: float) -> Scene:
    """The scene with its corners where the effect puts them."""
    path = effect.apply(made.path)
    values = {**made.values, **{u.param.name: u.neutral + size * direction[u.param.name] for u in effect.unknowns}}
    poses = torch.cat([made.poses, size * motions], 1) if effect.per_view else made.poses
    seen = made.observations.timed([float(i) for i in range(len(made.views))], HEIGHT)
    told = seen.told(values)
    pixels = project(path, told, path.place(seen.corners, told, poses[seen.view]), start=seen.pixels).numpy()
    rng = np.random.default_rng(len(made.views))
    count = made.board.count
    views = (
        View(view.name, pixels[i * count : (i + 1) * count] + rng.normal(0, noise, (count, 2)), view.weight)
        for i, view in enumerate(made.views)
    )
    return replace(made, views=tuple(views))


def smallest(made: Scene, effect: Effect, direction: Values, motions: torch.Tensor) -> float:
    """The size at which a corner is moved by the noise, poses refitted to the true path."""
    size = 1.0
    for _ in range(4):
        moved = hidden(made, effect, direction, size, motions, 0.0).observations
        shift = refit_poses(made.path, made.values, moved, made.poses)[1].image.norm(dim=-1).max()
        size *= NOISE / float(shift)
    return size


def direction_of(effect: Effect, rng: np.random.Generator) -> dict[str, torch.Tensor]:
    """A random direction in the effect's numbers, each by its own scale."""
    return {u.param.name: torch.from_numpy(np.asarray(rng.normal(size=u.param.shape))) * SMALL[u.param.unit] for u in effect.unknowns}


def diagnosed(made: Scene) -> tuple[Calibration, Diagnosis]:
    """What a person would be told."""
    return diagnose(calibrate(made, Settings()), Silent())


def forms(made: Scene, kind: type[Effect], rng: np.random.Generator) -> Effect | None:
    """One form of the effect in this scene."""
    outer = made.path.cover[-1]
    low, high = (np.array(end) for end in (outer.relief.low, outer.relief.high)) if outer.relief else (np.zeros(2), np.zeros(2))
    middle = torch.from_numpy(rng.uniform(low + 0.35 * (high - low), high - 0.35 * (high - low)))
    there = Surroundings(made.board, WIDTH, HEIGHT, made.path, made.values, suspect=middle)
    proposed = kind.propose(there)
    return proposed[0] if proposed else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--clean", type=int, default=40)
    parser.add_argument("--effects", nargs="*", default=[kind.name for kind in EFFECTS])
    options = parser.parse_args()
    console = Console(width=150)
    table = Table(
        "effect",
        *(f"{size} x" for size in SIZES),
        "absorbed",
        "s",
        title="Named right / wrong / not at all",
    )
    right, judged = Counter[int](), Counter[int]()
    with single_thread():
        for kind in EFFECTS:
            if kind.name not in options.effects:
                continue
            cells, absorbed, spent = [], [], []
            for size in SIZES:
                said = Counter[str]()
                for seed in track(range(options.seeds), f"{kind.name} x{size}", transient=True):
                    rng = np.random.default_rng(seed)
                    made = scene(1000 + seed, 20, (4, 4), 1e-5, 0.0, cover=GLASS)
                    effect = forms(made, kind, rng)
                    if effect is None:
                        said["not here"] += 1
                        continue
                    motions = torch.from_numpy(rng.normal(0, [1e-4] * 3 + [1e-5] * 3, (20, 6)))
                    direction = direction_of(effect, rng)
                    amount = size * smallest(made, effect, direction, motions)
                    spoiled = hidden(made, effect, direction, amount, motions, NOISE)
                    if not all(np.isfinite(view.corners).all() for view in spoiled.views):
                        said["unseen"] += 1  # so large a change that some corner is seen no more: poses hide nearly all of it
                        continue
                    begun = time.perf_counter()
                    _, finding = diagnosed(spoiled)
                    spent.append(time.perf_counter() - begun)
                    own = [c.absorbed for c in finding.candidates if c.effect == kind.name]
                    absorbed += own
                    wrong = [name for name in finding.accepted if name != kind.name]
                    said["right" if kind.name in finding.accepted and not wrong else "wrong" if wrong else "missed"] += 1
                kinds = [f"{said['right']} / {said['wrong']} / {said['missed']}", *(w for w in ("not here", "unseen") if said[w])]
                cells.append(kinds[-1])
                if absorbed and np.mean(absorbed) < ABSORBED:
                    right[size] += said["right"]
                    judged[size] += options.seeds - said["unseen"]
            table.add_row(
                kind.name, *cells, f"{100 * np.mean(absorbed):.0f} %" if absorbed else "", f"{np.mean(spent):.1f}" if spent else ""
            )
            console.print(table)
        false = Counter[str]()
        for seed in track(range(options.clean), "clean"):
            made = scene(2000 + seed, 20, (4, 4), 1e-5, NOISE, cover=GLASS)
            false.update(diagnosed(made)[1].accepted)
    console.print(table)
    for size in SIZES:
        if judged[size]:
            known = f"of effects absorbed by less than {100 * ABSORBED:.0f} %"
            console.print(f"{size} x: {right[size]} of {judged[size]} named right, {known}.")
    console.print(f"False alarms in {options.clean} clean sessions: {dict(false) or 'none'}.")


if __name__ == "__main__":
    main()
