"""The benefit of a fleet's own prior: how many views a new camera takes until its maps are right,
with the prior and without.

`python -m benchmarks.fleet_prior [--fleet 12] [--cameras 8] [--seed 1] [--first 100]` calibrates a
fleet of simulated cameras behind the paper's cone, 16 views each, makes its prior, and fits new
cameras of the same line to ever more of their views. A map's error is that of the undistorted
position over the middles of 12x9 cells of the whole picture at three trained depths, root mean
square, after the rigid motion of all rays that fits best. Then cameras that are not of the line are
fitted with its prior: how many are told, and what it does to their maps.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

from calib.calibration import Calibration
from calib.corners.corners_file import read_corners, write_corners
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.fleet.identity import FleetOptions
from calib.fleet.job import Job, run_job
from calib.fleet.manifest import Entry
from calib.fleet.prior import estimate_fleet_prior
from calib.session.fleet_prior import fleet_prior_yaml
from calib.session.session import read_session
from calib.threads import single_thread
from calib.version import VERSION
from fixtures.fleet import FAULTS, Line, true_scene, write_session
from fixtures.map_errors import motions, rays_of, seen_at
from fixtures.synthetic import HEIGHT, WIDTH, Scene

SETTINGS = Settings(grid=(8, 8))
COUNTS = (3, 4, 6, 8, 12, 16, 24, 32, 48)
LIMITS = (1.0, 0.5, 0.2, 0.1)
"""px"""
DEPTHS = (0.3, 0.55, 1.0)
"""m"""
CELLS = (12, 9)
STRANGERS = ("focus", "other-glass", "turned-cover", "hit-lens")
"""Faults of fixtures.fleet that make a camera another."""
STRANGE_COUNTS = (4, 8, 16)


@dataclass(frozen=True)
class Tried:
    """A fit with the prior, or without."""

    error: float
    """px"""
    used: bool = False


def map_error(made: Scene, calibration: Calibration) -> float:
    """px"""
    columns, rows = CELLS
    x = (np.arange(columns) + 0.5) / columns * WIDTH - 0.5
    y = (np.arange(rows) + 0.5) / rows * HEIGHT - 0.5
    pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    ours, true = calibration.rays(pixels), rays_of(made.path, made.values, pixels)
    at = [np.full(len(pixels), depth) for depth in DEPTHS]
    error = np.concatenate(
        [(seen_at(*true, depth) - seen_at(*ours, depth)).ravel() for depth in at]
    )
    moved = np.concatenate([motions(*ours, depth) for depth in at])
    remainder = error - moved @ np.linalg.lstsq(moved, error, rcond=None)[0]
    return float(np.sqrt((remainder**2).mean() * 2))


def tried(folder: Path, made: Scene, prior: Path, count: int) -> tuple[Tried, Tried]:
    """Without the prior and with it, from a session's first views; `folder` is that of all."""
    session = read_session(folder)
    assert session.corners
    views = read_corners(session.corners, session.board)[:count]
    document = yaml.safe_load((folder / "session.yaml").read_text())
    short_session = folder / str(count)
    short_session.mkdir(exist_ok=True)
    write_corners(short_session / "corners.vnl", views)
    (short_session / "session.yaml").write_text(yaml.safe_dump(document))
    alone = fit(read_session(short_session), SETTINGS)
    (short_session / "session.yaml").write_text(yaml.safe_dump(document | {"prior": str(prior)}))
    calibration = fit(read_session(short_session), SETTINGS)
    assert calibration.outcome.fleet_prior
    used = calibration.outcome.fleet_prior.used
    return Tried(map_error(made, alone)), Tried(map_error(made, calibration), used)


def made_prior(folder: Path, line: Line) -> Path:
    for number in track(range(line.cameras), "fleet"):
        write_session(folder / "sessions" / line.name(number), line, number)
        entry = Entry(line.name(number), str(folder / "sessions" / line.name(number)))
        run_job(Job(entry, FleetOptions(SETTINGS), str(folder / "fleet")))
    prior = estimate_fleet_prior(folder / "fleet")
    place = folder / "prior.yaml"
    place.write_text(fleet_prior_yaml(prior, VERSION))
    print(
        f"prior of {prior.cameras} cameras; left out:"
        f" {', '.join(f'{camera} ({because})' for camera, because in prior.left_out) or 'none'}"
    )
    return place


