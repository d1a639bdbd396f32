"""Values of a described session that a person corrects in the form: they go into its session.yaml,
whose other lines stay as they are.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path

import yaml

from calib.io.yaml_reader import read_yaml
from calib.session.session import session_to_yaml
from capture.session_file import read_setup, write_description
from capture.tui.form import FormTexts, read_form, write_form

VALUE = r"(?:\[[^\]\n]*\]|\{[^}\n]*\}|[^\s,#{}\[\]][^\n,#{}\[\]]*?)"
"""Matches a value on one line: a list, a mapping, or a word."""


def write_edits(session: Path, typed: FormTexts) -> bool:
    """Write the typed values where they differ from session.yaml. Return True if any did.

    InputError, and nothing is written, where the typed values are invalid.
    """
    file = session / "session.yaml"
    board, camera, cover = read_setup(file)
    shown = write_form(board, cover)
    if typed == shown:
        return False
    typed_board, _, typed_cover = read_form(typed, camera)
    old_document = session_to_yaml(board, camera, cover)
    new_document = session_to_yaml(typed_board, camera, typed_cover)
    document = read_yaml(file)
    text = file.read_text(encoding="utf-8-sig")
    for section, same_keys in (
        ("board", typed.kind == shown.kind),
        ("cover", typed.shape == shown.shape),
    ):
        old = old_document[section]
        new = new_document[section]
        written = document.get(section)
        if old == new:
            continue
        if not (same_keys and all(isinstance(entry, Mapping) for entry in (old, new, written))):
            document[section] = new
            continue
        assert isinstance(old, Mapping)
        assert isinstance(new, Mapping)
        assert isinstance(written, Mapping)
        changed = {key: value for key, value in new.items() if old.get(key) != value}
        document[section] = {
            key: value
            for key, value in {**written, **changed}.items()
            if key in new or key not in old
        }
        text = _replace_values(text, section, changed)
    if yaml.safe_load(text) != document:
        text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120)
    write_description(session, text)
    return True


def _replace_values(text: str, section: str, values: Mapping[str, object]) -> str:
    """Return the text with these values of a section, as far as each stands on one line."""
    block = re.search(rf"^{section}:.*\n?(?:[ \t#].*\n?|\n)*", text, re.MULTILINE)
    if not block:
        return text
    lines = block[0]
    for key, value in values.items():
        pattern = rf"(?<![\w.]){key}:[ \t]+({VALUE})(?=[ \t]*(?:[,}}#]|$))"
        if place := re.search(pattern, lines, re.MULTILINE):
            written = json.dumps(value, ensure_ascii=False)
            lines = lines[: place.start(1)] + written + lines[place.end(1) :]
    return text[: block.start()] + lines + text[block.end() :]
