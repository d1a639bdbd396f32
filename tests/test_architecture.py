"""docs/architecture.md says what is there: its rooms are those of the import table, and its paths
exist.
"""

import re
from pathlib import Path

from tests.test_imports import LAYERS

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PICTURE = (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
MADE_UP = {"calib/export/plain.py", "calib/commands/NAME_command.py"}
BESIDE = {
    "extras",
    "version",
    "progress",
    "rounding",
    "table",
    "threads",
    "fit_record",
    "fringes",
    "calibration_content",
    "calibration_file",
    "__main__",
}
"""Rooms that the picture names beside another, or leaves out."""


def test_the_table_and_the_picture_have_every_room() -> None:
    layer_of = {room: layer for layer, rooms in enumerate(LAYERS["calib"]) for room in rooms}
    table = PAGE[PAGE.index("| room |") : PAGE.index("`fixtures/` has")]
    for room in set(layer_of) - {"__main__"}:
        assert f"`{room}" in table, room
    drawn = re.findall(r'font-weight="bold" fill="#0f172a">(\w+)</text>', PICTURE)
    order = [room for room in reversed(drawn) if room in layer_of]
    assert set(order) == set(layer_of) - BESIDE
    layers = [layer_of[room] for room in order]
    assert layers == sorted(layers), "from the bottom up"


def test_its_paths_exist() -> None:
    paths = re.findall(r"`((?:calib|capture|tests|docs|fixtures|benchmarks)/[\w/.]*)`", PAGE)
    assert len(paths) > 10
    for path in paths:
        assert (ROOT / path).exists() or path in MADE_UP, path
