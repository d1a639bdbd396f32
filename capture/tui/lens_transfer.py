"""The lens of another session for one that is recorded already and has none: it comes into
session.yaml, and nothing else does.
"""

import re
from pathlib import Path
from textwrap import indent

import yaml

from calib.errors import InputError
from calib.io.yaml_reader import read_yaml
from calib.session.camera import camera_to_yaml, read_camera
from calib.session.schema import Section
from capture.disk import write_durably
from capture.session_file import Setup, read_setup
from capture.tui.references import read_like

CAMERA = re.compile(r"^camera:[ \t]*(?:#.*)?\n(?=( +)\S)", re.MULTILINE)
"""Its line, where its keys have lines of their own, with their indentation."""


def lens_of(session: Path, like: str) -> Setup | None:
    """What the session that is named says, whose lens is to be this one's; None where none is
    named.

    InputError where it knows no lens, or one of pictures of another size.
    """
    if (named := read_like(like)) is None:
        return None
    own, other = read_setup(session / "session.yaml")[1], named[1]
    if other.intrinsics is None:
        raise InputError(
            f"{like.strip()} does not know its lens either: name a session whose session.yaml has"
            " camera.intrinsics."
        )
    if (own.width, own.height) != (other.width, other.height):
        raise InputError(
            f"{like.strip()} knows the lens for pictures of {other.width}x{other.height} px, and"
            f" these are {own.width}x{own.height}: name a session whose pictures are as large."
        )
    return named


def lend_lens(session: Path, like: Setup) -> None:
    """Write it into session.yaml, whose other lines stay as they are where its camera is written
    one key a line.
    """
    file = session / "session.yaml"
    said = read_yaml(file)
    camera = said["camera"]
    assert isinstance(camera, dict)
    written = {"intrinsics": camera_to_yaml(like[1])["intrinsics"]}
    said["camera"] = whole = {**camera, **written}
    read_camera(Section(whole, str(file), "camera"))  # what else it says of its lens goes with it
    before = file.read_text(encoding="utf-8-sig")
    lines = yaml.safe_dump(written, sort_keys=False, allow_unicode=True, width=120)
    text = CAMERA.sub(lambda at: at[0] + indent(lines, at[1]), before, count=1)
    if text == before:
        text = yaml.safe_dump(said, sort_keys=False, allow_unicode=True, width=120)
    write_durably(file, text)
