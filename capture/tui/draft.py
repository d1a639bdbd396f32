"""The draft of a set-up: the typed texts survive, however the program ends. Of a described session,
the draft keeps the source and the recorded phase.
"""

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

from calib.errors import InputError
from calib.io.files import read_file
from calib.session.board_section import UNUSUAL
from calib.session.shapes.registry import stated_shape_names
from capture.tui.form import BOARD, FormTexts

MAX_BYTES = 1 << 16
"""The maximum size of a draft, bytes."""


@dataclass(frozen=True, slots=True)
class Draft:
    typed: FormTexts
    source: str
    like: str
    bare: bool | None = None
    """The recorded phase, if the person chose it."""


def save_draft(session: Path, draft: Draft) -> None:
    """Save a draft. It does not wait for the disk, because it runs at every key. A draft that
    cannot be written is not kept.
    """
    path = _draft_path(session)
    with suppress(OSError, UnicodeError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        temporary = path.with_suffix(f".{os.getpid()}")
        temporary.write_text(json.dumps(asdict(draft)))
        temporary.replace(path)


def load_draft(session: Path) -> Draft | None:
    """Return the draft; None where there is none, or one that this version cannot show."""
    try:
        document = json.loads(read_file(_draft_path(session), MAX_BYTES))
        texts = FormTexts(
            _check_texts(document["typed"]["board"]),
            document["typed"]["shape"],
            _check_texts(document["typed"]["cover"]),
            document["typed"]["kind"],
            _check_covers(document["typed"].get("outer", [])),
            _check_unusual(document["typed"].get("unusual", {})),
        )
        source, like, bare = document["source"], document["like"], document.get("bare")
    except (InputError, ValueError, LookupError, TypeError, RecursionError):
        return None
    is_valid = (
        texts.shape in stated_shape_names()
        and texts.kind in BOARD
        and isinstance(source, str)
        and isinstance(like, str)
        and (bare is None or isinstance(bare, bool))
    )
    return Draft(texts, source, like, bare) if is_valid else None


def _draft_path(session: Path) -> Path:
    # os.path.expanduser raises nothing where there is no home
    home = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")  # noqa: PTH111
    return (
        Path(home)
        / "refracal"
        / "drafts"
        / f"{sha256(os.fsencode(os.path.realpath(session))).hexdigest()[:32]}.json"
    )


def _check_texts(texts: Mapping[str, str]) -> dict[str, str]:
    if not all(isinstance(text, str) for entry in texts.items() for text in entry):
        raise TypeError("not texts")
    return dict(texts)


def _check_covers(covers: Sequence[Mapping[str, object]]) -> tuple[Mapping[str, object], ...]:
    if not all(cover["shape"] in stated_shape_names() for cover in covers):
        raise TypeError("not covers")
    return tuple(covers)


def _check_unusual(keys: object) -> dict[str, object]:
    """Return the keys of a board; ValueError if they are something else. Their values are read by
    the rules of session.yaml.
    """
    if not isinstance(keys, dict) or not set(keys) <= set(UNUSUAL):
        raise ValueError("not keys of a board")
    return keys
