"""The verdict on a calibration, as data: a grade of trust, its reasons, the suspected numbers, and
the next command.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from html import escape

MAPS_HOLD = "You can use the maps. Take care with the numbers."


class Trust(Enum):
    """Grades of trust, from good to bad."""

    TRUSTED = "trusted"
    CARE = "care"
    DO_NOT_USE = "do_not_use"

    @property
    def sentence(self) -> str:
        return {
            Trust.TRUSTED: "You can trust this calibration where the board was in the picture.",
            Trust.CARE: "Take care before you trust it.",
            Trust.DO_NOT_USE: "Do not use it.",
        }[self]

    @property
    def gravity(self) -> int:
        return list(Trust).index(self)


def uncapitalised(sentence: str) -> str:
    """Return a sentence as reasons have it, which follow a dash."""
    return sentence[0].lower() + sentence[1:]


@dataclass(frozen=True, slots=True)
class Reason:
    """A reason against trusting a calibration."""

    sentence: str
    """The sentence, without a capital, with a full stop."""
    next: str
    """The command to type next, quoted for a shell."""
    suspects: tuple[str, ...] = ()
    """Suspected numbers, by the names of `calib.fitting.declared`, or effects."""
    word: Trust = Trust.CARE
    maps_hold: bool = False
    """True if the maps hold all the same: their sigma includes it."""

    @property
    def capitalised(self) -> str:
        """The sentence with a capital, unless it begins with a name such as cover.thickness."""
        first = self.sentence.split()[0]
        return self.sentence if "." in first else self.sentence[0].upper() + self.sentence[1:]


NEXT = "Next"
"""The label of the next command."""
REFIT = "calib fit "
"""The beginning of a next command that fits again."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on a calibration."""

    reasons: tuple[Reason, ...]
    """Empty for a trusted calibration."""
    use: str
    """The command that puts a trusted calibration to use."""
    further: tuple[str, ...] = ()
    """Further commands for a usable calibration: evaluate, diagnose, undistort."""
    notes: tuple[str, ...] = ()
    """Sentences, without a capital, that change no grade, on effects that the views do not tell
    apart.
    """
    is_tested: bool = False
    """True if the fit was tested on views that it left out (`--folds`)."""

    @property
    def word(self) -> Trust:
        """The worst grade of the reasons."""
        return self._gravest.word if self._gravest else Trust.TRUSTED

    @property
    def headline(self) -> str:
        """The sentence of the grade; another one if the maps hold all the same."""
        return MAPS_HOLD if self.reasons and self.maps_hold else self.word.sentence

    @property
    def maps_hold(self) -> bool:
        """True if no reason is about the maps: they are as sure as they say."""
        return all(reason.maps_hold for reason in self.reasons)

    @property
    def suspects(self) -> tuple[str, ...]:
        """The suspects without repetition, those of graver reasons first."""
        ordered = sorted(self.reasons, key=lambda reason: -reason.word.gravity)
        return tuple(dict.fromkeys(name for reason in ordered for name in reason.suspects))

    @property
    def next(self) -> str:
        """The command of the first of the gravest reasons."""
        return self._gravest.next if self._gravest else self.use

    @property
    def to_correct(self) -> tuple[str, ...]:
        """The suspects of the gravest reason, if the next step is to correct them and fit again."""
        is_refit = self.next.startswith(REFIT)
        return self._gravest.suspects if self._gravest and is_refit else ()

    @property
    def next_label(self) -> str:
        """The words before the next command. A fit that is repeated unchanged gives the same, so
        the gravest reason, which says what to change, comes first.
        """
        return f"{NEXT}, once that is done" if self.next.startswith(REFIT) else NEXT

    def labelled_commands(self, further: Sequence[str]) -> list[tuple[str, str]]:
        """Return the commands to type, in order, each with its label. The test of a trusted
        calibration comes first.

        Args:
            further: commands that use the calibration, the test first; left out where the verdict
                forbids its use.
        """
        is_usable = self.word is not Trust.DO_NOT_USE
        commands = [command for command in further if is_usable and command != self.next]
        lines = [(self.next_label, self.next)]
        if self.word is Trust.TRUSTED and commands:
            lines.insert(0, ("Test", commands.pop(0)))
        return lines + [("Then", command) for command in commands]

    @property
    def _gravest(self) -> Reason | None:
        return max(self.reasons, key=lambda reason: reason.word.gravity, default=None)

    def as_json(self) -> dict[str, object]:
        """Return the JSON object of the command contract."""
        return {
            "word": self.word.value,
            "maps_hold": self.maps_hold,
            "reasons": [reason.sentence for reason in self.reasons],
            "suspects": list(self.suspects),
            "next": self.next,
            "notes": list(self.notes),
        }

    @property
    def sentences(self) -> list[str]:
        """The grade and the reasons, without commands."""
        return [self.headline, *(reason.capitalised for reason in self.reasons)]

    def __str__(self) -> str:
        return " ".join(self.sentences)

    def _repr_html_(self) -> str:
        """Return the grade, the reasons and the next command, which a notebook shows."""
        reasons = "".join(f"<li>{escape(sentence)}</li>" for sentence in self.sentences[1:])
        notes = "".join(f"<p>Note: {escape(note)}</p>" for note in self.notes)
        return (
            f"<p><b>{escape(self.headline)}</b></p><ul>{reasons}</ul>{notes}"
            f"<p>{self.next_label}: <code>{escape(self.next)}</code></p>"
        )
