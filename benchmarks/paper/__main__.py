"""Make the paper's figures and table again, and print the paper's numbers beside ours.

table1 needs `pip install -e '.[render]'`: its pictures are rendered once into out/.
"""

import argparse
from importlib import import_module
from pathlib import Path

import matplotlib

from calib.commands.console import Bars
from calib.threads import single_thread

PARTS = ("fig4a", "fig4b", "fig7", "fig8", "table1")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper", description=__doc__)
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"all of them by default: {', '.join(PARTS)}"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("docs/paper"),
        help="for PART.txt and PART.svg; by default docs/paper",
    )
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"no part named {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    matplotlib.rcParams["svg.hashsalt"] = "refracal"  # the same bytes every time
    options.output.mkdir(parents=True, exist_ok=True)
    with single_thread(), Bars() as bars:
        for name in PARTS:
            if options.parts and name not in options.parts:
                continue
            result = import_module(f"benchmarks.paper.{name}").run(bars)
            print(result.text, end="\n\n")
            (options.output / f"{name}.txt").write_text(result.text + "\n")
            if result.figure:
                result.figure.savefig(options.output / f"{name}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
