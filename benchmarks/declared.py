"""The errors of maps with wrong numbers in session.yaml: `python -m benchmarks.declared`, and with
these numbers held: `python -m benchmarks.declared SESSION ...`.

`fixtures/clean` with one number made wrong at a time, or with its pictures turned, fitted with
every number held, and as by default, where each may be estimated near what is declared, by the
tolerance of its kind. Map errors are against the renderer's rays, turned as the pictures are.

Then what freeing costs where all that is declared is true: synthetic views at 0.6-1.2 m through
1.15 mm of uneven glass, 0.1 px of noise per axis, tested on 20 other views over more depths, and on
20 nearer than any that was fitted, with poses refitted.

For the named sessions it prints the evidence that `calib.fitting.resolve_prior_conflict` weighs:
how much more probable the corners are with every number estimated than with every number held, how
uneven the glass is with both, and which numbers would be contradicted.
"""

import copy
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

from calib.calibration import Calibration
from calib.estimation.poses import refit_poses
from calib.estimation.relief_heights import height_spread
from calib.fit_record.request import Settings
from calib.fitting.declared import comparisons
from calib.fitting.fit import fit
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.progress import Silent
from calib.session.freeing import ALL, AUTO, NONE
from calib.session.session import read_session
from calib.threads import single_thread
from calib.verdict.judge import judge
from fixtures.calibrated import CAMERA, GLASS
from fixtures.rays import FIXTURES, map_error
from fixtures.synthetic import INTRINSICS, scene

SOURCE = FIXTURES / "clean"
IMAGES = (".png", ".jpg")
DEPTH = 0.5
"""m"""
NOISE = 0.1
"""px per axis"""
Described = dict[str, Any]


def _cover(key: str, factor: float) -> Callable[[Described], None]:
    return lambda document: document["cover"].update({key: factor * document["cover"][key]})


def _intrinsics(**numbers: float) -> Callable[[Described], None]:
    return lambda document: document["camera"]["intrinsics"].update(numbers)


def _longer(document: Described) -> None:
    intrinsics = document["camera"]["intrinsics"]
    intrinsics.update(fx=1.03 * intrinsics["fx"], fy=1.03 * intrinsics["fy"])


WRONG: dict[str, Callable[[Described], None]] = {
    "the truth": lambda _: None,
    "thickness 1.5 for 3 mm": _cover("thickness_mm", 0.5),
    "thickness 6": _cover("thickness_mm", 2.0),
    "radius +30 %": _cover("inner_radius_mm", 1.3),
    "index 1.33 for 1.5": _cover("refractive_index", 1.33 / 1.5),
    "slope's sign flipped": _cover("radius_slope", -1.0),
    "f +3 %": _longer,
    "cx, cy = the picture's centre": _intrinsics(cx=819.5, cy=615.5),
    "square 24 for 20 mm": lambda said: said["board"].update(square_mm=24.0),
}


TURNED = {"pictures turned by 180 degrees": (-1.0, -1.0), "pictures mirrored": (-1.0, 1.0)}
"""The sign of x and y in what the driver gives."""


def fitted(document: Described, folder: Path, free: str = AUTO) -> Calibration:
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    return fit(read_session(folder), Settings(free=(free,)), Silent())


def turn(folder: Path, sign: tuple[float, float]) -> None:
    """The frames as a driver would give them, without further loss or corners that were found
    before, and the true rays of their pixels.
    """
    shutil.rmtree(folder / "frames")
    shutil.copytree(
        SOURCE / "frames", folder / "frames", ignore=shutil.ignore_patterns("*.npz", "*.vnl")
    )
    for picture in sorted(path for path in (folder / "frames").iterdir() if path.suffix in IMAGES):
        visible = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
        assert visible is not None
        picture.unlink()
        cv2.imwrite(str(picture.with_suffix(".png")), visible[:: int(sign[1]), :: int(sign[0])])
    with np.load(SOURCE / "truth.npz") as file:
        truth = dict(file)
    direction = np.array([*sign, 1.0])
    camera = read_session(folder).camera
    size = np.array([camera.width, camera.height]) - 1.0
    pixels = np.where(np.array(sign) < 0, size - truth["pixels"], truth["pixels"])
    np.savez(
        folder / "truth.npz",
        pixels=pixels,
        origins=direction * truth["origins"],
        directions=direction * truth["directions"],
    )


def _row(calibration: Calibration, truth: Path) -> tuple[str, str]:
    error = map_error(calibration, truth, near=40.0, depths=(DEPTH,))
    return f"{error.by_depth[DEPTH]:.3f}", f"{error.predicted[DEPTH]:.3f}"


