"""The size of a board, as --board takes it."""

import argparse

from calib.commands.arguments import quoted, two_numbers


def corner_counts(text: str) -> tuple[int, int]:
    """Return the columns and rows of a board that a person wrote as 9x6."""
    size = two_numbers(text)
    if size is None or min(size) < 2 or max(size) > 1000:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a board: write its inner corners as two whole numbers from 3,"
            " such as 9x6"
        )
    return size
