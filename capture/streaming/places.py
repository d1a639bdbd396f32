"""The texts that name the targets of a stream."""

from dataclasses import dataclass
from typing import Literal

from calib.errors import InputError, brief, meant
from calib.io.numerals import whole_number

TargetKind = Literal["v4l2", "http", "pipe", "window"]

EXAMPLES = "v4l2:/dev/video9, http, http:8081, - or window"
PORT = 8080
"""The port of http without a number."""


@dataclass(frozen=True, slots=True)
class TargetPlace:
    kind: TargetKind
    device: str = ""
    """The path of a loopback device."""
    port: int = PORT
    """The port of http; 0 stands for one that is free."""

    @property
    def fixed_size(self) -> bool:
        """True if a reader cannot take pictures of another size."""
        return self.kind in ("v4l2", "pipe")


def parse_place(text: str) -> TargetPlace:
    """Return the place that a text names; InputError if it names none."""
    kind, colon, place = text.partition(":")
    if text == "-":
        return TargetPlace("pipe")
    if kind == "v4l2" and place:
        return TargetPlace("v4l2", device=place)
    if kind == "http":
        port = whole_number(place) if colon else PORT
        if port is None or port > 65535:
            raise InputError(
                f"--to {brief(text)}: {brief(place)!r} is not a port: write a whole number up to"
                " 65535, such as http:8080."
            )
        return TargetPlace("http", port=port)
    if text == "window":
        return TargetPlace("window")
    if text.startswith("/dev/video"):
        return TargetPlace("v4l2", device=text)
    close = meant(kind, ("v4l2", "http", "window"))
    hint = f" (did you mean {close}?)" if close else ""
    raise InputError(f"--to {brief(text)} names no target{hint}: write {EXAMPLES}.")


def parse_places(texts: list[str]) -> tuple[TargetPlace, ...]:
    """Return the places of several texts; InputError if two of them exclude each other."""
    places = tuple(parse_place(text) for text in texts)
    kinds = [place.kind for place in places]
    if "window" in kinds and "pipe" in kinds:
        raise InputError("--to - and --to window both need stdout: leave one of them out.")
    for kind in ("window", "pipe", "http"):
        if kinds.count(kind) > 1:
            raise InputError(f"--to names {kind} twice: name it once.")
    return places
