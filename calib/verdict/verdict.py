"""What is to be thought of a calibration, as data: a word, the reasons for it, whom they suspect,
and the next command to type.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Word(Enum):
    """From good to bad."""

    TRUSTED = "trusted"
    CARE = "care"
    DO_NOT_USE = "do_not_use"

    @property
    def sentence(self) -> str:
        return {
            Word.TRUSTED: "To be trusted where it has corners.",
            Word.CARE: "Take care before you trust it.",
            Word.DO_NOT_USE: "Do not use it.",
        }[self]

    @property
    def gravity(self) -> int:
        return list(Word).index(self)


@dataclass(frozen=True, slots=True)
class Reason:
    """One thing that speaks against a calibration."""

    sentence: str
    """Without a capital, with its full stop."""
    next: str
    """The command to type next, quoted for a shell."""
    suspects: tuple[str, ...] = ()
    """What may be wrong, by the names of `calib.fitting.declared` or of an effect."""
    word: Word = Word.CARE


@dataclass(frozen=True, slots=True)
class Verdict:
    """All of it."""

    reasons: tuple[Reason, ...]
    """None for a calibration that is to be trusted."""
    use: str
    """The command that puts a trusted calibration to use."""
    further: tuple[str, ...] = ()
    """Commands that go on from any calibration that may be used: evaluate, diagnose, undistort."""

    @property
    def word(self) -> Word:
        """The worst of the reasons'."""
        return self._gravest.word if self._gravest else Word.TRUSTED

    @property
    def suspects(self) -> tuple[str, ...]:
        """Each once, those of graver reasons first."""
        ordered = sorted(self.reasons, key=lambda reason: -reason.word.gravity)
        return tuple(dict.fromkeys(name for reason in ordered for name in reason.suspects))

    @property
    def next(self) -> str:
        """Of the first of the gravest reasons."""
        return self._gravest.next if self._gravest else self.use

    @property
    def _gravest(self) -> Reason | None:
        return max(self.reasons, key=lambda reason: reason.word.gravity, default=None)

    def as_json(self) -> dict[str, object]:
        """The contract's object."""
        return {
            "word": self.word.value,
            "reasons": [reason.sentence for reason in self.reasons],
            "suspects": list(self.suspects),
            "next": self.next,
        }

    @property
    def sentences(self) -> list[str]:
        """The word and the reasons, without what to type."""
        return [self.word.sentence, *(_capitalised(reason.sentence) for reason in self.reasons)]

    def __str__(self) -> str:
        return " ".join(self.sentences)


def _capitalised(sentence: str) -> str:
    """Names stay as they are written."""
    first = sentence.split()[0]
    return sentence if "." in first else sentence[0].upper() + sentence[1:]
