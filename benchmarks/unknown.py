"""The figures of docs/unknown.md: what a fit finds where numbers are not known. `python -m
benchmarks.unknown`.

Each line is a fit of the eight views under water of `fixtures/wet-*` with some numbers written as
`unknown`. The other numbers are as a person measured them. Maps are compared with the renderer's
rays, 0.5 m away.

    python -m benchmarks.unknown --media

prints the log odds of water against air of rendered pictures, with a lens or a thickness that is
not known: those in air as they are declared, and those in water as if they were in air.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from calib.calibration import Calibration
from calib.errors import NotEnoughDataError
from calib.fit_record.request import Settings
from calib.fitting.description import calibrated_numbers
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.rounding import with_sigma
from calib.session.schema import UNKNOWN
from calib.session.session import read_session
from calib.verdict.judge import judge
from fixtures.rays import FIXTURES, map_error
from fixtures.wet import GLASS

DEPTH = 0.5
"""m"""
NEAR = 80.0
"""px: a map counts where three corners lie that near."""
ALL = "everything"
INTRINSICS = "intrinsics"
SHAPE = "shape"
CASES: Mapping[str, Sequence[tuple[str, ...]]] = {
    "dome": (
        (),
        ("inner_radius_mm",),
        ("centre_mm",),
        ("inner_radius_mm", "centre_mm"),
        ("thickness_mm",),
        ("refractive_index",),
        (INTRINSICS,),
        (SHAPE,),
        (ALL,),
    ),
    "flat": (
        (),
        ("distance_mm",),
        ("thickness_mm",),
        ("refractive_index",),
        (INTRINSICS,),
        (SHAPE,),
        (ALL,),
    ),
    "cone": ((), ("inner_radius_mm",), ("radius_slope",), ("axis_offset_mm",), (ALL,)),
}
DECIMALS = {"radius_slope": 3}
"""The decimals that are printed of a true number, where two do not show its sigma."""
PER_SI = {"_mm": 1e3, "_deg": np.rad2deg(1)}


AIR = ("clean", "bumps", "bow", "tilted", "wave", "bump", "shutter", *(f"wet-{s}" for s in CASES))
"""Sessions in air."""


def main() -> None:
    if "--media" in sys.argv[1:]:
        print_media()
        return
    print(f"{'':<41}maps, px")
    print(f"{'not known':<16}{'true':>7} {'found':<16} error sigma verdict")
    for shape, cases in CASES.items():
        print("a window:" if shape == "flat" else f"a {shape}:")
        for unknown in cases:
            for line in lines(shape, unknown):
                print(line.rstrip())


def print_media() -> None:
    """Print the log odds of water against air."""
    print(f"{'':<22}{'thickness unknown':>20}{'lens unknown':>20}{'all unknown':>20}")
    for name in (*AIR, *(f"wet-{shape}/water" for shape in CASES)):
        cells = []
        for unknown in (("thickness_mm",), (INTRINSICS,), (ALL,)):
            document = yaml.safe_load((FIXTURES / name / "session.yaml").read_text())
            forget(document, unknown)
            document["cover"].pop("outside_index", None)
            try:
                odds = fitted(document, FIXTURES / name).outcome.medium_log_odds
            except NotEnoughDataError:
                cells.append(f"{'refused':>20}")
                continue
            cells.append(f"{odds['water'] - odds['air']:20.0f}" if odds else f"{'none':>20}")
        print(f"{name:<22}{''.join(cells)}", flush=True)


def fitted(document: dict[str, Any], source: Path) -> Calibration:
    """Return the fit of a fixture's pictures with another session.yaml."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "session.yaml").write_text(yaml.safe_dump(document))
        (Path(folder) / "frames").symlink_to(source / "frames")
        return fit(read_session(folder), Settings(), Silent())


def lines(shape: str, unknown: tuple[str, ...]) -> list[str]:
    """Return the lines on a fit: one for each number that is not known, the first with more."""
    source = FIXTURES / f"wet-{shape}" / "water"
    document = yaml.safe_load((source / "session.yaml").read_text())
    forget(document, unknown)
    calibration = fitted(document, source)
    error = map_error(calibration, source / "truth.npz", NEAR, (DEPTH,))
    word = judge(calibration).word.value
    numbers: Any = calibrated_numbers(calibration)
    end = f"{error.by_depth[DEPTH]:6.3f}{error.predicted[DEPTH]:6.3f} {word}"
    if unknown in ((), (ALL,), (SHAPE,)):
        result = f"{calibration.cover.shape}" if unknown == (SHAPE,) else ""
        return [f"{(unknown or ('nothing',))[0]:<23} {result:<16}{end}"]
    rows = []
    if unknown == (INTRINSICS,):
        with np.load(source / "truth.npz") as truth:
            rows = [("fx, px", truth["intrinsics"][0], numbers["camera"]["fx"])]
    for key, number in numbers["cover"].items():
        stem, _, component = key.partition(".")
        if stem in unknown and component in ("", "z"):
            name, per_si = si_name(stem)
            true = GLASS[shape][f"{name}.{component}" if component else name] * per_si
            rows.append((key, true, number))
    return [
        _number(name, true, number).ljust(40) + (end if place == 0 else "")
        for place, (name, true, number) in enumerate(rows)
    ]


def _number(name: str, true: float, number: Mapping[str, float]) -> str:
    decimals = DECIMALS.get(name, 2)
    found = with_sigma(number["value"], number["sigma"])
    return f"{name:<16}{true:7.{decimals}f} {found}"


def forget(document: dict[str, Any], unknown: tuple[str, ...]) -> None:
    """Write `unknown` in a session.yaml."""
    cover = document["cover"]
    if unknown == (SHAPE,):
        document["cover"] = {SHAPE: UNKNOWN, "outside_index": cover["outside_index"]}
        return
    keys = [*cover] if unknown == (ALL,) else unknown
    for key in set(keys) & set(cover) - {SHAPE, "outside_index"}:
        cover[key] = UNKNOWN
    if unknown in ((ALL,), (INTRINSICS,)):
        document["camera"]["intrinsics"] = UNKNOWN


def si_name(key: str) -> tuple[str, float]:
    """Return a key without its unit, and the number of these units in one SI unit."""
    for suffix, per_si in PER_SI.items():
        if key.endswith(suffix):
            return key.removesuffix(suffix), per_si
    return key, 1.0


if __name__ == "__main__":
    main()
