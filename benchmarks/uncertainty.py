"""Whether the maps are as sure as they say: `python -m benchmarks.uncertainty [--repeats 50]`.

Each repeat draws new glass, new board poses and new noise, calibrates, and compares the undistorted position of pixels near the training
corners with that of the true rays, after the rigid motion of all rays that fits best at the training corners. A ratio of error to
predicted sigma with a root mean square of 1 is honest; above, the prediction is too small.
"""

import argparse

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from calib.fitting.stages import Settings
from calib.threads import single_thread
from fixtures.calibrated import GLASS, calibrate
from fixtures.map_errors import DEPTHS, errors
from fixtures.synthetic import scene


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=50)
    repeats = parser.parse_args().repeats
    table = Table("glass", *(f"{depth} m: error, predicted px; ratio" for depth in DEPTHS), "ratio in all")
    with single_thread():
        for bumps, amplitude in ((4, 1e-5), (10, 1e-5)):
            squares = np.zeros((len(DEPTHS), 3))
            for seed in track(range(100, 100 + repeats), f"{bumps}x{bumps} bumps"):
                made = scene(seed, 20, (bumps, bumps), amplitude, 0.1, cover=GLASS)
                for row, (error, sigma) in zip(squares, errors(made, calibrate(made, Settings())), strict=True):
                    row += np.mean(error**2), np.mean(sigma**2), np.mean((error / sigma) ** 2)
            roots = np.sqrt(squares / repeats)
            cells = (f"{error:.3f}, {sigma:.3f}; {ratio:.2f}" for error, sigma, ratio in roots)
            table.add_row(f"{bumps}x{bumps}, {amplitude:g} m", *cells, f"{np.sqrt((roots[:, 2] ** 2).mean()):.2f}")
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
