"""Every view with its picture and what the model leaves of it, the worst first; and the pictures
that were not used.
"""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from html import escape
from pathlib import Path

import cv2
import numpy as np

from calib.fitting.view_noise import VIEW_NOISE
from calib.report.evidence import Evidence
from calib.report.ink import hues
from calib.report.pictures import data_url, picture_of, read_small

WIDTH = 300
"""px of a thumbnail."""
MOST = 60
"""Pictures in one page; further views are listed without."""
DRAWN = 1 / 30
"""Of the image's width: how long the typical error is drawn."""

Thumbnails = dict[int, Future[str | None]]


def begin_thumbnails(
    evidence: Evidence, session: Path | None, pool: ThreadPoolExecutor
) -> Thumbnails:
    """Start reading the pictures of the worst views from a session's folder."""
    if not session:
        return {}
    camera, views = evidence.calibration.camera, evidence.calibration.views
    worst = np.argsort(-evidence.rms_by_view)[:MOST].tolist()
    return {
        v: pool.submit(
            _thumbnail, picture_of(session, views[v].name), (camera.width, camera.height)
        )
        for v in worst
    }


def views_html(evidence: Evidence, thumbnails: Thumbnails) -> str:
    magnified = (
        DRAWN
        * evidence.calibration.camera.width
        / max(float(np.median(evidence.rms_by_view)), 1e-6)
    )
    order = np.argsort(-evidence.rms_by_view).tolist()
    pictures = {view: future.result() for view, future in thumbnails.items()}
    missing = (
        ""
        if any(pictures.values())
        else " The pictures themselves were not found beside this calibration."
    )
    cards = "".join(_card(evidence, view, pictures.get(view), magnified) for view in order)
    rejected = "".join(
        f"<li><b>{escape(r.name)}</b>: {escape(r.reason)}</li>"
        for r in evidence.calibration.rejected
    )
    return (
        f"<p>The worst first. Each line is a corner's error, {float(f'{magnified:.2g}'):g} times as"
        f" long as it is.{missing}</p>"
        f'<div class="views">{cards}</div>'
        + (f"<h3>Not used</h3><ul>{rejected}</ul>" if rejected else "")
    )


def _thumbnail(path: Path, size: tuple[int, int]) -> str | None:
    """A data URL; None where the picture can not be read any more, or is not of this size."""
    small = read_small(path, size, WIDTH)
    return None if small is None else data_url(small)


def _card(evidence: Evidence, view: int, picture: str | None, magnified: float) -> str:
    camera = evidence.calibration.camera
    own = evidence.view == view
    seen, distance = evidence.calibration.views[view], evidence.distance[own]
    tilt = np.degrees(
        np.arccos(
            min(1.0, abs(float(cv2.Rodrigues(evidence.calibration.poses[view, :3])[0][2, 2])))
        )
    )
    red, green, blue = (255 * hues(len(evidence.calibration.views))[view]).astype(int).tolist()
    lines = "".join(_lines(evidence, own, magnified))
    image = f'<img src="{picture}" alt="">' if picture else ""
    name = escape(seen.name)
    times = evidence.calibration.settings.get(VIEW_NOISE, {}).get(seen.name)
    noisier = f"<br>noisier by {times:.1f} times, so it weighs less" if times else ""
    size = camera.width, camera.height
    overlay = (
        f'<svg viewBox="0 0 {size[0]} {size[1]}" role="img" aria-label="errors of {name}"><path'
        f' d="{lines}"/></svg>'
    )
    return (
        f'<div class="view" style="--own: rgb({red} {green} {blue})"><div class="shot"'
        f' style="aspect-ratio: {size[0]}/{size[1]}">{image}{overlay}</div><p><i'
        f' class="dot"></i><b>{name}</b> <span class="number">{evidence.rms_by_view[view]:.3f}'
        f" px</span><br><small>{seen.count} corners, {distance.mean():.2f} m, tilted"
        f" {tilt:.0f}°{noisier}</small></p></div>"
    )


def _lines(evidence: Evidence, own: np.ndarray, magnified: float) -> Iterator[str]:
    for (x, y), (dx, dy) in zip(
        evidence.pixels[own], magnified * evidence.errors[own], strict=True
    ):
        if np.isfinite(dx + dy):
            yield f"M{x:.0f} {y:.0f}l{dx:.0f} {dy:.0f}"
