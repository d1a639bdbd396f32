"""What a fit starts from: the corners of a session, and the intrinsics of its camera."""

from collections.abc import Sequence
from dataclasses import dataclass

from calib.camera import Intrinsics
from calib.detections import detect
from calib.intrinsics import FEWEST_CORNERS, calibrate_bare
from calib.progress import Progress
from calib.session import Session, check_images
from calib.views import Rejected, View
from calib.vnlog import read_corners


@dataclass(frozen=True, slots=True)
class Gathered:
    """The start of a fit."""

    views: tuple[View, ...]
    """With corners enough for a pose."""
    rejected: tuple[Rejected, ...]
    intrinsics: Intrinsics
    lens_held_out_px: dict[int, float]
    """By number of coefficients, the error on held-out views, where the number was chosen by it."""


def read_views(session: Session, progress: Progress) -> tuple[tuple[View, ...], tuple[Rejected, ...]]:
    """The session's corners: from its corners file, or detected in its pictures."""
    if session.corners:
        return read_corners(session.corners, session.board), ()
    check_images(session)
    advance = progress.task(f"Corners in {session.path.name}", len(session.frames))
    found = detect(session.frames, session.board, lambda done, hits: advance(done, f"{hits} boards found"))
    return found.views, found.rejected


def with_enough_corners(views: Sequence[View]) -> tuple[tuple[View, ...], tuple[Rejected, ...]]:
    """The views whose corners give a pose, and the others."""
    few = [view for view in views if view.count < FEWEST_CORNERS]
    reasons = tuple(Rejected(v.name, f"only {v.count} corners are seen, and a pose needs {FEWEST_CORNERS}") for v in few)
    return tuple(view for view in views if view.count >= FEWEST_CORNERS), reasons


def gather(session: Session, progress: Progress) -> Gathered:
    """Read or detect the corners, and find the intrinsics.

    Intrinsics come from the session where it states them, else from bare/, else, without a cover, from the views themselves.
    """
    views, rejected = read_views(session, progress)
    bare: tuple[Rejected, ...] = ()
    tried: dict[int, float] = {}
    if session.camera.intrinsics:
        intrinsics = session.camera.intrinsics
    elif session.bare:
        shown, dropped = read_views(session.bare, progress)
        fitted = calibrate_bare(shown, session.bare.board, session.camera, progress)
        bare = tuple(Rejected(f"{session.bare.path.name}/{r.name}", r.reason) for r in (*dropped, *fitted.rejected))
        intrinsics, tried = fitted.intrinsics, fitted.held_out_px
    else:
        fitted = calibrate_bare(views, session.board, session.camera, progress)
        views, bare, intrinsics, tried = fitted.views, fitted.rejected, fitted.intrinsics, fitted.held_out_px
    kept, too_few = with_enough_corners(views)
    return Gathered(kept, (*rejected, *bare, *too_few), intrinsics, tried)
