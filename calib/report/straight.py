"""The section of a report that shows a picture before and after undistortion, with the rows and
columns of its board.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
import torch

from calib.optics.board_target import Target
from calib.report.evidence import Array, Evidence
from calib.report.pictures import data_url, picture_of, read_small
from calib.undistortion.window import Window

WIDTH = 640
"""The largest width of a picture in px."""
MAX_BYTES = 40_000
"""The size of a picture in the page."""
MAX_DRAWN_BEND = 0.035
"""The largest drawn bend, as a fraction of the image's width."""
MIN_FACTOR = 4
"""The smallest factor by which bends are enlarged."""
SAMPLES = 41
"""Points of a drawn line."""
MAX_READS = 5
"""Pictures to try, largest board first. If none of them can be read, the session is gone."""
STRIPES = 208, 232
"""The greys of the stripes over pixels that the camera does not see."""
STRIPE = 6
"""px: the width of a stripe."""


@dataclass(frozen=True, slots=True)
class BoardLine:
    """A row or column of a board, continued across the picture."""

    distorted: Array
    """(n, 2) px, the line through lens and cover, by the model."""
    undistorted: Array
    """(k, 2) px, the straight line."""
    corners: Array
    """(c, 2) px, the detected corners of the line."""
    undistorted_corners: Array
    """(c, 2) px, these corners undistorted."""


def straight_html(evidence: Evidence, session: Path | None) -> str:
    """Return the section as HTML; empty for a pinhole, which bends nothing, for a
    target without lines, and where no view has
    all its corners in the undistorted picture.
    """
    if evidence.bare_residuals is None or not evidence.calibration.board.has_grid:
        return ""
    camera = evidence.calibration.camera
    size = camera.width, camera.height
    order = _largest_first(evidence)
    if not order:
        return ""
    for view in order[:MAX_READS]:
        path = session and picture_of(session, evidence.calibration.views[view].name)
        if path and (picture := read_small(path, size, min(WIDTH, camera.width))) is not None:
            return _html(evidence, view, picture)
    return _html(evidence, order[0], None)


def _largest_first(evidence: Evidence) -> list[int]:
    """Return the views whose corners figures show, those that span most of the picture first."""
    corners = [
        evidence.pixels[evidence.view == view] for view in range(len(evidence.calibration.views))
    ]
    return sorted(
        (view for view, pixels in enumerate(corners) if evidence.shows(pixels).all()),
        key=lambda view: -float(np.prod(np.ptp(corners[view], 0))) if len(corners[view]) else 0.0,
    )


def lines_across(evidence: Evidence, view: int) -> Iterator[BoardLine]:
    """Yield the rows and columns of a view's board that lie in the picture."""
    board = evidence.calibration.board
    camera = evidence.calibration.camera
    pose = evidence.calibration.poses[view, :6]
    rotation = cv2.Rodrigues(pose[:3])[0]
    focal, centre = _pinhole(evidence)
    flat = np.column_stack([board.points(), np.zeros(board.count)]) @ rotation.T + pose[3:]
    places = (focal * flat[:, :2] / flat[:, 2:] + centre).reshape(board.rows, board.columns, 2)
    detected, undistorted = _corner_grids(evidence, view)
    rows = zip(places, detected, undistorted, strict=True)
    columns = zip(*(grid.swapaxes(0, 1) for grid in (places, detected, undistorted)), strict=True)
    across = list(chain(rows, columns))
    lines = [
        _border_to_border(place[0], place[-1], (camera.width, camera.height))
        for place, _, _ in across
    ]
    points = np.concatenate(lines)
    directions = np.column_stack([(points - centre) / focal, np.ones(len(points))])
    slope = directions @ rotation[:, 2]
    slope = np.where(np.abs(slope) < 1e-6, np.nan, slope)
    depth = pose[3:] @ rotation[:, 2] / slope  # m, on the board's plane
    near = depth > evidence.reach[0] / 2  # excludes the plane's passage past the camera
    distorted = np.full_like(points, np.nan)
    visible = np.zeros(len(points), np.bool_)
    distorted[near], visible[near] = evidence.field.distort_pixels(points[near], depth[near])
    ends = np.cumsum([len(line) for line in lines])
    for (_, corners, straight), line, end in zip(across, lines, ends, strict=True):
        part = slice(end - len(line), end)
        detections = np.isfinite(corners).all(-1)
        if visible[part].sum() > 2:
            seen = distorted[part][visible[part]]
            yield BoardLine(seen, line, corners[detections], straight[detections])


