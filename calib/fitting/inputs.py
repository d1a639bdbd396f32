"""What a fit starts from: the corners of a session, and the intrinsics of its camera."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from calib.corners.corners_file import read_corners
from calib.corners.detect_all import MIN_VIEWS, detect
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View
from calib.errors import InputError
from calib.intrinsics.calibrate import BareFit, calibrate_bare
from calib.io.frames_table import NAME as FRAMES_TABLE
from calib.io.frames_table import FrameRecord, read_frame_records
from calib.progress import Progress
from calib.session.camera import Intrinsics
from calib.session.fleet_prior import nominal_intrinsics
from calib.session.lens import OPENCV
from calib.session.session import Session


@dataclass(frozen=True, slots=True)
class Gathered:
    """The start of a fit."""

    views: tuple[View, ...]
    """With corners enough for a pose."""
    rejected: tuple[RejectedPicture, ...]
    intrinsics: Intrinsics
    intrinsics_from: Literal["session.yaml", "bare", "prior", "views"]
    lens_held_out_px: dict[str, float]
    """By number of OpenCV's coefficients, or by the name of another lens model, the error on
    held-out views, where it was chosen by it.
    """


def read_views(
    session: Session, progress: Progress, *, fewest: int = MIN_VIEWS
) -> tuple[tuple[View, ...], tuple[RejectedPicture, ...]]:
    """The session's corners: from its corners file, or detected in its pictures, of which `fewest`
    must show the board; with what frames.csv says of each picture.
    """
    records = read_frame_records(session.path / FRAMES_TABLE)
    rejected: tuple[RejectedPicture, ...] = ()
    if session.corners:
        views = read_corners(session.corners, session.board)
        _check_inside(views, session)
    else:
        advance = progress.task(f"Corners in {session.path.resolve().name}", len(session.frames))
        size = session.camera.width, session.camera.height
        found = detect(
            session.frames,
            session.board,
            lambda done, hits: advance(done, f"{hits} boards found"),
            size=size,
            min_views=fewest,
        )
        views, rejected = found.views, found.rejected
    return (
        tuple(_recorded(view, records.get(Path(view.name).name, FrameRecord())) for view in views),
        rejected,
    )


def _recorded(view: View, record: FrameRecord) -> View:
    return replace(view, time_s=record.time_s, pose_id=record.pose_id)


def gather(session: Session, progress: Progress) -> Gathered:
    """Read or detect the corners, and find the intrinsics.

    Intrinsics come from the session where it states them, else from bare/, else from a fleet's
    prior, else, without a cover, from the views themselves.
    """
    views, rejected = read_views(session, progress)
    bare: tuple[RejectedPicture, ...] = ()
    tried: dict[str, float] = {}
    source: Literal["session.yaml", "bare", "prior", "views"]
    if session.camera.intrinsics:
        intrinsics = session.camera.intrinsics
        source = "session.yaml"
    elif session.bare:
        shown, dropped = read_views(session.bare, progress)
        fitted = calibrate_bare(shown, session.bare.board, session.camera, progress)
        bare = tuple(
            RejectedPicture(f"{session.bare.path.name}/{r.name}", r.reason)
            for r in (*dropped, *fitted.rejected)
        )
        intrinsics, tried = fitted.intrinsics, fitted.held_out_px
        source = "bare"
    elif session.prior:
        intrinsics, source = nominal_intrinsics(session.prior), "prior"
    else:
        fitted = calibrate_bare(views, session.board, session.camera, progress)
        views, bare, intrinsics, tried = (
            fitted.views,
            fitted.rejected,
            fitted.intrinsics,
            fitted.held_out_px,
        )
        source = "views"
    kept, too_few = split_usable_views(views, session.board)
    return Gathered(kept, (*rejected, *bare, *too_few), intrinsics, source, tried)


def recalibrated(
    views: Sequence[View], session: Session, intrinsics: Intrinsics, progress: Progress
) -> BareFit:
    """Without a cover, from more corners of the same views: with the lens model and as many
    coefficients as were chosen before.
    """
    count = len(intrinsics.distortion) if intrinsics.model == OPENCV else None
    camera = replace(session.camera, lens=intrinsics.model, lens_coefficients=count)
    return calibrate_bare(views, session.board, camera, progress)


def _check_inside(views: Sequence[View], session: Session) -> None:
    size = session.camera.width, session.camera.height
    for view in views:
        seen = view.corners[view.seen]
        outside = ((seen < -0.5) | (seen > np.array(size) - 0.5)).any(-1)
        if outside.any():
            x, y = seen[outside][0]
            raise InputError(
                f"{session.corners}: {view.name} has a corner at ({x:g}, {y:g}), outside the"
                f" camera's {size[0]}x{size[1]} px: correct camera.width and camera.height, or use"
                " corners of this camera mode."
            )
