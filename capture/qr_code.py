"""A QR code in a terminal, for a phone's camera: black on white whatever the terminal's colours,
two modules per character.
"""

from itertools import zip_longest

import segno

# modules of white around the code: half of what the standard asks, and enough for phones
BORDER = 2
INK = "\x1b[30;107m"
PLAIN = "\x1b[0m"
LETTERS = {(0, 0): " ", (1, 0): "▀", (0, 1): "▄", (1, 1): "█"}


def qr_code(text: str) -> str:
    """Return the QR code of a text, as lines of half blocks."""
    rows = [
        list(row) for row in segno.make(text, error="L", micro=False).matrix_iter(border=BORDER)
    ]
    pairs = zip_longest(rows[::2], rows[1::2], fillvalue=[0] * len(rows[0]))
    return "\n".join(
        f"{INK}{''.join(LETTERS[modules] for modules in zip(*pair_of_rows, strict=True))}{PLAIN}"
        for pair_of_rows in pairs
    )
