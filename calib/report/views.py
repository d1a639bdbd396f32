"""The section of a report with every view, its picture and its errors, the worst first, and the
rejected pictures.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from html import escape
from pathlib import Path

import cv2
import numpy as np

from calib.io.numerals import counted
from calib.report.corners import relative_errors, shown_corners
from calib.report.evidence import Evidence
from calib.report.pictures import data_url, picture_of, read_small
from calib.rounding import two_digits

THUMBNAIL_WIDTH = 480
"""The largest width of a thumbnail in px."""
PAGE_BYTES = 300_000
"""The size of all thumbnails together, which keeps the page small: of many views, or of pictures
with much grain, the thumbnails are smaller.
"""
MAX_THUMBNAILS = 60
"""Thumbnails in a page; further views are listed without a picture."""
OPEN_VIEWS = 8
"""The worst views, which are visible at once; a click shows the others."""
DRAWN_ERROR = 1 / 30
"""The drawn length of a typical error, as a fraction of the image's width."""

Thumbnails = dict[int, Future[str | None]]


def start_thumbnails(
    evidence: Evidence, session: Path | None, pool: ThreadPoolExecutor
) -> Thumbnails:
    """Start to read the pictures of the worst views from a session's folder."""
    if not session:
        return {}
    camera, views = evidence.calibration.camera, evidence.calibration.views
    worst = np.argsort(-evidence.rms_by_view)[:MAX_THUMBNAILS].tolist()
    size = camera.width, camera.height
    max_bytes = PAGE_BYTES // max(len(worst), 1)
    return {
        v: pool.submit(_thumbnail, picture_of(session, views[v].name), size, max_bytes)
        for v in worst
    }


def views_html(evidence: Evidence, thumbnails: Thumbnails) -> str:
    """Return the section as HTML."""
    magnified = (
        DRAWN_ERROR
        * evidence.calibration.camera.width
        / max(float(np.median(evidence.rms_by_view)), 1e-6)
    )
    order = np.argsort(-evidence.rms_by_view).tolist()
    pictures = {view: future.result() for view, future in thumbnails.items()}
    missing = (
        "" if any(pictures.values()) else " The pictures were not found beside this calibration."
    )
    cards = [_card(evidence, view, pictures.get(view), magnified) for view in order]
    rejected = "".join(
        f"<li><b>{escape(r.name)}</b>: {escape(r.reason)}</li>"
        for r in evidence.calibration.rejected
    )
    return (
        f"<p>The worst view comes first. Each line is the error of a corner, enlarged"
        f" {two_digits(magnified)} times. A click shows the picture.{missing}</p>"
        f'<div class="views">{"".join(cards[:OPEN_VIEWS])}</div>'
        + _more(cards[OPEN_VIEWS:])
        + (f"<h3>Not used</h3><ul>{rejected}</ul>" if rejected else "")
    )


def _more(cards: Sequence[str]) -> str:
    """Return the HTML of views that a click shows, without scripts."""
    if not cards:
        return ""
    name = "One more view" if len(cards) == 1 else f"The other {len(cards)} views"
    return (
        f'<details class="more"><summary>{name}</summary><div class="views">{"".join(cards)}</div>'
        "</details>"
    )


def _thumbnail(path: Path, size: tuple[int, int], max_bytes: int) -> str | None:
    """Return a data URL; None if the picture cannot be read or has another size."""
    small = read_small(path, size, min(THUMBNAIL_WIDTH, size[0]))
    return None if small is None else data_url(small, max_bytes)


def _card(evidence: Evidence, view: int, picture: str | None, magnified: float) -> str:
    camera = evidence.calibration.camera
    starts = evidence.calibration.observations.starts
    in_view = slice(int(starts[view]), int(starts[view + 1]))
    view_corners, distance = evidence.calibration.views[view], evidence.distance[in_view]
    tilt = np.degrees(
        np.arccos(
            min(1.0, abs(float(cv2.Rodrigues(evidence.calibration.poses[view, :3])[0][2, 2])))
        )
    )
    part = 100 * relative_errors(evidence)[view]
    lines = "".join(_lines(evidence, view, magnified))
    image = f'<img src="{picture}" alt="">' if picture else ""
    name = escape(view_corners.name)
    times = (evidence.calibration.outcome.view_noise or {}).get(view_corners.name)
    noisier = f"<br>its noise is {times:.1f} times as large, so it weighs less" if times else ""
    outliers = (evidence.calibration.outcome.outlier_corners or {}).get(view_corners.name, 0)
    fewer = f"<br>{counted(outliers, 'corner')} left out, far from their places" if outliers else ""
    size = camera.width, camera.height
    overlay = (
        f'<svg viewBox="0 0 {size[0]} {size[1]}" role="img" aria-label="errors of {name}"><path'
        f' d="{lines}"/></svg>'
    )
    return (
        f'<div class="view" data-view="{view}" style="--part: {part:.0f}%">'
        f'<div class="shot" style="aspect-ratio: {size[0]}/{size[1]}">{image}{overlay}</div><p><i'
        f' class="dot"></i><b>{name}</b> <span class="number">{evidence.rms_by_view[view]:.3f}'
        f" px</span><br><small>{view_corners.count} corners, {distance.mean():.2f} m,"
        f" tilted&nbsp;{tilt:.0f}°{noisier}{fewer}</small></p></div>"
    )


def _lines(evidence: Evidence, view: int, magnified: float) -> Iterator[str]:
    shown = shown_corners(evidence)
    rows = shown[evidence.view[shown] == view]
    for (x, y), (dx, dy) in zip(
        evidence.pixels[rows], magnified * evidence.errors[rows], strict=True
    ):
        if np.isfinite(dx + dy):
            yield f"M{x:.0f} {y:.0f}l{dx:.0f} {dy:.0f}"
