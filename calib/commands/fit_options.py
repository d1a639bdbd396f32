"""The options of a fit that `calib fit` and `calib batch` share."""

import argparse
from typing import TYPE_CHECKING

from calib.commands.arguments import folds, free, grid, steps

if TYPE_CHECKING:
    from calib.fitting.stages import Settings


def add_fit_options(parser: argparse.ArgumentParser, *, usual_folds: int = 0) -> None:
    parser.add_argument(
        "--method",
        choices=["joint", "paper"],
        default="joint",
        help="how to fit (default: %(default)s)",
    )
    parser.add_argument(
        "--grid",
        type=grid,
        default=(12, 12),
        metavar="AxB",
        help=(
            "centres of the relief, around and along the cover (default: 12x12); auto chooses by"
            " held-out error"
        ),
    )
    parser.add_argument(
        "--free",
        type=free,
        default=("auto",),
        metavar="auto|all|none|NAME,...",
        help=(
            "which declared numbers to estimate, near what the session says: all, none, or some of"
            " radius, slope, offset, centre, distance, tilt, thickness, index, intrinsics (default:"
            " all but those it calls exact, where the views ask for it)"
        ),
    )
    said = f" (default: {usual_folds})" if usual_folds else ""
    help_text = f"cross-validate over the views, and say if the fit overfits{said}"
    parser.add_argument("--folds", type=folds, default=usual_folds, metavar="N", help=help_text)
    parser.add_argument(
        "--steps",
        type=steps,
        default=1000,
        metavar="N",
        help="gradient steps of the paper's method (default: 1000)",
    )
    parser.add_argument(
        "--neglect-shift",
        action="store_true",
        help="let the relief bend the normal only, as the paper does",
    )


def settings_of(args: argparse.Namespace) -> "Settings":
    from calib.fitting.stages import Settings

    return Settings(
        args.method, args.grid, args.steps, not args.neglect_shift, args.free, args.folds
    )
