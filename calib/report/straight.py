"""The section of a report that shows a picture as taken and undistorted, under straight guide lines
along the rows and columns of its board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import cv2
import numpy as np

from calib.report.board_lines import BoardLine, distance_to_fit, grid_lines
from calib.report.evidence import Array, Evidence
from calib.report.pictures import data_url, picture_of, read_small
from calib.report.strip import strips_html
from calib.rounding import two_digits
from calib.undistortion.window import Window

WIDTH = 640
"""The largest width of a picture in px."""
MAX_BYTES = 40_000
"""The size of a picture in the page."""
LARGEST_BOARDS = 8
"""Views with the largest boards, of which the one that bends most is shown."""
MAX_READS = 5
"""Pictures to try. If none of them can be read, the session is gone."""
STRIPES = 208, 232
"""The greys of the stripes over pixels that the camera does not see."""
STRIPE = 6
"""px: the width of a stripe."""
LEAST_BOW = 1e-3
"""px: the smallest shift of a corner by the board's bend that the text mentions."""
CENTRE_STEP = 0.05
"""The distance from the middle of the picture, as a fraction of its width, over which its scale is
measured.
"""


@dataclass(frozen=True, slots=True)
class DrawnFrame:
    """The part of the undistorted image that is drawn: its middle has the place and the scale that
    it has in the picture as taken.
    """

    middle: Array
    """(2,) px, the middle of the picture as taken."""
    undistorted_middle: Array
    """(2,) px, the same point undistorted."""
    magnification: float
    """px of the picture as taken, per undistorted px, in the middle."""

    @classmethod
    def of(cls, evidence: Evidence, depth: float) -> DrawnFrame:
        """Return the frame for a depth in m."""
        camera = evidence.calibration.camera
        middle = (np.array([camera.width, camera.height]) - 1) / 2
        steps = CENTRE_STEP * camera.width * np.array([[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]])
        points = evidence.field.undistort_pixels(middle + steps, depth)
        lengths = np.linalg.norm([points[2] - points[1], points[4] - points[3]], axis=-1)
        magnification = 2 * CENTRE_STEP * camera.width / float(np.sqrt(lengths.prod()))
        if not np.isfinite([*points[0], magnification]).all():
            return cls(middle, middle, 1.0)
        return cls(middle, points[0], magnification)

    def place(self, undistorted: Array) -> Array:
        """Return the (n, 2) px in the drawn picture of (n, 2) undistorted px."""
        return self.middle + self.magnification * (undistorted - self.undistorted_middle)

    def window(self, width: int, height: int, zoom: Array) -> Window:
        """Return the window of a shrunk picture, of which a pixel has `zoom` (2,) px as taken."""
        offset = ((zoom - 1) / 2 - self.middle) / self.magnification
        corner = self.undistorted_middle + offset
        steps = zoom / self.magnification
        return Window(
            width,
            height,
            (float(corner[0]), float(corner[1])),
            (float(steps[0]), float(steps[1])),
        )


def straight_html(evidence: Evidence, session: Path | None) -> str:
    """Return the section as HTML; empty for a pinhole, which bends nothing, for a target without
    lines, and where no view has all its corners in the undistorted picture.
    """
    if evidence.bare_residuals is None or not evidence.calibration.board.has_grid:
        return ""
    camera = evidence.calibration.camera
    size = camera.width, camera.height
    order = _most_bent_first(evidence)
    for view, lines in order[:MAX_READS]:
        path = session and picture_of(session, evidence.calibration.views[view].name)
        if path and (picture := read_small(path, size, camera.width)) is not None:
            return _html(evidence, view, lines, picture)
    return _html(evidence, *order[0], None) if order else ""


def _most_bent_first(evidence: Evidence) -> list[tuple[int, list[BoardLine]]]:
    """Return the views with the largest boards, and the lines of each: those that bend most come
    first. A view with corners that figures do not show is left out.
    """
    starts = evidence.calibration.observations.starts.numpy()
    corners = np.split(evidence.pixels, starts[1:-1])
    views = [
        view for view, pixels in enumerate(corners) if len(pixels) and evidence.shows(pixels).all()
    ]
    views.sort(key=lambda view: -float(np.prod(np.ptp(corners[view], 0))))
    lines_by_view = [(view, list(grid_lines(evidence, view))) for view in views[:LARGEST_BOARDS]]
    return sorted(
        ((view, lines) for view, lines in lines_by_view if lines),
        key=lambda item: -max(line.bend for line in item[1]),
    )


