"""Spoils every kind of input, and looks at what is said: python -m tests.fuzz --cases 20000.

The cases are the same every time. What is no sentence of ours, takes more than 10 s, or warns is printed with how to repeat it, and the
exit code is 1. --deep asks for a report and an export of every spoilt calibration that could still be read: seconds each.
"""

import argparse
import os
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch

from tests.fuzz.cases import Bench, Kind, each_of, spoil

HANG_S = 10
DEEP_HANG_S = 100
"""A report, an export and a verdict, on a busy machine."""


class Hang(BaseException):
    """A case that took too long."""


@contextmanager
def limited() -> Iterator[None]:
    def stop(_number: int, _frame: object) -> None:
        raise Hang

    signal.signal(signal.SIGALRM, stop)
    signal.alarm(DEEP_HANG_S if os.environ.get("FUZZ_DEEP") else HANG_S)
    try:
        yield
    finally:
        signal.alarm(0)


def fuzz(kind: Kind, cases: int, found: Counter[str], examples: dict[str, object]) -> int:
    """How many cases there were; what went wrong is counted by the place in the code."""
    tried = 0

    def each(value: Any) -> None:
        nonlocal tried
        tried += 1
        try:
            with limited(), warnings.catch_warnings(action="error"):
                spoil(kind, value)
        except (Exception, Hang) as error:
            trace = [frame for frame in traceback.extract_tb(error.__traceback__) if "/calib/" in frame.filename]
            place = f"{Path(trace[-1].filename).name}:{trace[-1].lineno}" if trace else "here"
            key = f"{kind.name}: {type(error).__name__} at {place}: {str(error)[:200]!r}"
            found[key] += 1
            examples.setdefault(key, value)

    each_of(kind, cases, each)
    return tried


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--kind", default="", help="only kinds with this in their name")
    parser.add_argument("--deep", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.deep:
        os.environ["FUZZ_DEEP"] = "1"
    found: Counter[str] = Counter()
    examples: dict[str, object] = {}
    with TemporaryDirectory() as folder:
        kinds = [kind for kind in Bench(Path(folder)).kinds if args.kind in kind.name]
        tried = 0
        for kind in kinds:
            begun = time.monotonic()
            count = fuzz(kind, -(-args.cases // len(kinds)), found, examples)
            tried += count
            print(f"{kind.name:32}{count:7} cases {time.monotonic() - begun:8.1f} s", flush=True)
    for key, count in found.most_common():
        print(f"{count:6}  {key}\n        {str(examples[key])[:300]!r}")
    print(f"{tried} cases: {sum(found.values())} went wrong, in {len(found)} ways")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
