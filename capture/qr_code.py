"""A QR code in a terminal, for a phone's camera: black on white whatever the terminal's colours,
two modules a letter.
"""

from itertools import zip_longest

import segno

BORDER = 2  # modules of white around it: half of what the standard asks, and as much as phones need
INK = "\x1b[30;107m"
PLAIN = "\x1b[0m"
LETTERS = {(0, 0): " ", (1, 0): "▀", (0, 1): "▄", (1, 1): "█"}


def qr_code(text: str) -> str:
    """Lines of half blocks."""
    rows = [
        list(row) for row in segno.make(text, error="L", micro=False).matrix_iter(border=BORDER)
    ]
    pairs = zip_longest(rows[::2], rows[1::2], fillvalue=[0] * len(rows[0]))
    return "\n".join(
        f"{INK}{''.join(LETTERS[pair] for pair in zip(*both, strict=True))}{PLAIN}"
        for both in pairs
    )
