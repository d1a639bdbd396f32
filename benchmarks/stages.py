"""Where the time of `calib fit` and `calib diagnose` goes: `python -m benchmarks.stages SESSION`.

Each figure is the processor's time of this process in one stage, under Python's profiler, which
adds a fifth to a third. Stages that are set in are parts of the one above them. Figures "in all"
are parts of several stages. What no line names is the rest.
"""

import argparse
import cProfile
import pstats
import time
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.table import Table

from calib.cli import main as calib
from calib.threads import single_thread

FIT = {
    "imports": ("_bootstrap>", "_find_and_load"),
    "lens, for unknown intrinsics": ("intrinsics/calibrate.py", "calibrate_bare"),
    "  OpenCV's fits": ("", "<calibrateCameraExtended>"),
    "fit": ("fitting/stages.py", "fit_stages"),
    "boards turned by half a turn": ("fitting/half_turns.py", "find"),
    "sigma that counts views": ("fitting/fit_result.py", "count_views"),
    "verdict": ("verdict/judge.py", "judge"),
    "report, with its verdict": ("report/write.py", "write_report"),
}
DIAGNOSIS = {
    "search": ("diagnosis/search.py", "run_search"),
    "families": ("diagnosis/equivalence.py", "find_families"),
    "report, with its verdict": ("report/write.py", "write_report"),
    "joint fits, in all": ("estimation/joint_fit.py", "fit_joint"),
    "what differs between views, in all": ("inference/view_variation.py", "find_variations"),
    "held-out views, in all": ("inference/cross_validation.py", "hold_out"),
    "score tests, in all": ("inference/score_test.py", "score_tests"),
}
"""The file and the function of each stage; a built-in function has no file."""
Stages = dict[str, tuple[str, str]]


def seconds(arguments: list[str]) -> dict[tuple[str, str], float]:
    """Return the processor's s in each function of a command, by its file and name."""
    profile = cProfile.Profile(time.process_time)
    start = time.process_time()
    with single_thread(), redirect_stdout(StringIO()):
        code = profile.runcall(calib, arguments)
    if code:
        raise SystemExit(code)
    entries = pstats.Stats(profile).stats.items()  # type: ignore[attr-defined]
    times = {(place[0], place[2]): entry[3] for place, entry in entries}
    return {**times, ("", ""): time.process_time() - start}


def table_of(title: str, stages: Stages, times: dict[tuple[str, str], float]) -> Table:
    """Return the table of a command."""
    table = Table("stage", "s", title=f"{title}: {times['', '']:.1f} s")
    for name, (file, function) in stages.items():
        if spent := sum(t for (f, n), t in times.items() if n == function and f.endswith(file)):
            table.add_row(name, f"{spent:.1f}")
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("session", help="a session's folder")
    session = parser.parse_args().session
    console = Console(highlight=False)
    with TemporaryDirectory() as folder:
        fitted, diagnosed = str(Path(folder) / "fitted"), str(Path(folder) / "diagnosed")
        fit = seconds(["fit", session, "-o", fitted, "--quiet"])
        console.print(table_of("calib fit", FIT, fit))
        diagnose = seconds(["diagnose", fitted, "-o", diagnosed, "--quiet"])
        console.print(table_of("calib diagnose", DIAGNOSIS, diagnose))


if __name__ == "__main__":
    main()
