"""The inputs of a fit: the corners of a session and the intrinsics of its camera."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.corners.copies import join_still_poses, split_copies
from calib.corners.corners_file import read_corners
from calib.corners.detect_all import MIN_VIEWS, detect
from calib.corners.point_views import views_of_points
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import BARE_PREFIX, RejectedPicture, View
from calib.errors import InputError
from calib.fit_record.request import IntrinsicsSource
from calib.intrinsics.calibrate import BareFit, calibrate_bare
from calib.intrinsics.spatial_target import check_handedness
from calib.io.files import reading
from calib.io.frames_table import NAME as FRAMES_TABLE
from calib.io.frames_table import FrameRecord, read_frame_records
from calib.io.images import (
    TYPES,
    frames_folder,
    image_size,
    list_images,
    list_unread,
    most_frequent_size,
)
from calib.progress import Progress
from calib.session.camera import Intrinsics
from calib.session.fleet_prior import nominal_intrinsics
from calib.session.freeing import free_own_intrinsics
from calib.session.lens import OPENCV
from calib.session.session import Session

if TYPE_CHECKING:  # it loads torch
    from calib.calibration import Calibration

FOREIGN_TABLE = (
    "it names none of the pictures, so their times and poses are not known: write the pictures'"
    " names in its column file"
)
"""The reason why a frames.csv is not used."""


@dataclass(frozen=True, slots=True)
class FitInputs:
    """The corners and intrinsics that a fit starts from."""

    views: tuple[View, ...]
    """Views with enough corners for a pose."""
    rejected: tuple[RejectedPicture, ...]
    intrinsics: Intrinsics
    intrinsics_from: IntrinsicsSource
    lens_held_out_px: dict[str, float]
    """Error on held-out views by the number of OpenCV's coefficients or the name of another lens
    model; empty if the lens was not chosen by it.
    """

    intrinsics_are_final: bool = False
    """True if a joint fit must not estimate the intrinsics again: they come from the views of the
    fit (`BareFit.final`), or from bare/ of a session without a cover.
    """

    @property
    def is_own(self) -> bool:
        """True if the intrinsics come from the views that the fit uses."""
        return self.intrinsics_from == "views"

    @property
    def prior_intrinsics(self) -> Intrinsics:
        """The intrinsics as the prior of the fit."""
        is_start = self.is_own and not self.intrinsics_are_final
        return free_own_intrinsics(self.intrinsics) if is_start else self.intrinsics


def read_views(
    session: Session, progress: Progress, *, min_views: int = MIN_VIEWS
) -> tuple[tuple[View, ...], tuple[RejectedPicture, ...]]:
    """Return the session's views and the rejected pictures. A picture that is there twice counts
    once, and pictures of a board that stands still have one pose id.

    Corners come from the points or the corners file, or are detected in the pictures, at least
    `min_views` of them showing the board. Times and pose ids come from frames.csv.
    """
    table = session.path / FRAMES_TABLE
    records = read_frame_records(table)
    rejected: tuple[RejectedPicture, ...] = ()
    if session.points:
        views = views_of_points(session.points)
    elif session.corners:
        views = read_corners(session.corners, session.board)
        _check_inside(views, session)
    else:
        advance = progress.task(f"Corners in {session.path.resolve().name}", len(session.frames))
        size = session.camera.width, session.camera.height
        detection = detect(
            session.frames,
            session.board,
            lambda done, hits: advance(done, f"{hits} board{'s' * (hits != 1)} found"),
            size=size,
            min_views=min_views,
        )
        views = detection.views
        rejected = detection.rejected
        places = (session.path, session.path.parent)  # bare/ lies in a session
        if any((place / "session.yaml").exists() for place in places):
            rejected += _unread(dict.fromkeys(frame.parent for frame in session.frames))
    views, copies = split_copies(views)
    recorded = [
        _with_record(view, records.get(Path(view.name).name, FrameRecord())) for view in views
    ]
    names = {frame.name for frame in session.frames}
    names.update(Path(view.name).name for view in views)
    names.update(Path(picture.name).name for picture in (*rejected, *copies))
    if records and names.isdisjoint(records):
        copies = (*copies, RejectedPicture(table.name, FOREIGN_TABLE))
    return join_still_poses(recorded), (*rejected, *copies)


def _unread(folders: Iterable[Path]) -> tuple[RejectedPicture, ...]:
    """Return the files beside the pictures of folders whose type is not read."""
    return tuple(
        RejectedPicture(path.name, f"its type is not read: save it as {TYPES}")
        for folder in folders
        for path in list_unread(folder)
    )


def _with_record(view: View, record: FrameRecord) -> View:
    return replace(view, time_s=record.time_s, pose_id=record.pose_id)


def gather_inputs(
    session: Session, progress: Progress, views: Sequence[View] | None = None
) -> FitInputs:
    """Read or detect the corners, unless the views are given, and determine the intrinsics.

    Intrinsics come from the session if it states them, else from bare/, else from a fleet's prior,
    else, without a cover, from the views themselves.
    """
    rejected: tuple[RejectedPicture, ...] = ()
    if views is None:
        views, rejected = read_views(session, progress)
    check_handedness(
        split_usable_views(views, session.board)[0],
        session.board,
        (session.camera.width, session.camera.height),
    )
    bare_rejected: tuple[RejectedPicture, ...] = ()
    lens_errors: dict[str, float] = {}
    source: IntrinsicsSource
    final = False
    if session.camera.intrinsics:
        intrinsics = session.camera.intrinsics
        source = "session.yaml"
    elif session.bare:
        bare_views, dropped = read_views(session.bare, progress)
        fitted = calibrate_bare(bare_views, session.bare.board, session.camera, progress)
        bare_rejected = tuple(
            RejectedPicture(f"{BARE_PREFIX}{r.name}", r.reason)
            for r in (*dropped, *fitted.rejected)
        )
        intrinsics = fitted.intrinsics
        lens_errors = fitted.held_out_px
        source = "bare"
        final = session.cover.shape == "none"  # nothing stands before the lens, so they hold here
    elif session.prior:
        intrinsics = nominal_intrinsics(session.prior)
        source = "prior"
    else:
        fitted = calibrate_bare(views, session.board, session.camera, progress)
        views = fitted.views
        bare_rejected = fitted.rejected
        intrinsics = fitted.intrinsics
        lens_errors = fitted.held_out_px
        source = "views"
        final = fitted.final
    usable, unusable = split_usable_views(views, session.board)
    return FitInputs(
        views=usable,
        rejected=(*rejected, *bare_rejected, *unusable),
        intrinsics=intrinsics,
        intrinsics_from=source,
        lens_held_out_px=lens_errors,
        intrinsics_are_final=final,
    )


def recalibrate_bare(
    views: Sequence[View], session: Session, intrinsics: Intrinsics, progress: Progress
) -> BareFit:
    """Calibrate a camera without a cover again, from more corners of the same views, with the lens
    model and the number of coefficients of `intrinsics`.
    """
    count = len(intrinsics.distortion) if intrinsics.model == OPENCV else None
    camera = replace(session.camera, lens=intrinsics.model, lens_coefficients=count)
    return calibrate_bare(views, session.board, camera, progress)


def _check_inside(views: Sequence[View], session: Session) -> None:
    size = session.camera.width, session.camera.height
    for view in views:
        corners = view.corners[view.seen]
        outlying = ((corners < -0.5) | (corners > np.array(size) - 0.5)).any(-1)
        if outlying.any():
            x, y = corners[outlying][0]
            raise InputError(
                f"{session.corners}: {view.name} has a corner at ({x:g}, {y:g}), outside the"
                f" camera's {size[0]}x{size[1]} px: correct camera.width and camera.height, or use"
                " corners of this camera mode."
            )


def session_of_pictures(
    paths: Sequence[Path], calibration: Calibration
) -> tuple[Session, tuple[int, int], tuple[RejectedPicture, ...]]:
    """Return a session of the pictures of folders and of picture files, of those that have the size
    of most, with board and camera of a calibration; this size in px; and the others and the damaged
    ones.

    Raises:
        InputError: no file can be read.
    """
    files = [file for path in paths for file in _files(path)]
    sizes: dict[Path, tuple[int, int]] = {}
    rejected = []
    for file in files:
        try:
            sizes[file] = image_size(file)
        except InputError as error:
            rejected.append(RejectedPicture(file.name, str(error)))
    if not sizes:
        raise InputError(f"No picture can be used: {rejected[0].reason}")
    rejected += _unread(frames_folder(path) for path in paths if path.is_dir())
    width, height = size = most_frequent_size(sizes)
    readable = [file for file in sizes if sizes[file] == size]
    rejected += [
        RejectedPicture(
            file.name, f"{sizes[file][0]}x{sizes[file][1]} px where most are {width}x{height}"
        )
        for file in sizes
        if sizes[file] != size
    ]
    session = Session(
        readable[0].parent,
        calibration.board,
        calibration.camera,
        calibration.cover,
        tuple(readable),
        None,
        None,
    )
    return session, size, tuple(rejected)


def _files(path: Path) -> Sequence[Path]:
    with reading(path):
        if not path.exists():
            raise InputError(
                f"{path} does not exist: give a session, a folder of pictures, or picture files."
            )
        if not path.is_dir():
            return (path,)
        folder = path / "frames" if (path / "frames").is_dir() else path
    files = list_images(folder)
    if not files:
        raise InputError(
            f"{folder} has no pictures: give a session, a folder of {TYPES} files,"
            " or the files themselves."
        )
    return files
