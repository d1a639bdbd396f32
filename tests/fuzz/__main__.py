"""Spoils every kind of input, and looks at what is said: python -m tests.fuzz --cases 20000.

A seed gives the same cases every time. What is no sentence of ours, is longer than 400 characters,
takes more than 10 s of work, or warns is printed with how to repeat it, and the exit code is 1.
--deep asks for a report and an export of every spoilt calibration that could
still be read: seconds each.
"""

import argparse
import os
import sys
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch

from tests.fuzz.cases import Bench, Kind, each_of, spoil
from tests.fuzz.limits import Hang, Limits

SAID_EVERY_S = 10.0
"""The interval between two lines about the progress of a run."""


@dataclass
class Tally:
    """The outcome of the cases of one kind."""

    kind: Kind
    seed: int
    wanted: int
    tried: int = 0
    refused: int = 0
    seconds: float = 0.0
    """The seconds of work."""
    slowest: float = 0.0
    wrong: Counter[str] = field(default_factory=Counter)
    """The wrong outcomes, by their place in the code."""
    examples: dict[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        counts = f"{self.tried:7} cases {self.refused:7} refused {self.wrong.total():5} wrong"
        return (
            f"{self.kind.name:32}{counts} {self.seconds:8.1f} s of work, {self.slowest:5.2f} s at"
            " most"
        )

    def explained(self) -> str:
        """Each way in which cases went wrong, with the first of them, and how to repeat it."""
        lines = [
            f"{count:6}  {key}\n        {str(self.examples[key])[:300]!r}"
            for key, count in self.wrong.most_common()
        ]
        return "\n".join(
            [
                *lines,
                (
                    f"        python -m tests.fuzz --seed {self.seed} --cases {self.wanted} --kind"
                    f" '{self.kind.name}'"
                ),
            ]
        )


def fuzz(kind: Kind, cases: int, seed: int, limits: Limits) -> Tally:
    tally = Tally(kind, seed, cases)
    spoken = time.monotonic()

    def each(value: Any) -> None:
        nonlocal spoken
        start_time = time.process_time()
        try:
            with limits, warnings.catch_warnings(action="error"):
                tally.refused += spoil(kind, value)
        except (Exception, Hang) as error:
            trace = [
                frame
                for frame in traceback.extract_tb(error.__traceback__)
                if "/calib/" in frame.filename
            ]
            place = f"{Path(trace[-1].filename).name}:{trace[-1].lineno}" if trace else "here"
            key = f"{kind.name}: {type(error).__name__} at {place}: {str(error)[:200]!r}"
            tally.wrong[key] += 1
            tally.examples.setdefault(key, value)
        spent = time.process_time() - start_time
        tally.tried, tally.seconds, tally.slowest = (
            tally.tried + 1,
            tally.seconds + spent,
            max(tally.slowest, spent),
        )
        if time.monotonic() - spoken > SAID_EVERY_S:
            spoken = time.monotonic()
            print(f"{kind.name}: {tally.tried} of {cases}", file=sys.stderr, flush=True)

    each_of(kind, cases, each, seed)
    return tally


def silence_libraries() -> None:
    """libjpeg and libpng write a line per spoilt picture to the descriptor itself; Python's own
    stderr stays.
    """
    sys.stderr = os.fdopen(os.dup(2), "w", buffering=1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--cases",
        type=int,
        default=20_000,
        help="in all; kinds have equal shares (default %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, help="default %(default)s")
    parser.add_argument("--kind", default="", help="only kinds with this in their name")
    parser.add_argument("--deep", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.deep:
        os.environ["FUZZ_DEEP"] = "1"
    tallies: list[Tally] = []
    with TemporaryDirectory() as folder:
        known_kinds = Bench(Path(folder)).kinds
        kinds = [kind for kind in known_kinds if args.kind in kind.name]
        if not kinds:
            parser.error(
                f"no kind has {args.kind!r} in its name; there are:"
                f" {'; '.join(kind.name for kind in known_kinds)}"
            )
        silence_libraries()
        limits = Limits(deep=args.deep)
        for place, kind in enumerate(kinds):
            remaining = args.cases - sum(tally.tried for tally in tallies)
            tallies.append(
                fuzz(kind, max(1, -(-remaining // (len(kinds) - place))), args.seed, limits)
            )
            print(tallies[-1], flush=True)
    wrong = [tally for tally in tallies if tally.wrong]
    for tally in wrong:
        print(tally.explained())
    tried = sum(tally.tried for tally in tallies)
    refused = sum(tally.refused for tally in tallies)
    seconds = sum(tally.seconds for tally in tallies)
    print(
        f"seed {args.seed}, {tried} cases of {len(tallies)} kinds in {seconds:.0f} s of work:"
        f" {refused} refused in a sentence, {sum(tally.wrong.total() for tally in wrong)} went"
        f" wrong, in {sum(len(tally.wrong) for tally in wrong)} ways"
    )
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
