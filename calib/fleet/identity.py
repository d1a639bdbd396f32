"""What a camera's result was made from: equal for a session and settings of which nothing has
changed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from calib.fitting.stages import Settings
from calib.fleet.manifest import Entry
from calib.fleet.places import faraway, is_remote
from calib.io.files import read_file
from calib.io.yaml_reader import read_yaml
from calib.session.session import PRIOR_KEY

FORMAT = 1
"""Of a camera's JSON: one of another format is made anew."""
PARTS = ((), ("frames",), ("bare",), ("bare", "frames"))
"""Folders of a session that a fit reads."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What is done with every camera."""

    settings: Settings
    depths: tuple[float, ...] = ()
    """m, of maps and exports."""
    formats: tuple[str, ...] = ()
    """Of calib.export.formats."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Hashes: equal settings, and an equal listing or equal contents, are an equal result."""

    settings: str
    listing: str
    """Of the names, sizes and times of the session's files, which takes no reading of pictures."""
    contents: str
    """Of the files themselves; empty at an address, whose store's own checksums are in the listing.
    """

    @staticmethod
    def of(entry: Entry, asked: Asked, before: Identity | None = None) -> Identity:
        """Args: before: of an earlier result; where its listing is still true, contents are not
        read again.
        """
        prior = (
            [*_listed(entry.prior, ("calibration.yaml", "calibration.npz"))] if entry.prior else []
        )
        said = {
            "format": FORMAT,
            "prior": [entry.prior, *prior, *_fleet_prior(entry.session)],
            **asdict(asked),
        }
        listed = [*_listed(entry.session)]
        settings, listing = _hash(said), _hash(listed)
        if before and before.listing == listing:
            return Identity(settings, listing, before.contents)
        if is_remote(entry.session):
            return Identity(settings, listing, "")
        digests = [
            (name, sha256(read_file(Path(entry.session) / name)).hexdigest()) for name, *_ in listed
        ]
        return Identity(settings, listing, _hash(digests))

    def same(self, other: Identity) -> bool:
        return self.settings == other.settings and (
            self.listing == other.listing
            or (self.contents != "" and self.contents == other.contents)
        )

    @staticmethod
    def read(said: Any) -> Identity | None:
        """As a camera's JSON has it; None where that is of something else."""
        try:
            return Identity(
                **{name: str(said[name]) for name in ("settings", "listing", "contents")}
            )
        except (KeyError, TypeError):
            return None


def _listed(place: str, only: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Each file's name within the folder, and what tells it from another of that name; hidden files
    are nobody's.
    """
    with faraway(place):
        from fsspec.core import url_to_fs

        files, root = url_to_fs(place)
        root = root.rstrip("/")
        found = files.find(root, maxdepth=max(map(len, PARTS)) + 1, detail=True)
    for path, about in sorted(found.items()):
        *folders, name = path.removeprefix(root).strip("/").split("/")
        if tuple(folders) in PARTS and not name.startswith(".") and (not only or name in only):
            told = sorted(about.items()) if is_remote(place) else (about["size"], about["mtime"])
            yield "/".join((*folders, name)), str(told)


def _fleet_prior(session: str) -> list[str]:
    """The hash of the fleet's prior that a session names, which lies elsewhere."""
    if is_remote(session) or not (file := Path(session) / "session.yaml").is_file():
        return []
    named = read_yaml(file).get(PRIOR_KEY)
    place = Path(session) / named if isinstance(named, str) else None
    return [sha256(read_file(place)).hexdigest()] if place and place.is_file() else []


def _hash(said: object) -> str:
    return sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()