def said_of(calibration: Calibration) -> str:
    """Return the corrected numbers, and the suspects of the verdict."""
    corrected = [
        f"{item.name} {item.estimated}" for item in comparisons(calibration) if item.corrected
    ]
    verdict = judge(calibration)
    suspects = f": {', '.join(verdict.suspects)}" if verdict.suspects else ""
    return f"{verdict.word.value}{suspects}; corrected: {', '.join(corrected) or 'nothing'}"


def rows() -> Iterator[tuple[str, ...]]:
    """The wrong sessions: name, errors of two stages, map errors and sigmas held and free, what is
    said.
    """
    described = yaml.safe_load((SOURCE / "session.yaml").read_text())
    with TemporaryDirectory() as place:
        folder = Path(place) / "clean"
        shutil.copytree(SOURCE, folder, ignore=shutil.ignore_patterns("holdout"))
        for name in track((*WRONG, *TURNED), "Sessions"):
            document = copy.deepcopy(described)
            if name in TURNED:
                turn(folder, TURNED[name])
            else:
                WRONG[name](document)
            truth = folder / "truth.npz"
            free = fitted(document, folder)
            errors = f"{free.stages[1].rms_px:.3f}", f"{free.stages[2].rms_px:.3f}"
            held = fitted(document, folder, NONE)
            gained = _log_evidence(free) - _log_evidence(held)
            uneven = " -> ".join(
                f"{1e6 * height_spread(*item.model(), item.observations):.1f}"
                for item in (held, free)
            )
            yield (
                name,
                *errors,
                *_row(held, truth),
                *_row(free, truth),
                f"{gained:+.0f}",
                uneven,
                said_of(free),
            )


def _log_evidence(calibration: Calibration) -> float:
    joint = calibration.outcome.joint
    assert joint
    assert joint.log_evidence is not None
    return joint.log_evidence


def cost(seed: int, views: int) -> Iterator[list[str]]:
    """Two rows: held, and free."""
    made = scene(seed, views, (4, 4), 1e-05, NOISE, cover=GLASS, depths=(0.6, 1.2))
    test_scene = scene(seed, 20, (4, 4), 1e-05, NOISE, cover=GLASS, depths=(0.3, 1.2))
    near = scene(seed, 20, (4, 4), 1e-05, NOISE, cover=GLASS, depths=(0.17, 0.3))
    floors = (
        f"{refit_poses(held.path, held.values, held.observations, held.poses)[1].rms_px:.3f}"
        for held in (test_scene, near)
    )
    yield [f"{views} views, seed {seed}", "true glass", *floors, ""]
    for name, free in (("held", NONE), ("estimated", ALL)):
        settings = Settings(free=(free,))
        result = fit_stages(
            Setup(made.board, CAMERA, INTRINSICS, GLASS).with_tolerances(settings),
            made.observations,
            settings,
            Silent(),
        )
        assert result.joint
        errors = (
            refit_poses(result.path, result.values, held.observations, held.poses)[1].rms_px
            for held in (test_scene, near)
        )
        yield ["", name, *(f"{error:.3f}" for error in errors), str(result.joint.iterations)]


def said_to_be_wrong(session: Path) -> tuple[str, ...]:
    """A row of what would be believed."""
    held = fit(read_session(session), Settings(free=(NONE,)), Silent())
    free = fit(read_session(session), Settings(free=(ALL,)), Silent())
    default = fit(read_session(session), Settings(free=(AUTO,)), Silent())
    gained = _log_evidence(free) - _log_evidence(held)
    spreads = (
        f"{1e6 * height_spread(*item.model(), item.observations):.1f}" for item in (held, free)
    )
    wrong = ", ".join(
        f"{item.name} {item.estimated}" for item in comparisons(free) if item.contradicted
    )
    return (
        session.name,
        f"{gained:+.0f}",
        *spreads,
        wrong,
        "estimated" if any(not item.held for item in comparisons(default)) else "held",
    )


def main() -> None:
    sessions = [Path(name) for name in sys.argv[1:]]
    if sessions:
        decided = Table(
            "session",
            "log evidence, gained",
            "uneven by, held, um",
            "estimated, um",
            "contradicted",
            "by default",
        )
        for session in track(sessions, "Sessions"):
            decided.add_row(*said_to_be_wrong(session))
        Console(width=170).print(decided)
        return
    kinds = (f"{how}: {what}" for how in ("held", "by default") for what in ("map error", "sigma"))
    table = Table(
        "told", "cover stage, px", "final, px", *kinds, "log evidence, gained", "uneven, um", "said"
    )
    for row in rows():
        table.add_row(*row)
    Console(width=170).print(table)
    price = Table(
        "all declared is true", "", "other views, px", "nearer views, px", "linearisations"
    )
    with single_thread():
        for views in (12, 45):
            for seed in (1, 2):
                for cells in cost(seed, views):
                    price.add_row(*cells)
    Console(width=170).print(price)


if __name__ == "__main__":
    main()
