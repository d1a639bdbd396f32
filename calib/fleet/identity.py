"""The identity of a camera's result: hashes of its session and settings, which stay equal while
neither changes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from calib.calibration_file import FILES
from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.fleet.manifest import Entry
from calib.fleet.places import faraway, is_remote
from calib.io.files import read_file
from calib.io.yaml_reader import read_yaml
from calib.session.session import PRIOR_KEY

FORMAT = 1
"""The version of a camera's JSON. A file of another version is ignored."""
FOLDERS = ((), ("frames",), ("bare",), ("bare", "frames"))
"""The folders of a session that a fit reads."""


@dataclass(frozen=True, slots=True)
class FleetOptions:
    """The options that hold for every camera."""

    settings: Settings
    depths: tuple[float, ...] = ()
    """Distances of maps and exports, m."""
    formats: tuple[str, ...] = ()
    """Names of calib.export.formats."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Three hashes. Results are equal if the settings are, and the listing or the contents are."""

    settings: str
    listing: str
    """The hash of the names, sizes and times of the session's files, without their contents."""
    contents: str
    """The hash of the files themselves. It is empty for an address, because the listing has the
    store's own checksums.
    """

    @staticmethod
    def of(entry: Entry, options: FleetOptions, previous: Identity | None = None) -> Identity:
        """Return the identity of a session as it is now.

        Args:
            previous: of an earlier result. If the listing is unchanged, files are not read again.
        """
        prior = [*_listed(entry.prior, FILES)] if entry.prior else []
        inputs = {
            "format": FORMAT,
            "prior": [entry.prior, *prior, *_fleet_prior(entry.session)],
            **asdict(options),
        }
        listed = [*_listed(entry.session)]
        settings = _hash(inputs)
        listing = _hash(listed)
        if previous and previous.listing == listing:
            return Identity(settings, listing, previous.contents)
        if is_remote(entry.session):
            return Identity(settings, listing, "")
        digests = [(name, _digest(Path(entry.session) / name)) for name, *_ in listed]
        return Identity(settings, listing, _hash(digests))

    def same(self, current: Identity) -> bool:
        """Return True if the session and the settings are unchanged."""
        return self.settings == current.settings and (
            self.listing == current.listing
            or (self.contents != "" and self.contents == current.contents)
        )

    @staticmethod
    def read(document: Any) -> Identity | None:
        """Return the identity in a camera's JSON; None if the value is no identity."""
        try:
            return Identity(
                **{name: str(document[name]) for name in ("settings", "listing", "contents")}
            )
        except (KeyError, TypeError):
            return None


def _listed(place: str, only: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield each file's name within the folder, and its size and time, or its attributes at an
    address. Hidden files are left out.
    """
    with faraway(place):
        from fsspec.core import url_to_fs

        files, root = url_to_fs(place)
        root = root.rstrip("/")
        entries = files.find(root, maxdepth=max(map(len, FOLDERS)) + 1, detail=True)
    for path, attributes in sorted(entries.items()):
        *folders, name = path.removeprefix(root).strip("/").split("/")
        if tuple(folders) in FOLDERS and not name.startswith(".") and (not only or name in only):
            version = (
                sorted(attributes.items())
                if is_remote(place)
                else (attributes["size"], attributes["mtime"])
            )
            yield "/".join((*folders, name)), str(version)


def _fleet_prior(session: str) -> list[str]:
    """Return the hash of the fleet's prior that a session names; empty without one."""
    if is_remote(session) or not (file := Path(session) / "session.yaml").is_file():
        return []
    name = read_yaml(file).get(PRIOR_KEY)
    place = Path(session) / name if isinstance(name, str) else None
    return [sha256(read_file(place)).hexdigest()] if place and place.is_file() else []


def _digest(path: Path) -> str:
    """Return the hash of a file; "" if it cannot be read, such as a link to nothing: the fit leaves
    such a picture out.
    """
    try:
        return sha256(read_file(path)).hexdigest()
    except InputError:
        return ""


def _hash(document: object) -> str:
    return sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
