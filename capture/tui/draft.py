"""What was typed into the set-up: it is there again, however the program ended; of a session that
is described, its source and what is recorded now.
"""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

from calib.errors import InputError
from calib.io.files import read_file
from calib.session.cover import SHAPES
from capture.tui.form import BOARD, Typed

LARGEST = 1 << 16
"""bytes"""


@dataclass(frozen=True, slots=True)
class Draft:
    typed: Typed
    source: str
    like: str
    bare: bool | None = None
    """What is recorded now, where the person chose that."""


def keep(session: Path, draft: Draft) -> None:
    """Not waiting for the disk, as it is done at every key; where it cannot be written, it is not
    kept.
    """
    place = _place(session)
    with suppress(OSError, UnicodeError):
        place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        beside = place.with_suffix(f".{os.getpid()}")
        beside.write_text(json.dumps(asdict(draft)))
        beside.replace(place)


def kept(session: Path) -> Draft | None:
    """None where there is none, or one that this version cannot show."""
    try:
        said = json.loads(read_file(_place(session), LARGEST))
        typed = Typed(
            _texts(said["typed"]["board"]),
            said["typed"]["shape"],
            _texts(said["typed"]["cover"]),
            said["typed"]["kind"],
        )
        source, like, bare = said["source"], said["like"], said.get("bare")
    except (InputError, ValueError, LookupError, TypeError, RecursionError):
        return None
    known = (
        typed.shape in SHAPES
        and typed.kind in BOARD
        and isinstance(source, str)
        and isinstance(like, str)
        and (bare is None or isinstance(bare, bool))
    )
    return Draft(typed, source, like, bare) if known else None


def _place(session: Path) -> Path:
    home = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")  # noqa: PTH111 - without a home, it raises nothing
    return (
        Path(home)
        / "refracal"
        / "drafts"
        / f"{sha256(os.fsencode(os.path.realpath(session))).hexdigest()[:32]}.json"
    )


def _texts(said: Mapping[str, str]) -> dict[str, str]:
    if not all(isinstance(part, str) for entry in said.items() for part in entry):
        raise TypeError("not texts")
    return dict(said)