def _border_to_border(first: Array, last: Array, size: tuple[int, int]) -> Array:
    """Return the (2, 2) px where the straight line through two points meets the border of the
    picture; (0, 2) if it misses the picture.
    """
    direction = last - first
    steps = np.where(np.abs(direction) < 1e-9, 1e-9, direction)
    crossings = np.stack([([-0.5, -0.5] - first) / steps, (np.array(size) - 0.5 - first) / steps])
    low = crossings.min(0).max()
    high = crossings.max(0).min()
    if low >= high:
        return np.zeros((0, 2))
    return np.asarray(first + np.array([[low], [high]]) * direction)


def _undistorted_picture(
    evidence: Evidence, picture: np.ndarray, frame: DrawnFrame, depth: float
) -> np.ndarray:
    """Return the shrunk picture as a bare pinhole camera would have taken it, with the scale of the
    frame.
    """
    camera = evidence.calibration.camera
    height, width = picture.shape
    zoom = np.array([camera.width / width, camera.height / height])
    depth_map = evidence.field.map_at(depth, frame.window(width, height, zoom))
    x = np.where(depth_map.valid, (depth_map.x + 0.5) / zoom[0] - 0.5, -9).astype(np.float32)
    y = np.where(depth_map.valid, (depth_map.y + 0.5) / zoom[1] - 0.5, -9).astype(np.float32)
    straight = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    x_plus_y = np.arange(width) + np.arange(height)[:, None]
    stripes = np.where(x_plus_y // STRIPE % 2, *STRIPES)
    return np.where(depth_map.valid, straight, stripes).astype(np.uint8)


def _html(
    evidence: Evidence, view: int, lines: Sequence[BoardLine], picture: np.ndarray | None
) -> str:
    depth = float(np.median(evidence.depth[evidence.view == view]))
    frame = DrawnFrame.of(evidence, depth)
    most_bent = max(lines, key=lambda line: line.bend)
    errors = np.concatenate(
        [distance_to_fit(line.undistorted_corners, line.undistorted) for line in lines]
    )
    rms = float(np.sqrt((errors**2).mean()))
    urls = ["", ""]
    if picture is not None:
        width = min(WIDTH, picture.shape[1])
        size = width, round(width * picture.shape[0] / picture.shape[1])
        shrunk = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        small = np.asarray(shrunk, np.uint8)
        undistorted = _undistorted_picture(evidence, small, frame, depth)
        urls = [data_url(small, MAX_BYTES), data_url(undistorted, MAX_BYTES)]
    panels = [
        _panel(
            evidence,
            [line.distorted for line in lines],
            [line.corners for line in lines],
            urls[0],
            f"As taken: rows of corners bend by up to {two_digits(most_bent.bend)} px.",
        ),
        _panel(
            evidence,
            [frame.place(line.undistorted) for line in lines],
            [frame.place(line.undistorted_corners) for line in lines],
            urls[1],
            f"Undistorted: the corners of this view are {two_digits(rms)} px (RMS) off straight"
            " lines.",
        ),
    ]
    name = escape(evidence.calibration.views[view].name)
    is_bent = any(np.abs(line.bow).max() > LEAST_BOW for line in lines)
    bend = ", without the bend of the board itself" if is_bent else ""
    absent = " The session's pictures were not found: only lines and corners are drawn."
    return (
        f"{strips_html(evidence, most_bent, picture)}"
        f'<div class="pair">{"".join(panels)}</div>'
        f"<p>{name}, and the same picture undistorted for the depth of its board, {depth:.2g} m; in"
        " the middle, both have the same scale. Blue: straight lines through the first and the last"
        f" corner of each row and column. Dots: the detected corners{bend}."
        f"{absent if picture is None else ' Stripes: what the camera does not see.'}</p>"
    )


def _panel(
    evidence: Evidence, lines: Sequence[Array], corners: Sequence[Array], picture: str, title: str
) -> str:
    """Return a picture as HTML, with the chord of each line, continued to the border, and with the
    corners.
    """
    camera = evidence.calibration.camera
    size = camera.width, camera.height
    chords = [_border_to_border(line[0], line[-1], size) for line in lines]
    guides = "".join(
        "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in chord) for chord in chords if len(chord)
    )
    dots = "".join(f"M{x:.1f} {y:.1f}h0" for row in corners for x, y in row)
    image = f'<img src="{picture}" alt="">' if picture else ""
    return (
        '<div><div class="shot lines" style="aspect-ratio:'
        f' {camera.width}/{camera.height}">{image}<svg viewBox="-0.5 -0.5 {camera.width}'
        f' {camera.height}" role="img" aria-label="{escape(title)}"><path class="straight"'
        f' d="{guides}"/><path class="dots" d="{dots}"/></svg></div><p>{escape(title)}</p></div>'
    )
