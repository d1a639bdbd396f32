"""What a person reads while a screen is recorded: `python -m benchmarks.screen_capture`.

A page without a browser speaks as the real one does, and a simulated camera of 80x60 px photographs
it: noise of 2 grey levels, a blur of 1.5 px, gamma 2.2. The lines are those of `capture SESSION
--screen --serve`; behind each pose stands how far its points are off.
"""

import tempfile
from contextlib import ExitStack, chdir
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.fringes.decode import ScreenPoints
from fixtures.screen import ScreenCamera, place_errors
from fixtures.simulated_screen import (
    SCREEN,
    Light,
    SimulatedCamera,
    StandIn,
    Told,
    recording,
)

NEAR = ScreenCamera(width=80, height=60, jpeg=None)
CAMERAS = (NEAR, replace(NEAR, scale=2.4))


class Printed(list[str]):
    """Sentences that are printed as they come."""

    def append(self, sentence: str) -> None:
        """Print a sentence."""
        print(sentence.split(", in ")[0])


def main() -> None:
    camera = SimulatedCamera(light := Light(), CAMERAS)
    told = Told(Printed())
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        stack.enter_context(chdir(folder))
        session = Path("SESSION")
        poses = len(CAMERAS)
        opened = recording(session, camera, poses=poses, told=told, period=None)
        made, page = stack.enter_context(opened)
        stack.enter_context(StandIn(light).open(page.address))
        made.run()
        print()
        for number, pose in enumerate(CAMERAS):
            with np.load(session / "points" / f"{number:04d}.npz") as arrays:
                points = ScreenPoints(arrays["pixels"], arrays["target"], arrays["covariance"])
            errors = place_errors(points, pose, SCREEN)
            print(
                f"Pose {number + 1}: {len(points.pixels)} points, off by {errors.rms_px:.2f} px"
                f" where {errors.sigma_px:.2f} are predicted."
            )


if __name__ == "__main__":
    main()
