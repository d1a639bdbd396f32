"""The processor time of a report: `python -m benchmarks.report [SESSION]`.

It fits the session (default: fixtures/clean, 24 views), judges it as `calib fit` does in any case,
and prints the CPU seconds of the report: its import, the first one, which is what `calib fit` pays,
and the median of five more.
"""

import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from calib.fitting.fit import fit
from calib.io.file_set import FileSet
from calib.progress import Silent
from calib.verdict.judge import judge

BAR_S = 0.4
"""The CPU seconds that a report of 24 views may take."""


def main(session: str) -> None:
    calibration = fit(session)
    with TemporaryDirectory() as folder:
        calibration.save(folder)
        judge(calibration)
        start_time = time.process_time()
        from calib.report.write import write_report

        import_s = time.process_time() - start_time
        seconds = []
        for _ in range(6):
            start_time = time.process_time()
            with FileSet(Path(folder)) as files:
                path = write_report(calibration, files, Silent())
                files.commit()
            seconds.append(time.process_time() - start_time)
        print(
            f"{len(calibration.views)} views: import {import_s:.2f} s, first report"
            f" {seconds[0]:.2f} s, later ones {median(seconds[1:]):.2f} s (bar {BAR_S} s);"
            f" {path.stat().st_size / 1e6:.2f} MB"
        )


if __name__ == "__main__":
    main(*(sys.argv[1:] or ["fixtures/clean"]))
