"""Every view with its picture and what the model leaves of it, the worst first; and the pictures that were not used."""

from base64 import b64encode
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from html import escape
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.errors import RefracalError
from calib.io.images import read_grey
from calib.report.evidence import Evidence
from calib.report.ink import hues

WIDTH = 300
"""px of a thumbnail."""
QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 62]
JPEG = b"\xff\xd8\xff"
MOST = 60
"""Pictures in one page; further views are listed without."""
DRAWN = 1 / 30
"""Of the image's width: how long the typical error is drawn."""

Thumbnails = dict[int, Future[str | None]]


def begin_thumbnails(evidence: Evidence, session: Path | None, pool: ThreadPoolExecutor) -> Thumbnails:
    """Start reading the pictures of the worst views from a session's folder."""
    if not session:
        return {}
    camera, views = evidence.calibration.camera, evidence.calibration.views
    worst = np.argsort(-evidence.rms_by_view)[:MOST].tolist()
    frames = session / "frames"
    return {v: pool.submit(_thumbnail, frames / Path(views[v].name).name, (camera.width, camera.height)) for v in worst}


def views_html(evidence: Evidence, thumbnails: Thumbnails) -> str:
    magnified = DRAWN * evidence.calibration.camera.width / max(float(np.median(evidence.rms_by_view)), 1e-6)
    order = np.argsort(-evidence.rms_by_view).tolist()
    pictures = {view: future.result() for view, future in thumbnails.items()}
    missing = "" if any(pictures.values()) else " The pictures themselves were not found beside this calibration."
    cards = "".join(_card(evidence, view, pictures.get(view), magnified) for view in order)
    rejected = "".join(f"<li><b>{escape(r.name)}</b>: {escape(r.reason)}</li>" for r in evidence.calibration.rejected)
    return (
        f"<p>The worst first. Each line is a corner's error, {float(f'{magnified:.2g}'):g} times as long as it is.{missing}</p>"
        f'<div class="views">{cards}</div>' + (f"<h3>Not used</h3><ul>{rejected}</ul>" if rejected else "")
    )


def _thumbnail(path: Path, size: tuple[int, int]) -> str | None:
    """A data URL; None where the picture can not be read any more, or is not of this size."""
    try:
        pixels, shrunk = _read(path, size[0])
    except (RefracalError, OSError):
        return None
    width, height = (-(-length // shrunk) for length in size)
    if pixels is None or pixels.shape != (height, width):
        return None
    small = cv2.resize(eight_bits(pixels), (WIDTH, round(WIDTH * size[1] / size[0])), interpolation=cv2.INTER_AREA)
    return "data:image/jpeg;base64," + b64encode(cv2.imencode(".jpg", small, QUALITY)[1].tobytes()).decode()


def _read(path: Path, width: int) -> tuple[NDArray | None, int]:
    """Grey pixels, and by how much they are shrunk: a large JPEG is decoded at an eighth of its size, in a fraction of the time."""
    if width > 8 * WIDTH and (data := path.read_bytes()).startswith(JPEG):
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_8 | cv2.IMREAD_IGNORE_ORIENTATION), 8
    return read_grey(path), 1


def _card(evidence: Evidence, view: int, picture: str | None, magnified: float) -> str:
    camera = evidence.calibration.camera
    own = evidence.view == view
    seen, depth = evidence.calibration.views[view], evidence.depth[own]
    tilt = np.degrees(np.arccos(min(1.0, abs(float(cv2.Rodrigues(evidence.calibration.poses[view, :3])[0][2, 2])))))
    red, green, blue = (255 * hues(len(evidence.calibration.views))[view]).astype(int).tolist()
    lines = "".join(_lines(evidence, own, magnified))
    image = f'<img src="{picture}" alt="">' if picture else ""
    name = escape(seen.name)
    size = camera.width, camera.height
    overlay = f'<svg viewBox="0 0 {size[0]} {size[1]}" role="img" aria-label="errors of {name}"><path d="{lines}"/></svg>'
    return (
        f'<div class="view" style="--own: rgb({red} {green} {blue})">'
        f'<div class="shot" style="aspect-ratio: {size[0]}/{size[1]}">{image}{overlay}</div>'
        f'<p><i class="dot"></i><b>{name}</b> <span class="number">{evidence.rms_by_view[view]:.3f} px</span><br>'
        f"<small>{seen.count} corners, {depth.mean():.2f} m, tilted {tilt:.0f}°</small></p></div>"
    )


def _lines(evidence: Evidence, own: np.ndarray, magnified: float) -> Iterator[str]:
    for (x, y), (dx, dy) in zip(evidence.pixels[own], magnified * evidence.errors[own], strict=True):
        if np.isfinite(dx + dy):
            yield f"M{x:.0f} {y:.0f}l{dx:.0f} {dy:.0f}"
