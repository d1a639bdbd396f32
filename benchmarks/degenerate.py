"""Sessions that say too little: is a calibration of them refused, or its sigma honest, or is it at
least not called trusted?

`python -m benchmarks.degenerate [--bare 120] [--covered 40] [--first 5000]`: so many random
sessions of each kind, of simulated corners. A calibration is wrong where it is more than five of
its own standard deviations from the truth: in any of fx, fy, cx and cy without a cover, in the maps
near the training corners behind one (the root mean square over pixels and depths). The thresholds
of `calib` were chosen on other seeds, below 5000.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.progress import track
from rich.table import Table

from calib.calibration import Calibration
from calib.errors import RefracalError
from calib.threads import single_thread
from calib.verdict.judge import judge
from fixtures.degenerate import KINDS, WRONG, Shown, bare_session, calibration_of, covered_session
from fixtures.map_errors import error_over_sigma


@dataclass(frozen=True)
class Outcome:
    """Of one session."""

    kind: str
    seed: int
    word: str
    """The verdict's; "refused", "crashed" or "unreadable"."""
    deviation: float
    """Standard deviations from the truth; NaN where there is no calibration."""
    remarks: str
    """Reasons, or the error."""

    @property
    def wrong(self) -> bool:
        """Also where the sigma is not a number."""
        return self.word not in ("refused", "crashed") and not self.deviation <= WRONG


def bare_errors(shown: Shown, result: Calibration) -> float:
    """The largest error of fx, fy, cx and cy, in standard deviations."""
    k = result.camera.intrinsics
    assert k
    return max(
        abs(n.value - true) / n.sigma
        for n, true in zip((k.fx, k.fy, k.cx, k.cy), shown.pinhole, strict=True)
    )


def covered_errors(shown: Shown, result: Calibration) -> float:
    """The maps' error over their sigma."""
    assert shown.scene
    return error_over_sigma(shown.scene, result)


def outcome(kind: str, seed: int, covered: bool) -> Outcome:
    warnings.simplefilter("ignore")
    shown = (covered_session if covered else bare_session)(kind, seed)
    with TemporaryDirectory() as folder, single_thread():
        try:
            estimate = calibration_of(shown, Path(folder))
            verdict = judge(estimate)
            deviation = (covered_errors if covered else bare_errors)(shown, estimate)
        except RefracalError as error:
            unreadable = (Path(folder) / "calibration").exists()
            return Outcome(
                kind, seed, "unreadable" if unreadable else "refused", float("nan"), str(error)
            )
        except Exception as error:
            return Outcome(kind, seed, "crashed", float("nan"), f"{type(error).__name__}: {error}")
    return Outcome(kind, seed, verdict.word.value, deviation, " | ".join(verdict.sentences[1:]))


def tabulated(result: list[Outcome], title: str) -> Table:
    table = Table(
        "kind",
        "sessions",
        "refused",
        "care, or do not use",
        "trusted",
        "wrong",
        "wrong and trusted",
        "crashed",
        title=title,
    )
    for kind in (*KINDS, "all"):
        matching = [item for item in result if kind in ("all", item.kind)]
        counts = (
            len(matching),
            sum(item.word == "refused" for item in matching),
            sum(item.word in ("care", "do_not_use") for item in matching),
            sum(item.word == "trusted" for item in matching),
            sum(item.wrong for item in matching),
            sum(item.wrong and item.word in ("trusted", "unreadable") for item in matching),
            sum(item.word in ("crashed", "unreadable") for item in matching),
        )
        table.add_row(kind, *map(str, counts))
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bare", type=int, default=120)
    parser.add_argument("--covered", type=int, default=40)
    parser.add_argument("--first", type=int, default=5000, help="the first seed")
    parser.add_argument("--workers", type=int, help="processes (default: one for every processor)")
    parser.add_argument("--all", action="store_true", help="print every session that is wrong")
    options = parser.parse_args()
    console = Console(width=160)
    for count, covered, title in (
        (options.bare, False, "without a cover"),
        (options.covered, True, "behind a cone"),
    ):
        drawn = [
            (kind, seed) for kind in KINDS for seed in range(options.first, options.first + count)
        ]
        if not drawn:
            continue
        with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
            ran = pool.map(partial(outcome, covered=covered), *zip(*drawn, strict=True))
            results: list[Outcome] = []
            for item in track(ran, title, total=len(drawn), console=Console(stderr=True)):
                results.append(item)
                if item.word in ("crashed", "unreadable") or (options.all and item.wrong):
                    console.print(
                        f"{item.kind} {item.seed}: {item.word}, {item.deviation:.1f}:"
                        f" {item.remarks[:300]}",
                        markup=False,
                    )
        console.print(tabulated(results, title))


if __name__ == "__main__":
    main()
