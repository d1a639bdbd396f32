"""The benefit of boards that reach out of the picture at its border: the table of docs/corners.md.

Three sessions of one camera behind one glass, of 24 views each: whole checkerboards, and boards
with markers of which a third reach out. Held out are views whose boards all do, and whole
checkerboards. A view's pose is fitted to all of its corners, as by `calib evaluate`.

python -m benchmarks.border
"""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.fitting.fit import fit
from calib.session.session import read_session
from fixtures.border import held_out

FIXTURES = Path(__file__).parents[1] / "fixtures"
WHOLE = "bumps"
REACHING = ("charuco", "aprilgrid")


def main() -> None:
    calibrations = {name: fit(read_session(FIXTURES / name)) for name in (WHOLE, *REACHING)}
    table = Table(
        "held out",
        "corners",
        *calibrations,
        *(f"{name}, lower by" for name in REACHING),
        title="px RMS, by calibration",
    )
    for judge in (*REACHING, WHOLE):
        session = read_session(FIXTURES / judge / "holdout")
        results = {
            name: held_out(calibration, session) for name, calibration in calibrations.items()
        }
        _, border = results[WHOLE]
        for where, chosen in (("border", border), ("inside", ~border)):
            rms = {
                name: float(np.sqrt((errors[chosen] ** 2).mean()))
                for name, (errors, _) in results.items()
            }
            lower = (f"{100 * (1 - rms[name] / rms[WHOLE]):.0f} %" for name in REACHING)
            table.add_row(
                f"{judge}/holdout, {where}",
                str(chosen.sum()),
                *(f"{value:.4f}" for value in rms.values()),
                *lower,
            )
    Console(width=140).print(table)
    for name, calibration in calibrations.items():
        print(
            f"{name}: {len(calibration.views)} views,"
            f" {sum(view.count for view in calibration.views)} corners"
        )


if __name__ == "__main__":
    main()
