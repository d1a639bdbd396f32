"""The sources of a rig, by the names of its cameras: `left=v4l2:/dev/video0`."""

import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from calib.errors import InputError, brief
from calib.io.files import reading
from calib.rig.rig_file import MAX_CAMERAS, NAME
from capture.frames import FrameSource
from capture.sources import rpicam
from capture.sources.folder import FolderSource
from capture.sources.registry import full_source, open_source

NAMED = re.compile(r"([^\W\d]\w*)=(.+)", re.DOTALL)
"""A regular expression for a name and what it names."""
EXAMPLE = "--source left=v4l2:/dev/video0 --source right=v4l2:/dev/video2"


def is_rig(sources: Sequence[str]) -> bool:
    """Return True if the texts of `--source` name the cameras of a rig."""
    return len(sources) > 1 or any(NAMED.fullmatch(text) for text in sources)


def refuse_rig_folder(folder: Path) -> None:
    """Raise InputError if a folder that is to be a session is that of a rig."""
    with reading(folder):
        is_rig_folder = (folder / NAME).is_file()
    if is_rig_folder:
        raise InputError(
            f"{folder} is the folder of a rig: name the source of each of its cameras, such as"
            f" {EXAMPLE}, or record one of its sessions."
        )


def read_names(texts: Sequence[str], option: str = "--source") -> dict[str, str]:
    """Return what each camera has, in the order of the texts `NAME=...`.

    Raises:
        InputError: a text has no name, or a name stands twice.
    """
    named: dict[str, str] = {}
    for text in texts:
        match = NAMED.fullmatch(text)
        if not match:
            raise InputError(
                f"{option} {brief(text)} names no camera: of several cameras write each as"
                f" NAME=SOURCE, such as {EXAMPLE}."
            )
        if match[1] in named:
            raise InputError(f"{option} names the camera {match[1]} twice: give each its own name.")
        named[match[1]] = match[2]
    return named


def open_sources(texts: Sequence[str]) -> dict[str, FrameSource]:
    """Return the source of each camera of a rig; it opens none before `with`.

    Raises:
        InputError: a text is wrong, or the sources cannot be pictures of the same moments.
    """
    named = read_names(texts)
    if not 2 <= len(named) <= MAX_CAMERAS:
        raise InputError(
            f"A rig has 2 to {MAX_CAMERAS} cameras, and {len(named)} is named: write {EXAMPLE}, or"
            " name no camera to record a session."
        )
    schemes = {name: full_source(text).partition(":")[0] for name, text in named.items()}
    videos = [name for name, scheme in schemes.items() if scheme == "video"]
    if videos:
        raise InputError(
            f"{videos[0]} is a video, whose times no other camera shares: write its pictures into"
            " a folder, with their times in frames.csv."
        )
    if "folder" in schemes.values() and len(set(schemes.values())) > 1:
        raise InputError(
            "Some of the sources are cameras and some are folders, which have no moment in common:"
            " name cameras, or folders."
        )
    places: dict[str, str] = {}
    for name, text in named.items():
        place = full_source(text).partition("?")[0]
        if place in places:
            raise InputError(
                f"{places[place]} and {name} are both {place}: each camera has a source of its own."
            )
        places[place] = name
    sync = _synchronised(named)
    return {
        name: open_source(text, f"--source {name}", sync.get(name)) for name, text in named.items()
    }


def _synchronised(named: Mapping[str, str]) -> dict[str, dict[str, object]]:
    """Return further options of the cameras by which rpicam-vid synchronises their frames: the
    first one leads. There are none for a single one, for cameras of different rates, for sources
    that state who leads, or if the program is too old.
    """
    cameras = {name: text for name, text in named.items() if text.startswith("rpicam:")}
    rates = {tuple(re.findall(r"[?&]fps=([^&]*)", text)) for text in cameras.values()}
    stated = any(f"{rpicam.SYNC}=" in text for text in cameras.values())
    if len(cameras) < 2 or len(rates) > 1 or stated or not rpicam.can_synchronise():
        return {}
    first, *others = cameras
    clients: dict[str, dict[str, object]] = {name: {rpicam.SYNC: rpicam.CLIENT} for name in others}
    return {first: {rpicam.SYNC: rpicam.SERVER}, **clients}


def align_playback(sources: Mapping[str, FrameSource]) -> bool:
    """Let entered folders play back on one clock, and return True if their pictures have no times,
    so that those of the same name belong together.

    Raises:
        InputError: some folders have times and others have none.
    """
    folders = {name: s for name, s in sources.items() if isinstance(s, FolderSource)}
    if not folders:
        return False
    starts = {name: folder.recorded_start_s for name, folder in folders.items()}
    untimed = [name for name, start in starts.items() if start is None]
    if untimed and len(untimed) < len(folders):
        timed = next(name for name in folders if name not in untimed)
        raise InputError(
            f"The pictures of {timed} have times and those of {untimed[0]} have none: list time_s"
            " of all pictures in a frames.csv beside them, or take those tables away, so that"
            " pictures of the same name belong together."
        )
    origin_s = min((start for start in starts.values() if start is not None), default=0.0)
    now_s = time.monotonic()
    for folder in folders.values():
        folder.play_from(origin_s, now_s)
    return bool(untimed)
