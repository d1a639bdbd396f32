"""`calib init` writes a session.yaml with a comment beside every key."""

import re
from pathlib import Path

import pytest

from calib.cli import main
from calib.session.session import read_session
from calib.session.shapes.registry import find_shape, shape_names
from tests.commands.test_described_session import BOARD
from tests.importing import recordings


@pytest.mark.parametrize("shape", shape_names())
def test_init_writes_a_session_that_is_read(shape: str, tmp_path: Path) -> None:
    folder = recordings.write_pictures(tmp_path / "s")
    words = ["init", str(folder), *BOARD, "--cover", shape, "--intrinsics", "520,525,322,238"]
    example = find_shape(shape).example
    for kind in find_shape(shape).keys:
        if kind.quantity.key in example:
            value = example[kind.quantity.key]
            words.append(f"--{kind.option}={str(value).strip('[]')}")
    assert main(words) == 0
    session = read_session(folder)
    assert session.cover.shape == shape
    assert (session.camera.width, session.camera.height) == recordings.SIZE
    text = (folder / "session.yaml").read_text()
    for kind in find_shape(shape).keys:
        first = kind.explanation.split()[0]
        assert kind.quantity.key not in example or f"# {first}" in text


def test_the_examples_of_init_can_be_used(tmp_path: Path) -> None:
    """Each commented section, put in the place of the one that it is an example for."""
    folder = tmp_path / "s"
    assert main(["init", str(folder)]) == 0
    file = folder / "session.yaml"
    text = file.read_text()
    recordings.write_pictures(folder / "frames")
    read_session(folder)
    lens = "  # intrinsics:"
    assert lens in text
    text = text.replace(lens, "  intrinsics:")
    head, *covers = re.split(r"^# cover:$", text, flags=re.MULTILINE)
    shapes = set()
    for cover in covers:
        body = re.sub(r"^# ?", "", cover, flags=re.MULTILINE)
        file.write_text(head.replace("cover:\n  shape: none", f"cover:\n{body}"))
        shapes.add(read_session(folder).cover.shape)
    assert shapes == {*shape_names()} - {"none"}
    boards = re.findall(r"^# (board: .*)$", text, flags=re.MULTILINE)
    for board in boards:
        section = re.compile(r"^board:\n(  .*\n)+", re.MULTILINE)
        file.write_text(section.sub(f"{board}\n", head))
        assert read_session(folder).board.coding
    assert len(boards) == 3
    assert main(["init", str(folder)]) == 2
