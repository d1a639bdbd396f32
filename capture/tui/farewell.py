"""What stands in the terminal when the screen has gone: where everything is, and what to type
next.
"""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from calib.commands.program import as_typed
from calib.errors import harmless
from calib.io.images import list_images

CALIBRATION = "calibration.yaml"
DEPTH = 1.0
"""m: of the maps that are proposed where none are written and no results were looked at."""
UPDATED = "updated"
"""The folder in a calibration's own, of that which a check has brought up to date."""


def fitted(session: Path) -> Path | None:
    """The folder of the session's calibration, if it has one."""
    folder = session / "calibration"
    return folder if (folder / CALIBRATION).exists() else None


def updated(folder: Path) -> Path | None:
    """The folder of what a check has made of this calibration's since it was fitted, if one has."""
    return folder / UPDATED if _since(folder / CALIBRATION, folder / UPDATED) else None


def farewell(
    session: Path,
    shown: Path | None,
    maps: Sequence[Path],
    *,
    depth: float = DEPTH,
    doubt: str = "",
    cut_short: bool = False,
) -> Iterator[str]:
    """Lines.

    Args:
        shown: the calibration whose results were looked at last; None: those of no one.
        maps: what was exported last; empty: what lies in the session's export folder since that
            fit.
        depth: m, of maps that are proposed.
        doubt: what the verdict on that says, if it is not to be trusted.
        cut_short: the last fit was ended before it had a result.
    """
    folder = shown.parent if shown else fitted(session)
    if folder:
        if cut_short:
            yield (
                "The last fit was ended before it had a result: the calibration is the one of"
                " before."
            )
        yield f"The calibration is in {_said(folder)}"
        exported = session / "export"
        if renewed := updated(folder):
            folder, doubt = renewed, ""
            maps = _newer(folder / CALIBRATION, maps)
            exported = folder / "export"
            yield f"Brought up to date by a check: {_said(folder)}"
        maps = maps or _since(folder / CALIBRATION, exported)
        for path in maps:
            yield f"Exported {_said(path)}"
        if doubt:
            yield f"{doubt} The report says why, and what to do."
            yield f"Next: {_command('calib', 'report', folder)}"
        else:
            yield f"Next: {_use(session, folder, maps, depth)}"
        return
    bare, frames = (
        len(list_images(place)) if place.is_dir() else 0
        for place in (session / "bare", session / "frames")
    )
    if bare or frames:
        yield (
            f"{_said(session)} has {bare} pictures without the cover and {frames} through it; it"
            " has no calibration yet."
        )
    else:
        yield f"Nothing is recorded in {_said(session)} yet; what was typed is kept."
    yield f"To go on: {_command('capture', session)}"


def _since(calibration: Path, exported: Path) -> Sequence[Path]:
    """The files of a folder that are not older than the calibration."""
    return sorted(_newer(calibration, exported.iterdir())) if exported.is_dir() else ()


def _newer(calibration: Path, paths: Iterable[Path]) -> Sequence[Path]:
    """The files that are not older than the calibration."""
    if not calibration.exists():
        return ()
    made = calibration.stat().st_mtime_ns
    return [path for path in paths if path.is_file() and path.stat().st_mtime_ns >= made]


def _use(session: Path, folder: Path, maps: Sequence[Path], depth: float) -> str:
    """What to do with the calibration: maps first, then pictures that they straighten."""
    exported = next(
        (
            path.stem.removeprefix("map_").removesuffix("m")
            for path in maps
            if path.stem.startswith("map_")
        ),
        None,
    )
    if exported is None:
        place = (folder if folder.name == UPDATED else session) / "export"
        return _command(
            "calib", "export", folder, "--format", "npz", "--depth", f"{depth:g}", "-o", place
        )
    return _command(
        "calib",
        "undistort",
        folder,
        session / "frames",
        "--depth",
        exported,
        "-o",
        session / "undistorted",
    )


def _command(*words: str | Path) -> str:
    return harmless(as_typed(shlex.join(map(str, words))))


def _said(path: Path) -> str:
    return harmless(str(path))
