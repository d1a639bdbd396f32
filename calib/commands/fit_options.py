"""The options of a fit that `calib fit` and `calib batch` share."""

import argparse
from typing import TYPE_CHECKING

from calib.commands.arguments import Options, effects, folds, free, grid, steps

if TYPE_CHECKING:
    from calib.fit_record.request import Settings

AUTO = ("auto",)
"""The effects of `--effects auto`: those that a diagnosis finds."""


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
            "model uneven glass by a grid of bumps, A around the cover and B along it (default:"
            " 12x12); auto: choose by the error on held-out views; 1x1: even glass"
        ),
    )
    parser.add_argument(
        "--free",
        type=free,
        default=("auto",),
        metavar="auto|all|none|NAME,...",
        help=(
            "declared numbers to estimate. all: every number that is not exact; none: those with a"
            " sigma only; NAME,...: some of radius, slope, offset, centre, distance, tilt,"
            " thickness, index, intrinsics; auto (the default): all; or none, if an estimate leaves"
            " its tolerance and the pictures do not clearly favour it"
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


def add_effects(parser: Options, help_text: str) -> None:
    """Add `--effects`, which only some commands have."""
    parser.add_argument("--effects", type=effects, metavar="none|auto|NAME,...", help=help_text)


def effects_of(args: argparse.Namespace) -> tuple[str, ...]:
    """Return the names of the effects to add; AUTO for a diagnosis."""
    names: tuple[str, ...] = args.effects or ()
    return names


def settings_of(args: argparse.Namespace) -> "Settings":
    from calib.fit_record.request import Settings

    return Settings(
        method=args.method,
        grid=args.grid,
        steps=args.steps,
        exact_hit=not args.neglect_shift,
        free=args.free,
        folds=args.folds,
        flat_board=_takes_flat_board(getattr(args, "effects", None)),
    )


def _takes_flat_board(names: tuple[str, ...] | None) -> bool:
    """Return True if the fit takes the board as flat: with no effect at all, or with a bend that is
    requested and added later. Other effects are added to a fit with the board's bend.
    """
    if not names:
        return names is not None
    from calib.effects.board_shape import BoardShape

    return BoardShape.name in names
