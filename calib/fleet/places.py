"""Paths of sessions and calibrations: a folder, or an address that fsspec reads, such as
s3://bucket/session.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.errors import InputError, brief

SCHEME_END = "://"


def is_remote(place: str) -> bool:
    """Return True for an address that fsspec reads."""
    return SCHEME_END in place and not place.startswith("file://")


def absolute(place: str, base: str = "") -> str:
    """Return the absolute path of a place that is relative to the folder or address `base`. An
    address stays unchanged.
    """
    if is_remote(place) or (is_remote(base) and not place.startswith("/")):
        return place if is_remote(place) else f"{base}/{place}"
    return str((Path(base) / Path(place.removeprefix("file://")).expanduser()).absolute())


@contextmanager
def faraway(place: str) -> Iterator[None]:
    """Within, an error of reading an address becomes an InputError."""
    try:
        yield
    except ImportError as error:
        raise InputError(
            f"{place} needs one more package ({brief(error)}): install it wherever a worker runs."
        ) from error
    except (OSError, ValueError) as error:
        raise InputError(
            f"{place} cannot be read ({brief(error) or type(error).__name__}): check the address"
            " and who may read it."
        ) from error


@contextmanager
def at_hand(place: str) -> Iterator[Path]:
    """Yield a path on this machine: the file or folder itself, or a temporary copy of an address.

    Raises:
        InputError: the address cannot be read, or the library that reads it is not installed.
    """
    if not is_remote(place):
        yield Path(place)
        return
    with TemporaryDirectory(prefix="refracal-") as folder:
        copy = Path(folder) / (place.rstrip("/").rpartition("/")[2] or "session")
        with faraway(place):
            from fsspec.core import url_to_fs

            files, path = url_to_fs(place)
            files.get(
                path.rstrip("/") + ("/" if files.isdir(path) else ""),
                f"{copy}/" if files.isdir(path) else str(copy),
                recursive=True,
            )
        yield copy
