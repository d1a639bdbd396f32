"""The errors of a calibration made in air when it is used under water: `python -m
benchmarks.immerse [--sessions 16] [--pictures 24]`.

For each rendered pair, wet-flat, wet-dome and wet-cone: the session in air is fitted and put under
water as `calib immerse` does. Its maps there are compared with the rays that Mitsuba traced under
water, after the rigid motion of all rays that fits best, and with their predicted sigma. The same
of the session whose cover is stated without sigmas: each number then has the tolerance of its kind.
Held-out views under water are evaluated by the calibration as it was and as it became. Then the
maps with the number that the command asks for, measured as well as it asks, in four sessions in
which each of its components is off by just that. And with the first three pictures of the pool, as
`calib check --update` takes them, the maps once more.

Then synthetic sessions in air of an uneven cone, every declared number drawn from the tolerance of
its kind: how far off the maps are under water, over what is predicted, with the covariance as the
fit has it and as `replace_medium` carries it.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from calib.apply.change_medium import immerse, replace_medium
from calib.apply.dominant_uncertainty import DISPLAY_UNITS, DominantUncertainty
from calib.calibration import Calibration
from calib.checking.check import Checker
from calib.checking.pictures import read_pictures
from calib.checking.update import update
from calib.diagnosis.all_free import all_free
from calib.fit_record.request import FitRequest, Settings
from calib.fitting.evaluate import evaluate
from calib.fitting.fit import fit
from calib.fitting.setup import Setup
from calib.progress import Silent
from calib.session.cover import Cover
from calib.session.schema import Number
from calib.session.session import Session, read_session
from fixtures.calibrated import CAMERA, calibrated
from fixtures.map_errors import errors
from fixtures.rays import DEPTHS, FIXTURES, map_error
from fixtures.synthetic import INTRINSICS, Scene, misdeclared, paper_cone, scene
from fixtures.wet import GLASS

SHAPES = ("flat", "dome", "cone")
WATER = 1.34
SI = {unit: si for si, (unit, _) in DISPLAY_UNITS.items()}
SIGNS = ((1, 1, 1), (1, -1, 1), (-1, 1, -1), (-1, -1, -1))
POOL = 3
"""Pictures in the water."""
NEAR = 40.0
"""px: a pixel counts with three training corners that near."""


def vague(session: Session) -> Session:
    """The same with every number of the cover as it is stated, but by its kind's tolerance."""
    numbers = {name: Number(number.value) for name, number in session.cover.parameters.items()}
    return replace(session, cover=Cover(session.cover.shape, numbers))


def measured(
    session: Session, loose: DominantUncertainty, true: Mapping[str, float], signs: Sequence[int]
) -> Session:
    """The same with the number that is asked for as sure as that, each component off by just so
    much.
    """
    assert loose.measured_to is not None
    sigma = loose.measured_to / DISPLAY_UNITS[SI[loose.unit]][1]
    numbers, sign = dict(session.cover.parameters), iter(signs)
    for name in (name for name in numbers if name.split(".")[0] == loose.name):
        numbers[name] = Number(true[name] + next(sign) * sigma, sigma)
    return replace(session, cover=Cover(session.cover.shape, numbers))


def updated(calibration: Calibration, water: Path) -> Calibration:
    """Update the calibration by the first pictures in the new medium."""
    checker = Checker.of(calibration)
    pictures = read_pictures(sorted((water / "frames").glob("*.jpg"))[:POOL], calibration, Silent())
    return update(calibration, checker.prior, checker.check(pictures), pictures)[0]


def drawn(seed: int) -> tuple[float, float, float]:
    """px off under water, root mean square at 0.6 m, and over predicted sigma: with the covariance
    of the fit, and as it is carried.
    """
    cover = paper_cone(0.00115)
    made = scene(seed, 20, (4, 4), 3e-6, 0.1, cover=cover)
    intrinsics, declared_cover = misdeclared(np.random.default_rng(seed), INTRINSICS, cover)
    setup = Setup(made.board, replace(CAMERA, intrinsics=intrinsics), intrinsics, declared_cover)
    dry = calibrated(made, setup, Settings())
    dry = all_free(replace(dry, request=FitRequest(Settings())))
    carried = replace_medium(dry, Number(WATER))
    values = {**made.values, "cover.outside_index": torch.tensor(WATER, dtype=torch.float64)}
    ratios = [
        _ratio(replace(made, values=values), item)
        for item in (replace(carried, covariance=dry.covariance), carried)
    ]
    return ratios[0][0], ratios[0][1], ratios[1][1]