def _border_to_border(first: Array, last: Array, size: tuple[int, int]) -> Array:
    """Return (SAMPLES, 2) px of the straight line through two points, from border to border of the
    picture; (0, 2) if it misses the picture.
    """
    direction = last - first
    steps = np.where(np.abs(direction) < 1e-9, 1e-9, direction)
    crossings = np.stack([([-0.5, -0.5] - first) / steps, (np.array(size) - 0.5 - first) / steps])
    low = crossings.min(0).max()
    high = crossings.max(0).min()
    if low >= high:
        return np.zeros((0, 2))
    return np.asarray(first + np.linspace(low, high, SAMPLES)[:, None] * direction)


def _corner_grids(evidence: Evidence, view: int) -> Array:
    """Return (2, rows, columns, 2) px: a view's detected corners, and the same undistorted, both
    without the shift by the board's bow or motion; NaN where a corner was not detected.
    """
    board = evidence.calibration.board
    observations = evidence.calibration.observations
    in_view = evidence.view == view
    poses = torch.from_numpy(evidence.calibration.poses)[observations.view]
    exposure = observations.exposure
    actual = evidence.path.place(observations.corners, evidence.values, poses, exposure)
    flat_path = replace(evidence.path, target=Target())
    flat = flat_path.place(observations.corners, {}, poses[:, :6], exposure)
    focal, _ = _pinhole(evidence)
    shift = focal * (flat[:, :2] / flat[:, 2:] - actual[:, :2] / actual[:, 2:]).numpy()
    undistorted = evidence.field.undistort_pixels(evidence.pixels, evidence.depth)
    grids = np.full((2, board.count, 2), np.nan)
    detected = evidence.calibration.views[view].seen
    grids[0, detected] = (evidence.pixels + shift)[in_view]
    grids[1, detected] = (undistorted + shift)[in_view]
    return grids.reshape(2, board.rows, board.columns, 2)


def _pinhole(evidence: Evidence) -> tuple[Array, Array]:
    """Return the focal lengths (2,) px and the principal point (2,) px of undistorted pixels."""
    k = evidence.calibration.camera.intrinsics
    assert k
    return np.array([k.fx.value, k.fy.value]), np.array([k.cx.value, k.cy.value])


