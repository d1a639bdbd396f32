"""The options of a fit that `calib fit` and `calib batch` share."""

import argparse
from typing import TYPE_CHECKING

from calib.commands.arguments import Options, folds, free, grid, steps

if TYPE_CHECKING:
    from calib.fit_record.request import Settings


def add_fit_options(parser: Options, *, default_folds: int = 0) -> None:
    parser.add_argument(
        "--method",
        choices=["joint", "paper"],
        default="joint",
        help=(
            "how to fit: all numbers together, or step by step as in docs/paper.md (default:"
            " %(default)s)"
        ),
    )
    parser.add_argument(
        "--grid",
        type=grid,
        default=(12, 12),
        metavar="AxB",
        help=(
            "model uneven glass by A centres around the cover and B along it (default: 12x12);"
            " auto: choose by the error on held-out views; 1x1: even glass"
        ),
    )
    parser.add_argument(
        "--free",
        type=free,
        default=("auto",),
        metavar="auto|all|none|NAME,...",
        help=(
            "declared numbers to estimate. auto (the default): all, but if an estimate leaves its"
            " tolerance only those with a sigma, unless the pictures favour the estimates; all: all"
            " in any case; none: only those with a sigma; or some of radius, slope, offset, centre,"
            " distance, tilt, thickness, index, intrinsics. auto and all leave exact numbers as"
            " they are"
        ),
    )
    default = f" (default: {default_folds})" if default_folds else ""
    help_text = f"cross-validate over the views, and say if the fit overfits{default}"
    parser.add_argument(
        "--folds", type=folds, default=default_folds, metavar="COUNT", help=help_text
    )
    parser.add_argument(
        "--steps",
        type=steps,
        default=1000,
        metavar="COUNT",
        help="gradient steps of --method paper (default: 1000)",
    )
    parser.add_argument(
        "--neglect-shift",
        action="store_true",
        help="let uneven glass tilt the surface only and not move it, as in docs/paper.md",
    )


def settings_of(args: argparse.Namespace) -> "Settings":
    from calib.fit_record.request import Settings

    return Settings(
        args.method, args.grid, args.steps, not args.neglect_shift, args.free, args.folds
    )
