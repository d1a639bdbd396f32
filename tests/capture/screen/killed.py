"""A recording of a simulated screen that somebody else kills: `python -m
tests.capture.screen.killed SESSION POSES`. It prints the number of each pattern that is shown.
"""

import sys
from pathlib import Path

from capture.screen.pitch import known_pitch
from fixtures.screen import ScreenCamera
from fixtures.simulated_screen import (
    PITCH,
    Light,
    SimulatedCamera,
    StandIn,
    Told,
    recording,
)


def main() -> None:
    folder, poses = Path(sys.argv[1]), int(sys.argv[2])
    camera = SimulatedCamera(light := Light(), [ScreenCamera(width=80, height=60, jpeg=None)])
    page_without_browser = StandIn(light, lambda number: print(number, flush=True))
    pitch = known_pitch(1000 * PITCH)
    with (
        recording(folder, camera, poses=poses, told=Told(), pitch=pitch) as (made, page),
        page_without_browser.open(page.address),
    ):
        made.run()


if __name__ == "__main__":
    main()
