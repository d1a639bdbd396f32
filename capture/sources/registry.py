"""The registry of sources: where frames can come from, by the first word of `--source`."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from calib.errors import InputError, brief, meant
from calib.session.schema import Section
from capture.frames import FrameSource
from capture.typed_path import expand_typed_path

NODE = re.compile("(?:(?:/dev/)?video)?([0-9]{1,3})")
"""A camera of V4L2 as other programs name it: by its node or its number."""


@dataclass(frozen=True, slots=True)
class ListedCamera:
    """A camera of this machine."""

    source: str
    """The text that `--source` takes."""
    name: str
    modes: tuple[str, ...]
    """Pixel format and size, as `?format=` and `?size=` take them, with rates where they are known.
    """
    problem: str = ""
    """A sentence that says why the camera cannot be used as it is; empty if it can."""


@dataclass(frozen=True, slots=True)
class Inventory:
    """The cameras that one backend finds."""

    cameras: tuple[ListedCamera, ...] = ()
    missing: str = ""
    """A sentence that says why this backend finds no camera; empty if it finds one."""


class Backend(Protocol):
    """A module of this package.

    It is imported when it is needed, and imports its own driver as late.
    """

    def open_source(self, place: str, options: Section) -> FrameSource:
        """Return the source for the text after the scheme's colon and the options after its
        question mark.

        It opens nothing before `with`.
        """
        ...

    def inventory(self) -> Inventory: ...


@dataclass(frozen=True, slots=True)
class Scheme:
    name: str
    module: str
    example: str
    camera: bool = False
    """True for a camera, which is told the size of its pictures, and whether they are in colour."""

    def backend(self) -> Backend:
        return cast(Backend, import_module(self.module))


SCHEMES: tuple[Scheme, ...] = (
    Scheme("v4l2", "capture.sources.v4l2", "v4l2:/dev/video0", camera=True),
    Scheme("libcamera", "capture.sources.libcamera", "libcamera:0", camera=True),
    Scheme("rpicam", "capture.sources.rpicam", "rpicam:0", camera=True),
    Scheme("folder", "capture.sources.folder", "folder:PATH"),
    Scheme("video", "capture.sources.video", "video:FILE"),
)
"""Cameras first, in the order in which `capture sources` lists them."""


def open_source(
    text: str, option: str = "--source", camera_options: Mapping[str, object] | None = None
) -> FrameSource:
    """Return the source that `SCHEME:PLACE?key=value&...` names, or the path of a folder, a video
    or a camera's device by itself; an InputError says what is wrong with the text.

    Args:
        option: the name of the option or field in messages.
        camera_options: options that a camera gets where the text does not state them.
    """
    if not text.strip():
        raise InputError(f"{option} is empty: {_expected()}")
    context = f"{option} {brief(text)}"
    name, colon, location = full_source(text).partition(":")
    scheme = next((scheme for scheme in SCHEMES if scheme.name == name), None)
    if scheme is None:
        raise InputError(_unknown(context, name if colon else "", text))
    place, mark, query = location.rpartition("?")
    if not (mark and "=" in query):  # the question mark belongs to the path
        place, query = location, ""
    if not place:
        raise InputError(f"{context} does not say which one: write it like {scheme.example}.")
    if scheme.name == "video":
        _check_video(Path(place))
    pairs = _pairs(context, query)
    if scheme.camera:
        pairs = {**(camera_options or {}), **pairs}
    return scheme.backend().open_source(place, Section(pairs, context))


def _check_video(path: Path) -> None:
    """Raise InputError for a picture, whose folder is the source."""
    from calib.io.images import SUFFIXES  # OpenCV, which cameras do not need here

    if path.suffix.lower() in SUFFIXES:
        raise InputError(f"{path} is one picture: name its folder, {path.parent}.")


def usable_cameras() -> list[str]:
    """Return the cameras of this machine that can be used, as `--source` names them."""
    return [
        camera.source
        for scheme in SCHEMES
        for camera in scheme.backend().inventory().cameras
        if not camera.problem
    ]


def is_recorded_source(source: str) -> bool:
    """Return True if the source plays back existing pictures; a camera, in contrast, may still be
    plugged in.
    """
    return full_source(source).startswith(("folder:", "video:"))


def is_rehearsal(source: str) -> bool:
    """Return True if a recorded source names its speed: it stands for a camera, and the screen
    guides as it would then.
    """
    return "speed=" in source.rpartition("?")[2]


def full_source(text: str) -> str:
    """Return the source with its kind in front. A path that exists needs none: a folder, a video
    or the device of a camera.
    """
    if any(text.startswith(f"{scheme.name}:") for scheme in SCHEMES):
        return text
    bare, mark, options = text.strip().rpartition("?")
    for path in (text.strip(), bare if mark and "=" in options else ""):
        if kind := _kind_of_path(path):
            return f"{kind}:{text.strip()}"
    return text


def _kind_of_path(path: str) -> str:
    """Return the kind of source that a path is; empty if nothing is there."""
    with suppress(OSError, ValueError):  # text that cannot be a path is none
        place = expand_typed_path(path) if path else None
        if place and place.is_dir():
            return "folder"
        if place and place.is_file():
            return "video"
        if place and place.is_char_device():
            return "v4l2"
    return ""


def _pairs(context: str, query: str) -> dict[str, object]:
    pairs: dict[str, object] = {}
    for pair in query.split("&") if query else ():
        key, equals, value = pair.partition("=")
        if not (key and equals and value) or key in pairs:
            raise InputError(
                f"{context}: {brief(repr(pair))} is not an option: write each once, as key=value"
                " with & between."
            )
        try:
            pairs[key] = float(value)
        except ValueError:
            pairs[key] = value
    return pairs


def _unknown(context: str, name: str, text: str) -> str:
    close = meant(name, [scheme.name for scheme in SCHEMES])
    node = NODE.fullmatch(text)
    close = f"v4l2:/dev/video{node[1]}" if node else close
    hint = f" (did you mean {close}?)" if close else ""
    if text.startswith(("/", "./", "../", "~")) and not hint:
        return f"{text} does not exist: write the path of a folder or a video that does."
    return f"{context} names no kind of source{hint}: {_expected()}"


def _expected() -> str:
    return (
        f"write one of {', '.join(scheme.example for scheme in SCHEMES)}, or the path of a folder"
        " or a video that exists."
    )
