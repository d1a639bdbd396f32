"""How exactly a camera pixel's place on a screen is decoded: `python -m benchmarks.fringes`.

A simulated camera photographs the patterns of a plan: noise of 2 grey levels, a blur of 1.5 px,
gamma 2.2, JPEG of quality 90. Each line changes one thing: the camera's noise, the screen's gamma,
the lens' blur, JPEG, the fringes' period, or how they are counted. The error is that on the screen,
turned to camera pixels by the true slopes, in two dimensions, root mean square over the points
(each the mean of 3x3 pixels); beside it the error that is predicted, and the error in predicted
standard deviations.
"""

from dataclasses import dataclass, field, replace

from rich.console import Console
from rich.table import Table

from calib.fringes.decode import decode_fringes, screen_points
from calib.fringes.pattern import FringePlan, Screen, Unwrapping
from fixtures.screen import ScreenCamera, place_errors

SCREEN = Screen(420, 320, (2.0e-4, 2.0e-4))
USUAL = ScreenCamera(width=160, height=120)
PLAN = FringePlan(SCREEN, 20.0)


@dataclass(frozen=True, slots=True)
class Case:
    """A line of the table."""

    words: str
    camera: ScreenCamera = USUAL
    plan: FringePlan = field(default=PLAN)


CASES = (
    Case("as usual"),
    *(Case(f"noise {noise:g} grey levels", replace(USUAL, noise=noise)) for noise in (0.5, 1, 4)),
    *(Case(f"gamma {gamma:g}", replace(USUAL, gamma=gamma)) for gamma in (1.0, 1.8, 2.6)),
    *(Case(f"JPEG {quality}", replace(USUAL, jpeg=quality)) for quality in (98, 95, 80)),
    Case("no JPEG", replace(USUAL, jpeg=None)),
    *(Case(f"blur {blur:g} px", replace(USUAL, blur=blur)) for blur in (0.7, 2.5, 4)),
    *(
        Case(
            f"blur {blur:g} px, fringes {period:g} px",
            replace(USUAL, blur=blur),
            replace(PLAN, period=period),
        )
        for blur, period in ((2.5, 30.0), (4.0, 48.0))
    ),
    Case("6 steps", plan=replace(PLAN, steps=6)),
    Case("Gray code", plan=replace(PLAN, unwrapping=Unwrapping.GRAY)),
)


def main() -> None:
    columns = ("case", "pictures", "error", "predicted", "ratio")
    table = Table(*columns, title="Errors in px", box=None, padding=(0, 1, 0, 0))
    for case in CASES:
        frames = case.camera.photograph(SCREEN, case.plan.draw())
        decoded = decode_fringes(frames, case.plan)
        points = screen_points(decoded)
        row = [case.words, str(case.plan.count)]
        if len(points.pixels):
            errors = place_errors(points, case.camera, SCREEN)
            row += [f"{errors.rms_px:.4f}", f"{errors.sigma_px:.4f}", f"{errors.deviation:.2f}"]
        else:
            row.append("no point")
        table.add_row(*row)
    Console(width=80).print(table)


if __name__ == "__main__":
    main()