def views_needed(errors: Sequence[float], limit: float) -> float:
    """From where on the error stays within a limit."""
    sufficient = [count for count, error in zip(COUNTS, errors, strict=True) if error > limit]
    later = [count for count in COUNTS if count > max(sufficient, default=0)]
    return float(later[0]) if later else np.inf


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--fleet", type=int, default=12, help="cameras that the prior is made from")
    parser.add_argument("--cameras", type=int, default=8, help="new ones")
    parser.add_argument("--seed", type=int, default=1, help="of the fleet")
    parser.add_argument("--first", type=int, default=100, help="seed of the new cameras")
    options = parser.parse_args()
    with TemporaryDirectory() as temporary, single_thread():
        folder = Path(temporary)
        prior = made_prior(folder, Line(options.fleet, broken=(), seed=options.seed))
        full = Line(options.cameras, max(COUNTS), broken=(), seed=options.first)
        results: list[list[tuple[Tried, Tried]]] = []
        for number in track(range(options.cameras), "new cameras"):
            place = folder / "new" / full.name(number)
            write_session(place, full, number)
            results.append(
                [tried(place, true_scene(full, number), prior, count) for count in COUNTS]
            )
        strangers: dict[str, list[list[tuple[Tried, Tried]]]] = {}
        for fault in track(STRANGERS, "strangers"):
            line = replace(full, broken=(fault,) * (2 * full.cameras), views=max(STRANGE_COUNTS))
            for number in range(min(4, options.cameras)):
                place = folder / fault / line.name(number)
                write_session(place, line, number)
                ended = [
                    tried(place, true_scene(line, number), prior, count) for count in STRANGE_COUNTS
                ]
                strangers.setdefault(fault, []).append(ended)
    report(results, strangers)
    print(
        f"fleet of seed {options.seed}, {options.fleet} cameras; new ones of seed {options.first}"
    )


def report(
    results: list[list[tuple[Tried, Tried]]], strangers: dict[str, list[list[tuple[Tried, Tried]]]]
) -> None:
    console = Console(width=130)
    errors = np.array(
        [[[item.error for item in pair] for pair in camera] for camera in results]
    )  # (camera, count, 2)
    table = Table(
        "views",
        "map error without, px: median",
        "worst",
        "with the prior: median",
        "worst",
        "prior refused",
    )
    for at, count in enumerate(COUNTS):
        refused = sum(not camera[at][1].used for camera in results)
        cells = (
            f"{value:.3f}"
            for column in (0, 1)
            for value in (np.median(errors[:, at, column]), errors[:, at, column].max())
        )
        table.add_row(str(count), *cells, f"{refused} of {len(results)}")
    console.print(table)
    needed = Table(
        "map error within",
        "views without, median camera",
        "with the prior",
        "cameras that get there",
    )
    for limit in LIMITS:
        counts = [
            np.array([views_needed(camera[:, column], limit) for camera in errors])
            for column in (0, 1)
        ]
        words = [
            f"{m:g}" if np.isfinite(m := float(np.median(column))) else f"more than {COUNTS[-1]}"
            for column in counts
        ]
        needed.add_row(
            f"{limit:g} px",
            *words,
            " and ".join(f"{np.isfinite(column).sum()}" for column in counts)
            + f" of {len(results)}",
        )
    console.print(needed)
    other_table = Table(
        "camera that is another",
        "views",
        "prior refused",
        "map error without, median px",
        "with a session that names it",
    )
    for fault, cameras in strangers.items():
        for at, count in enumerate(STRANGE_COUNTS):
            pairs = [camera[at] for camera in cameras]
            medians = (
                f"{np.median([pair[column].error for pair in pairs]):.3f}" for column in (0, 1)
            )
            other_table.add_row(
                fault,
                str(count),
                f"{sum(not pair[1].used for pair in pairs)} of {len(pairs)}",
                *medians,
            )
    console.print(other_table)


if __name__ == "__main__":
    assert set(STRANGERS) <= set(FAULTS)
    main()
