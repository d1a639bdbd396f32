"""The manifest of a fleet: a CSV or YAML that lists its cameras, or a glob of their sessions.

Errors in it are reported before anything runs.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from calib.errors import InputError, brief, harmless, meant
from calib.fleet.limits import ENDS, Limit, limit_of
from calib.fleet.places import absolute, at_hand, faraway, is_remote
from calib.io.files import MAX_TEXT_BYTES, read_file, reading
from calib.io.yaml_reader import read_yaml
from calib.session.schema import Section

KEYS = ("id", "session", "serial", "prior", "fixture", "date")
ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
GLOB = re.compile(r"[*?\[]")
TABLES = (".csv", ".yaml", ".yml")
EXAMPLE = "{cameras: [{id: A17, session: sessions/A17}]}"


@dataclass(frozen=True, slots=True)
class Entry:
    """A camera of the fleet."""

    id: str
    """The name of its files. It is unique, also if the case of letters is ignored."""
    session: str
    """An absolute path, or an address that fsspec reads; likewise `prior`."""
    serial: str = ""
    prior: str = ""
    """A calibration against which it is checked; may be empty."""
    fixture: str = ""
    """The place of the recording, or another label of a batch."""
    date: str = ""
    """The day, as in ISO 8601."""
    limits: tuple[Limit, ...] = ()


def read_manifest(places: Sequence[str]) -> tuple[Entry, ...]:
    """Return the cameras of one table, or of globs and folders of sessions, which name the ids.

    Raises:
        InputError: a row or key is wrong, two cameras have one id or one session, or there is no
            camera.
    """
    table = places[0] if len(places) == 1 and places[0].lower().endswith(TABLES) else None
    where = table or "these sessions"
    entries = tuple(_rows(table) if table else _sessions(places))
    if not entries:
        if table:
            raise InputError(
                f"{brief(table)} has no camera: list some, each with an id and a session."
            )
        raise InputError(
            f"no folder matches {harmless(' or '.join(places))}: give session folders, or a table"
            " such as fleet.csv with the columns id and session."
        )
    ids: dict[str, Entry] = {}
    sessions: dict[str, Entry] = {}
    for entry in entries:
        if (first := ids.setdefault(entry.id.casefold(), entry)) is not entry:
            twice = f"{first.id} and {entry.id}" if first.id != entry.id else entry.id
            advice = (
                "give each camera an id of its own"
                if table
                else "list them in a CSV with ids of your own"
            )
            raise InputError(f"{brief(where)}: the id {twice} comes twice: {advice}.")
        if (first := sessions.setdefault(entry.session.rstrip("/"), entry)) is not entry:
            raise InputError(
                f"{brief(where)}: {first.id} and {entry.id} have one session, {entry.session}: give"
                " each camera its own."
            )
    return entries


def _rows(table: str) -> Iterator[Entry]:
    with at_hand(table) as path:
        base = table.rpartition("/")[0] if is_remote(table) else str(Path(table).parent)
        yield from (
            _of_csv(path, table, base)
            if table.lower().endswith(".csv")
            else _of_yaml(path, table, base)
        )


def _of_csv(path: Path, table: str, base: str) -> Iterator[Entry]:
    try:
        text = read_file(path, MAX_TEXT_BYTES).decode("utf-8-sig")
        lines = csv.reader(io.StringIO(text, newline=""), strict=True)
        head = [cell.strip() for cell in next(lines, [])]
        rows = [(lines.line_num, row) for row in lines if any(cell.strip() for cell in row)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{table} is not a CSV table in UTF-8 ({brief(error)}): save it again as one."
        ) from error
    if len(head) == 1 and ";" in head[0]:
        raise InputError(f"{table} has semicolons between its columns: write commas.")
    for index, name in enumerate(head):
        stem, _, end = name.rpartition(".")
        if name in head[:index]:
            raise InputError(f"{table}: the column {brief(name)!r} comes twice: keep one.")
        if name not in KEYS and end not in ENDS:
            near = meant(name, KEYS)
            hint = (
                f"did you mean {near}"
                if near
                else f"write {', '.join(KEYS)}, or limits such as held_out_px.max"
            )
            raise InputError(f"{table}: {brief(name)!r} is not a column of a fleet: {hint}.")
        if name not in KEYS:
            limit_of(stem, {}, table)
    for key in KEYS[:2]:
        if key not in head:
            raise InputError(
                f"{table} has no column {key}: its first line must be {','.join(KEYS)} or some of"
                " these, id and session among them."
            )
    for number, row in rows:
        where = f"{table}, line {number}"
        if len(row) > len(head):
            raise InputError(
                f"{where} has {len(row)} cells and the first line {len(head)}: put cells with"
                " commas in quotes."
            )
        cells = {name: cell.strip() for name, cell in zip(head, row, strict=False)}
        ends: dict[str, dict[str, float]] = {}
        for name, cell in cells.items():
            if name not in KEYS and cell:
                stem, _, end = name.rpartition(".")
                ends.setdefault(stem, {})[end] = _finite(cell, name, where)
        yield _entry(
            {key: cells.get(key, "") for key in KEYS},
            [limit_of(name, values, where) for name, values in ends.items()],
            base,
            where,
        )


def _of_yaml(path: Path, table: str, base: str) -> Iterator[Entry]:
    manifest = Section(read_yaml(path), table)
    manifest.allow_only(("cameras", "limits"))
    common_limits = _limits(manifest, table)
    cameras = manifest.get("cameras", f"a list, such as {EXAMPLE}")
    if not isinstance(cameras, list):
        raise manifest.error("cameras", cameras, f"a list, such as {EXAMPLE}")
    for index, value in enumerate(cameras):
        if not isinstance(value, Mapping):
            raise manifest.error(
                f"cameras[{index}]", value, "a mapping, such as {id: A17, session: sessions/A17}"
            )
        camera = Section(value, table, f"cameras[{index}]")
        camera.allow_only((*KEYS, "limits"))
        where = f"{table}: cameras[{index}]"
        limits = {limit.name: limit for limit in (*common_limits, *_limits(camera, where))}
        yield _entry(
            {key: camera.text(key, "a text", default="") for key in KEYS},
            list(limits.values()),
            base,
            where,
        )


def _limits(section: Section, where: str) -> list[Limit]:
    if "limits" not in section.values:
        return []
    limits_section = section.section("limits", "{held_out_px: {max: 0.3}}")
    limits = []
    for name in limits_section.values:
        ends = limits_section.section(name, "{min: 0.1, max: 0.3}")
        ends.allow_only(ENDS, "end of a limit")
        limits.append(
            limit_of(
                name,
                {end: _finite(value, f"{name}.{end}", where) for end, value in ends.values.items()},
                where,
            )
        )
    return limits


def _finite(value: object, name: str, where: str) -> float:
    try:
        number = (
            float(value)
            if isinstance(value, str | int | float) and not isinstance(value, bool)
            else math.nan
        )
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(
            f"{where}: {name} is {brief(value)!r}: write a number, in the unit that a fit prints"
            " it in."
        )
    return number


def _entry(cells: Mapping[str, str], limits: Sequence[Limit], base: str, where: str) -> Entry:
    if not cells["session"]:
        raise InputError(f"{where}: session is missing: write the folder that holds session.yaml.")
    if not ID.fullmatch(cells["id"]) or cells["id"].lower().endswith(".json"):
        raise InputError(
            f"{where}: id is {brief(cells['id'])!r}: write letters, digits, '.', '_' and '-', 100"
            " at most, as it names the camera's files."
        )
    if cells["date"]:
        try:
            date.fromisoformat(cells["date"])
        except ValueError:
            raise InputError(
                f"{where}: date is {brief(cells['date'])!r}: write a day as 2026-05-17."
            ) from None
    places = {key: absolute(cells[key], base) if cells[key] else "" for key in ("session", "prior")}
    return Entry(**{**cells, **places}, limits=tuple(limits))


def _sessions(places: Sequence[str]) -> Iterator[Entry]:
    for place in places:
        for session in sorted(_globbed(place)) if GLOB.search(place) else [_folder(place)]:
            name = session.rstrip("/").rpartition("/")[2]
            camera = re.sub("[^A-Za-z0-9._-]", "-", name).lstrip("._-")[:100] or "camera"
            yield Entry(camera, session)


def _folder(place: str) -> str:
    if not is_remote(place):
        with reading(Path(place)):
            if Path(place).is_file():
                raise InputError(
                    f"{place} is neither a CSV nor a YAML: give a table of cameras, or their"
                    " sessions' folders."
                )
            if not (Path(place) / "session.yaml").exists():
                raise InputError(
                    f"{place} is no session, for it has no session.yaml: give a CSV, a YAML, or a"
                    f" glob such as '{place}/*'."
                )
    return absolute(place)


def _globbed(place: str) -> list[str]:
    """Return the folders that match a glob, without files."""
    with faraway(place):
        from fsspec.core import url_to_fs

        files, path = url_to_fs(place if is_remote(place) else absolute(place))
        folders = [name for name in files.glob(path) if files.isdir(name)]
        return [files.unstrip_protocol(name) for name in folders] if is_remote(place) else folders
