"""Words of the reasons and notes that doubt a unit. A fleet's page finds these by them."""

from collections.abc import Iterable

BOARD_UNIT = "whose unit is the millimetre"
COVER_UNIT = "lengths are in millimetres"
TARGET_UNIT = "the target's coordinates, which are metres"
UNIT_WORDS = (BOARD_UNIT, COVER_UNIT, TARGET_UNIT)


def unit_doubts(sentences: Iterable[str]) -> tuple[str, ...]:
    """Return the sentences of a verdict that doubt the unit of a declared length."""
    return tuple(text for text in sentences if any(words in text for words in UNIT_WORDS))
