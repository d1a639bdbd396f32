"""The transfer of another session's lens into the session.yaml of a recorded session that has none.
Nothing else is transferred.
"""

import re
from pathlib import Path
from textwrap import indent

import yaml

from calib.errors import InputError
from calib.io.yaml_reader import read_yaml
from calib.session.camera import camera_to_yaml, read_camera
from calib.session.schema import Section
from capture.session_file import Setup, read_setup, write_description
from capture.tui.references import read_like

CAMERA = re.compile(r"^camera:[ \t]*(?:#.*)?\n(?=( +)\S)", re.MULTILINE)
"""The line `camera:` if its keys have lines of their own, with their indentation."""


def read_lens(session: Path, like: str) -> Setup | None:
    """Return the set-up of the named session, whose lens this session will use; None where none is
    named.

    InputError where that session has no lens, or one for pictures of another size.
    """
    if (setup := read_like(like)) is None:
        return None
    camera, named_camera = read_setup(session / "session.yaml")[1], setup[1]
    if named_camera.intrinsics is None:
        raise InputError(
            f"{like.strip()} does not know its lens either: name a session whose session.yaml has"
            " camera.intrinsics."
        )
    if (camera.width, camera.height) != (named_camera.width, named_camera.height):
        raise InputError(
            f"{like.strip()} knows the lens for pictures of"
            f" {named_camera.width}x{named_camera.height} px, and these are"
            f" {camera.width}x{camera.height}: name a session whose pictures are as large."
        )
    return setup


def write_lens(session: Path, like: Setup) -> None:
    """Write the lens into session.yaml. Its other lines stay as they are if its camera is written
    one key per line.
    """
    file = session / "session.yaml"
    document = read_yaml(file)
    camera = document["camera"]
    assert isinstance(camera, dict)
    written = {"intrinsics": camera_to_yaml(like[1])["intrinsics"]}
    document["camera"] = merged = {**camera, **written}
    # its other keys of the lens are checked together with it
    read_camera(Section(merged, str(file), "camera"))
    original = file.read_text(encoding="utf-8-sig")
    lines = yaml.safe_dump(written, sort_keys=False, allow_unicode=True, width=120)
    text = CAMERA.sub(lambda match: match[0] + indent(lines, match[1]), original, count=1)
    if text == original:
        text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120)
    write_description(session, text)