def _undistorted_picture(evidence: Evidence, picture: np.ndarray, depth: float) -> np.ndarray:
    """Return the shrunk picture as the bare pinhole camera would have taken it."""
    camera = evidence.calibration.camera
    height, width = picture.shape
    zoom = camera.width / width, camera.height / height
    window = Window(width, height, ((zoom[0] - 1) / 2, (zoom[1] - 1) / 2), zoom)
    depth_map = evidence.field.map_at(depth, window)
    x = np.where(depth_map.valid, (depth_map.x + 0.5) / zoom[0] - 0.5, -9).astype(np.float32)
    y = np.where(depth_map.valid, (depth_map.y + 0.5) / zoom[1] - 0.5, -9).astype(np.float32)
    straight = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    x_plus_y = np.arange(width) + np.arange(height)[:, None]
    stripes = np.where(x_plus_y // STRIPE % 2, *STRIPES)
    return np.where(depth_map.valid, straight, stripes).astype(np.uint8)


def _html(evidence: Evidence, view: int, picture: np.ndarray | None) -> str:
    lines = list(lines_across(evidence, view))
    if not lines:
        return ""
    depth = float(np.median(evidence.depth[evidence.view == view]))
    bends = [
        np.linalg.norm(line.distorted - _nearest_on_line(line.distorted, line.distorted), axis=-1)
        for line in lines
    ]
    bend = max(float(lengths.max()) for lengths in bends)
    errors = np.concatenate(
        [
            line.undistorted_corners - _nearest_on_line(line.undistorted_corners, line.undistorted)
            for line in lines
        ]
    )
    rms = float(np.sqrt((errors**2).sum(-1).mean()))
    largest = 0.95 * MAX_DRAWN_BEND * evidence.calibration.camera.width
    factor = max(1, int(float(f"{largest / max(bend, 1e-9):.0e}")))
    if factor < MIN_FACTOR:  # such a bend is visible as it is, and the lines lie on the squares
        factor = 1
    distorted_url = ""
    undistorted_url = ""
    if picture is not None:
        distorted_url = data_url(picture, MAX_BYTES)
        undistorted_url = data_url(_undistorted_picture(evidence, picture, depth), MAX_BYTES)
    distorted_panel = _panel(
        evidence,
        [(line.distorted, line.corners) for line in lines],
        factor,
        distorted_url,
        f"As taken: straight lines bend by up to {bend:.2g} px.",
    )
    undistorted_panel = _panel(
        evidence,
        [(line.undistorted, line.undistorted_corners) for line in lines],
        factor,
        undistorted_url,
        f"Undistorted: the corners of this view are {rms:.2g} px (RMS) off straight lines.",
    )
    scale = (
        f" Bends are enlarged {factor} times, so the orange lines do not lie on the squares."
        if factor > 1
        else ""
    )
    name = escape(evidence.calibration.views[view].name)
    absent = " The session's pictures were not found: only lines and corners are drawn."
    return (
        f'<div class="pair">{distorted_panel}{undistorted_panel}</div>'
        f"<p>{name}, and the same picture undistorted for the depth of its board, {depth:.2g} m."
        f"{scale} Orange: the rows and columns of the board, continued across the picture, as lens"
        " and cover show them. Blue: straight lines. Dots: the detected corners, on the same scale,"
        " without the bend of the board itself."
        f"{absent if picture is None else ' Stripes: what the camera does not see.'}</p>"
    )


def _nearest_on_line(points: Array, line: Array) -> Array:
    """Return the (n, 2) px nearest to (n, 2) points on the straight line that fits a (k, 2) px line
    best.
    """
    middle = line.mean(0)
    direction = np.linalg.svd(line - middle, full_matrices=False)[2][0]
    return np.asarray(middle + np.outer((points - middle) @ direction, direction))


def _panel(
    evidence: Evidence, lines: list[tuple[Array, Array]], factor: float, picture: str, title: str
) -> str:
    """Return a picture with lines and their corners as HTML; bends are enlarged by `factor`."""
    camera = evidence.calibration.camera

    def enlarged(points: Array, line: Array) -> list[str]:
        nearest = _nearest_on_line(points, line)
        return [f"{x:.1f} {y:.1f}" for x, y in nearest + factor * (points - nearest)]

    straight = "".join(
        "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in _nearest_on_line(line[[0, -1]], line))
        for line, _ in lines
    )
    bent = "".join("M" + "L".join(enlarged(line, line)) for line, _ in lines)
    dots = "".join(f"M{place}h0" for line, corners in lines for place in enlarged(corners, line))
    image = f'<img src="{picture}" alt="">' if picture else ""
    return (
        '<div><div class="shot lines" style="aspect-ratio:'
        f' {camera.width}/{camera.height}">{image}<svg viewBox="-0.5 -0.5 {camera.width}'
        f' {camera.height}" role="img" aria-label="{escape(title)}"><path class="bent"'
        f' d="{bent}"/><path class="straight" d="{straight}"/><path class="dots"'
        f' d="{dots}"/></svg></div><p>{escape(title)}</p></div>'
    )
