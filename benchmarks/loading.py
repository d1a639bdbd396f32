"""What commands load, over `import torch`: `python -m benchmarks.loading`.

`calib fit` of a folder that does not exist imports all that a fit needs; `calib export` writes the
maps of one depth as well. Each figure is the processor's time of a whole process, the least of
several that alternate. Compiled modules are kept, as an installed program keeps them.
"""

import os
import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.table import Table

RUNS = 5
SESSION = "fixtures/clean"


def processor_seconds(arguments: list[str]) -> float:
    """The processor's s of a process, whatever its exit code."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    start = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, check=False)
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    return end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime


def main() -> None:
    with TemporaryDirectory() as folder:
        calibrated = str(Path(folder) / "calibrated")
        calib = ["-m", "calib"]
        subprocess.run(
            [sys.executable, *calib, "fit", SESSION, "-o", calibrated, "--quiet"],
            capture_output=True,
            check=True,
        )
        maps = str(Path(folder) / "maps")
        export = ["export", calibrated, "--format", "npz", "--depth", "0.5", "-o", maps]
        programs = {
            "import torch": ["-c", "import torch"],
            "calib fit, imports only": [*calib, "fit", str(Path(folder) / "none")],
            "calib export of one depth": [*calib, *export, "--overwrite"],
        }
        seconds = {
            name: min(times)
            for name, times in zip(
                programs,
                zip(
                    *(
                        [processor_seconds(program) for program in programs.values()]
                        for _ in range(RUNS)
                    ),
                    strict=True,
                ),
                strict=True,
            )
        }
    table = Table("process", "processor s", "over torch")
    for name, time in seconds.items():
        table.add_row(name, f"{time:.2f}", f"{time / seconds['import torch']:.2f}")
    Console().print(table)


if __name__ == "__main__":
    main()
