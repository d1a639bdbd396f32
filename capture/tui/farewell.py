"""The last lines in the terminal when the screen has gone: where all results are, and the next
command.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import cv2
import numpy as np

from calib.commands.program import runnable_command
from calib.errors import InputError, harmless
from calib.fitting.supported_depths import doubtful_depths
from calib.io.arrays import decode_npz
from calib.io.images import frames_folder, list_images
from calib.io.numerals import counted
from calib.io.result_names import CALIBRATION_ARRAYS, CALIBRATION_FILE
from calib.io.shell import shell_line
from calib.session.lens import OPENCV
from calib.verdict.verdict import MAPS_HOLD, Trust
from capture.session_file import read_calibrated

REPORT = "report.html"
DEPTH = 1.0
"""m, the proposed depth of maps if the calibration has no boards."""
MAX_FILES = 6
"""The number of files in one folder that are named."""
UPDATED = "updated"
"""The subfolder of a calibration for the version that a check has updated."""


def calibration_folder(session: Path) -> Path | None:
    """Return the folder of the session's calibration, if it has one."""
    folder = session / "calibration"
    return folder if (folder / CALIBRATION_FILE).exists() else None


def propose_depth(folder: Path) -> float:
    """Return the depth, m, that is proposed for the maps of a folder's calibration: the median of
    its boards' corners, as `calib fit` proposes it. DEPTH where there are none. Nothing slow is
    imported for it.
    """
    try:
        board, camera, _ = read_calibrated(folder / CALIBRATION_FILE)
        arrays = decode_npz((folder / CALIBRATION_ARRAYS).read_bytes())
        turns = [cv2.Rodrigues(pose[:3])[0][:, :2] for pose in arrays["poses"]]
        places = board.points() @ np.swapaxes(turns, 1, 2) + arrays["poses"][:, None, 3:]
        visible = places[np.isfinite(arrays["corners"][..., 0])]
    except (InputError, OSError, ValueError, KeyError, IndexError):  # loading it says what is wrong
        return DEPTH
    is_wide = camera.intrinsics is not None and camera.intrinsics.model != OPENCV
    distance = np.linalg.norm(visible, axis=1) if is_wide else visible[:, 2]
    return float(f"{np.median(distance):.2g}") if distance.size else DEPTH


def updated_folder(folder: Path) -> Path | None:
    """Return the folder of this calibration's updated version, if a check has written one since the
    fit.
    """
    return folder / UPDATED if files_since(folder / CALIBRATION_FILE, folder / UPDATED) else None


def farewell_lines(
    session: Path,
    results: Path | None,
    maps: Sequence[Path],
    *,
    depth: float | None = None,
    boards: tuple[float, float] | None = None,
    doubt: str = "",
    was_cancelled: bool = False,
    has_black_border: bool = False,
) -> Iterator[str]:
    """Yield the lines.

    Args:
        shown: the calibration whose results were opened last; None: no results were opened.
        maps: the files that were exported last. Empty: those in the session's export folder that
            are newer than the fit.
        depth: m, the proposed depth of maps. None: that of `propose_depth`.
        boards: m, the depths of the nearest and the farthest corners, if they are known.
        doubt: the verdict's sentence, if the calibration is not trusted.
        was_cancelled: True if the last fit was ended before it had a result.
        has_black_border: true if straight pictures have a black border, which the command crops.
    """
    folder = results.parent if results else calibration_folder(session)
    if folder:
        if was_cancelled:
            yield (
                "The last fit was ended before it had a result: the calibration is still the"
                " previous one."
            )
        yield f"The calibration is in {_printable(folder)}"
        exported = session / "export"
        if renewed := updated_folder(folder):
            folder, doubt = renewed, ""
            maps = select_newer(folder / CALIBRATION_FILE, maps)
            exported = folder / "export"
            yield f"Brought up to date by a check: {_printable(folder)}"
        if (report := folder / REPORT).exists():
            yield f"The report is {_printable(report)}"
        maps = maps or files_since(folder / CALIBRATION_FILE, exported)
        yield from _exported_lines(maps)
        if doubt == MAPS_HOLD:  # as after calib fit, the use comes first
            yield f"{doubt} The report says with which."
            doubt = ""
        elif doubt:
            yield f"{doubt} The report says why, and what to do."
            yield f"Next: {shell_command('calib', 'report', folder)}"
        if doubt != Trust.DO_NOT_USE.sentence:
            proposed = propose_depth(folder) if depth is None else depth
            crop = ("--crop", "0") if has_black_border else ()
            use = _next_command(session, folder, _supported_depth(maps, boards, proposed), *crop)
            yield f"{'Then' if doubt else 'Next'}: {use}"
        return
    bare = _count_images(session / "bare")
    frames = _count_images(frames_folder(session))
    if bare or frames:
        yield (
            f"{_printable(session)} has {counted(bare, 'picture')} without the cover and {frames}"
            " through it; it has no calibration yet."
        )
    else:
        yield f"Nothing is recorded in {_printable(session)} yet; what was typed is kept."
    yield f"To go on: {shell_command('capture', session)}"


def _exported_lines(paths: Sequence[Path]) -> Iterator[str]:
    for folder, files in groupby(sorted(paths), key=attrgetter("parent")):
        names = list(files)
        if len(names) > MAX_FILES:
            yield f"Exported {len(names)} files into {_printable(folder)}"
        else:
            yield from (f"Exported {_printable(path)}" for path in names)


def _count_images(folder: Path) -> int:
    return len(list_images(folder)) if folder.is_dir() else 0


def files_since(calibration: Path, exported: Path) -> Sequence[Path]:
    """Return the files of a folder and its subfolders that are not older than the calibration."""
    return sorted(select_newer(calibration, exported.rglob("*"))) if exported.is_dir() else ()


def select_newer(calibration: Path, paths: Iterable[Path]) -> Sequence[Path]:
    """Return the files that are not older than the calibration."""
    if not calibration.exists():
        return ()
    made = calibration.stat().st_mtime_ns
    return [path for path in paths if path.is_file() and path.stat().st_mtime_ns >= made]


def shell_command(*words: str | Path) -> str:
    """Return a command that can be typed in a terminal."""
    return harmless(runnable_command(shell_line(*words)))


def _supported_depth(
    maps: Sequence[Path], boards: tuple[float, float] | None, proposed: float
) -> str:
    """Return the first depth that has a map and that the boards support; else the proposed one."""
    depths = (
        path.stem.removeprefix("map_").removesuffix("m")
        for path in maps
        if path.stem.startswith("map_")
    )
    supported = (
        depth for depth in depths if not (boards and doubtful_depths([float(depth)], *boards))
    )
    return next(supported, f"{proposed:g}")


def _next_command(session: Path, folder: Path, depth: str, *options: str) -> str:
    """Return the command that undistorts the session's pictures."""
    return shell_command(
        "calib",
        "undistort",
        folder,
        frames_folder(session),
        "--depth",
        depth,
        *options,
        "-o",
        session / "undistorted",
    )


def _printable(path: Path) -> str:
    return harmless(str(path))
