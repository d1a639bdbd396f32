"""Recognise the pictures of several cameras by their names: left-00.png and right-00.png, or
cam0_1.jpg and cam1_1.jpg. Corners of two cameras that are taken for one give a lens between both.
"""

import re
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import TypeVar

from calib.errors import InputError

CAMERAS = re.compile(
    r"(?:^|[^a-z])(left|right|cam(?:era)?[-_]?[0-9a-f](?![0-9a-z])|[lr](?=[-_ ]?[0-9]|\.))",
    re.IGNORECASE,
)
"""The camera within a picture's name."""
PAIRED_FRACTION = 0.5
"""Part of the pictures of each camera that must have a partner of the same name in the other."""
MIN_PICTURES = 2
"""Pictures of each camera: camera_1.jpg and camera_2.jpg are two pictures of one."""
ALL = "all"

T = TypeVar("T", str, Path)


def choose_camera(pictures: Sequence[T], camera: str | None) -> tuple[T, ...]:
    """Return the pictures of one camera.

    Args:
        pictures: paths or names.
        camera: the camera's name within theirs, or "all" if it is one camera all the same. None:
            they are of one camera.

    Raises:
        InputError: the names are of several cameras and none is chosen, or that one has none.
    """
    names = [PurePath(picture).name for picture in pictures]
    cameras = find_cameras(names)
    if camera is None and cameras:
        raise InputError(
            f"{describe_cameras(cameras)}: choose one with --camera {cameras[0]}, or --camera all"
            " if it is one camera."
        )
    if camera in (None, ALL):
        return tuple(pictures)
    chosen = tuple(
        picture
        for picture, name in zip(pictures, names, strict=True)
        if _split(name)[0] == str(camera).lower()
    )
    if not chosen:
        raise InputError(
            f"no picture is called as of a camera {camera}: name one of"
            f" {', '.join(cameras) or 'none'}, or leave --camera out."
        )
    return chosen


def describe_cameras(cameras: Sequence[str]) -> str:
    """Return a clause that says of which cameras the pictures are by their names."""
    prefixes = " and ".join(f"{camera}*" for camera in cameras)
    return f"the names of the pictures fall into {prefixes}, as those of {len(cameras)} cameras do"


def find_cameras(names: Sequence[str]) -> tuple[str, ...]:
    """Return the cameras that the names of pictures tell, if they tell several, and most pictures
    of each have a partner with the same name but for the camera; else ().
    """
    remainders: dict[str, set[str]] = {}
    for name in names:
        camera, remainder = _split(name)
        if not camera:
            return ()
        remainders.setdefault(camera, set()).add(remainder)
    if len(remainders) < 2:
        return ()
    for camera, numbers in remainders.items():
        partners = set().union(*(remainders[name] for name in remainders if name != camera))
        count = len(numbers & partners)
        if len(numbers) < MIN_PICTURES or count < PAIRED_FRACTION * len(numbers):
            return ()
    return tuple(sorted(remainders))


def without_camera(name: str) -> str:
    """Return the name of a picture without the camera in it."""
    return _split(name)[1]


def _split(name: str) -> tuple[str, str]:
    """Return the camera in a picture's name, in small letters, and the name without it; "" for a
    name without a camera.
    """
    match = CAMERAS.search(name)
    if match is None:
        return "", name
    return match[1].lower(), name[: match.start(1)] + name[match.end(1) :]
