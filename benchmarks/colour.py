"""Lateral colour behind an acrylic window under water, before and after `calib undistort --colour`:
`python -m benchmarks.colour`.

The rendered session fixtures/colour is fitted. Its pictures are straightened at the depth of their
board, with one index for all colours and with an index for each channel. Lateral colour is the
distance of a corner in the red picture from the same corner in the blue one, where the detector
finds them; of the pictures as they were taken it is also the truth, and the prediction.
"""

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.commands.console import Bars
from fixtures.lateral_colour import measure, summary


def main() -> None:
    with Bars() as bars:
        colour = measure(bars)
    table = Table("red from blue, px", "RMS", "largest", "corners", title="Lateral colour")
    for words, shift in (
        ("as taken, truth", colour.true),
        ("as taken, predicted by the calibration", colour.predicted),
        ("as taken, corners found", colour.taken),
        ("straight, one index for all colours", colour.single),
        ("straight, --colour", colour.channels),
    ):
        rms, largest = summary(shift)
        table.add_row(words, f"{rms:.3f}", f"{largest:.3f}", str(np.isfinite(shift).all(-1).sum()))
    Console().print(table)


if __name__ == "__main__":
    main()