def _off(session: Session, folder: Path) -> tuple[list[float], list[float]]:
    """px off at each depth, and what is predicted."""
    put = immerse(all_free(fit(session)), Number(WATER))
    error = map_error(put.calibration, folder / "water" / "truth.npz", NEAR)
    return list(error.by_depth.values()), list(error.predicted.values())


def _ratio(made: Scene, wet: Calibration) -> tuple[float, float]:
    rows = [
        (float(np.mean(error**2)), float(np.nanmean(sigma**2)))
        for error, sigma in errors(made, wet)
    ]
    return rows[1][0] ** 0.5, float(np.mean([error / sigma for error, sigma in rows])) ** 0.5


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.immerse", description=__doc__)
    parser.add_argument(
        "--sessions", type=int, default=16, metavar="N", help="synthetic ones, 3 s each"
    )
    parser.add_argument(
        "--pictures",
        type=int,
        default=24,
        metavar="N",
        help="of the 24 that were taken in air, evenly chosen",
    )
    args = parser.parse_args()
    sessions, pictures = args.sessions, args.pictures
    console = Console()
    at = [f"{depth:g} m" for depth in DEPTHS]
    maps = Table(
        "glass",
        "stated",
        *(f"off, {item}" for item in at),
        *(f"sigma, {item}" for item in at),
        "ratio",
        "most is left open by",
    )
    views = Table("glass", "as it was", "immersed")
    pool = Table("glass", *(f"off, {item}" for item in at), *(f"sigma, {item}" for item in at))
    requested_table = Table(
        "glass", "asked for", *(f"off, {item}" for item in at), *(f"sigma, {item}" for item in at)
    )
    for shape in SHAPES:
        folder = FIXTURES / f"wet-{shape}"
        session = read_session(folder)
        session = replace(
            session, frames=session.frames[:: max(1, len(session.frames) // pictures)]
        )
        for title, item in (("as measured", session), ("by its kind", vague(session))):
            dry = fit(item)
            put = immerse(all_free(dry), Number(WATER))
            error = map_error(put.calibration, folder / "water" / "truth.npz", NEAR)
            px, sigma = error.by_depth.values(), error.predicted.values()
            ratio = max(deviation / expected for deviation, expected in zip(px, sigma, strict=True))
            dominant_names = ", ".join(loose.name for loose in put.dominant[:2])
            maps.add_row(
                shape,
                title,
                *(f"{value:.3f}" for value in (*px, *sigma)),
                f"{ratio:.2f}",
                dominant_names,
            )
            if item is session:
                water = read_session(folder / "water")
                views.add_row(
                    shape,
                    *(
                        f"{evaluate(which, water).rms_px:.3f} px"
                        for which in (dry, put.calibration)
                    ),
                )
                wet_error = map_error(
                    updated(put.calibration, folder / "water"), folder / "water" / "truth.npz", NEAR
                )
                loose = next(group for group in put.dominant if group.measured_to is not None)
                rows = np.array(
                    [
                        list(_off(measured(session, loose, GLASS[shape], signs), folder))
                        for signs in SIGNS
                    ]
                )  # (4, 2, D)
                wanted = f"{loose.name} to {loose.measured_to:.2g} {loose.unit}"
                requested_table.add_row(
                    shape, wanted, *(f"{value:.3f}" for value in np.sqrt((rows**2).mean(0)).ravel())
                )
                pool.add_row(
                    shape,
                    *(
                        f"{value:.3f}"
                        for value in (*wet_error.by_depth.values(), *wet_error.predicted.values())
                    ),
                )
    all_rows = np.array([drawn(seed) for seed in range(sessions)]).reshape(-1, 3)
    console.print("Maps under water, px RMS", maps, "Held-out views under water", views, sep="\n")
    console.print(
        "Maps under water, with the number measured that is asked for", requested_table, sep="\n"
    )
    console.print("Maps under water, brought up to date by three views there", pool, sep="\n")
    if sessions:
        deviation, fitted, carried = np.sqrt((all_rows**2).mean(0))
        console.print(
            f"{sessions} synthetic sessions: off by {deviation:.2g} px at 0.6 m, {fitted:.2f} times"
            f" what the fit's own covariance predicts, {carried:.2f} times what is predicted where"
            " no number of the cover is surer than declared",
            soft_wrap=True,
            highlight=False,
        )


if __name__ == "__main__":
    main()
