"""Bent lines became straight: one of the session's pictures as it is and undistorted, its board's
rows and columns drawn across it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import cv2
import numpy as np
import torch

from calib.optics.board_target import Target
from calib.report.evidence import Array, Evidence
from calib.report.pictures import data_url, picture_of, read_small
from calib.undistortion.window import Window

WIDTH = 640
"""px of a picture, at most."""
DRAWN = 0.035
"""Of the image's width: how far the largest bend may be drawn."""
SAMPLES = 41
"""Points of a line that is drawn."""
ASKED = 5
"""Pictures, from the largest board on: where none of them can be read, the session is gone."""
UNSEEN = 96
"""Grey where the camera sees nothing."""


@dataclass(frozen=True, slots=True)
class Line:
    """A row or a column of a board, across the picture."""

    before: Array
    """(n, 2) px, as the model sees it through lens and cover."""
    after: Array
    """(k, 2) px, undistorted: straight."""
    seen: Array
    """(c, 2) px, its corners as they were detected."""
    undistorted: Array
    """(c, 2) px, these undistorted."""


def straight_html(evidence: Evidence, session: Path | None) -> str:
    """Empty where the model is a pinhole, which bends nothing, or where no undistorted picture
    holds all of a view's corners.
    """
    if evidence.bare_missed is None:
        return ""
    camera = evidence.calibration.camera
    size = camera.width, camera.height
    order = _largest_first(evidence)
    if not order:
        return ""
    for view in order[:ASKED]:
        path = session and picture_of(session, evidence.calibration.views[view].name)
        if path and (picture := read_small(path, size, min(WIDTH, camera.width))) is not None:
            return _html(evidence, view, picture)
    return _html(evidence, order[0], None)


def _largest_first(evidence: Evidence) -> list[int]:
    """The views by how much of the picture their corners span, of those whose corners figures
    show.
    """
    own = [
        evidence.pixels[evidence.view == view] for view in range(len(evidence.calibration.views))
    ]
    return sorted(
        (view for view in range(len(own)) if evidence.shows(own[view]).all()),
        key=lambda view: -float(np.prod(np.ptp(own[view], 0))) if len(own[view]) else 0.0,
    )


def lines_across(evidence: Evidence, view: int) -> Iterator[Line]:
    board, camera = evidence.calibration.board, evidence.calibration.camera
    pose = evidence.calibration.poses[view, :6]
    turn = cv2.Rodrigues(pose[:3])[0]
    focal, centre = _pinhole(evidence)
    flat = np.column_stack([board.points(), np.zeros(board.count)]) @ turn.T + pose[3:]
    lattices = _lattices(evidence, view)
    places = (focal * flat[:, :2] / flat[:, 2:] + centre).reshape(board.rows, board.columns, 2)
    for by_rows in (True, False):
        ends, seen, undistorted = (
            one if by_rows else one.swapaxes(0, 1) for one in (places, *lattices)
        )
        for along, own, straight in zip(ends, seen, undistorted, strict=True):
            after = _across(along[0], along[-1], (camera.width, camera.height))
            towards = np.column_stack([(after - centre) / focal, np.ones(len(after))]) @ turn[:, 2]
            depth = (
                pose[3:] @ turn[:, 2] / np.where(np.abs(towards) < 1e-6, np.nan, towards)
            )  # m, on the board's plane
            there = depth > evidence.reach[0] / 2  # not where the plane passes the camera
            before, sees = evidence.field.distorted(after[there], depth[there])
            found = np.isfinite(own).all(-1)
            if sees.sum() > 2:
                yield Line(before[sees], after, own[found], straight[found])


def _across(first: Array, last: Array, size: tuple[int, int]) -> Array:
    """(SAMPLES, 2) px of the straight line through two points, from border to border of the
    picture; none where it passes by.
    """
    along = last - first
    steps = np.where(np.abs(along) < 1e-9, 1e-9, along)
    ends = np.sort(
        [(np.array([-0.5, -0.5]) - first) / steps, (np.array(size) - 0.5 - first) / steps], 0
    )
    low, high = ends[0].max(), ends[1].min()
    return (
        np.asarray(first + np.linspace(low, high, SAMPLES)[:, None] * along)
        if low < high
        else np.zeros((0, 2))
    )


def _lattices(evidence: Evidence, view: int) -> Array:
    """(2, rows, columns, 2) px: a view's corners as they were seen and undistorted, less what its
    board's own bow or motion moves them by; NaN where not seen.
    """
    board, observations = evidence.calibration.board, evidence.calibration.observations
    own, poses = (
        evidence.view == view,
        torch.from_numpy(evidence.calibration.poses)[observations.view],
    )
    there = evidence.path.place(
        observations.corners, observations.with_times(evidence.values), poses
    )
    flat = replace(evidence.path, target=Target()).place(observations.corners, {}, poses[:, :6])
    shift = (
        _pinhole(evidence)[0] * (flat[:, :2] / flat[:, 2:] - there[:, :2] / there[:, 2:]).numpy()
    )
    undistorted = evidence.field.undistorted(evidence.pixels, evidence.depth)
    lattices = np.full((2, board.count, 2), np.nan)
    lattices[:, evidence.calibration.views[view].seen] = (
        (evidence.pixels + shift)[own],
        (undistorted + shift)[own],
    )
    return lattices.reshape(2, board.rows, board.columns, 2)


def _pinhole(evidence: Evidence) -> tuple[Array, Array]:
    """(2,) px focal lengths and (2,) px principal point that undistorted pixels are of."""
    k = evidence.calibration.camera.intrinsics
    assert k
    return np.array([k.fx.value, k.fy.value]), np.array([k.cx.value, k.cy.value])


def _undistorted(evidence: Evidence, picture: np.ndarray, depth: float) -> np.ndarray:
    """The shrunk picture as the bare pinhole camera would have taken it."""
    camera = evidence.calibration.camera
    height, width = picture.shape
    zoom = camera.width / width, camera.height / height
    made = evidence.field.map_at(
        depth, Window(width, height, ((zoom[0] - 1) / 2, (zoom[1] - 1) / 2), zoom)
    )
    x, y = (
        np.where(made.valid, (at + 0.5) / by - 0.5, -9).astype(np.float32)
        for at, by in zip((made.x, made.y), zoom, strict=True)
    )
    return cv2.remap(
        picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT, borderValue=UNSEEN
    )


def _html(evidence: Evidence, view: int, picture: np.ndarray | None) -> str:
    lines = list(lines_across(evidence, view))
    if not lines:
        return ""
    depth = float(np.median(evidence.depth[evidence.view == view]))
    bend = max(
        float(np.linalg.norm(line.before - _feet(line.before, line.before), axis=-1).max())
        for line in lines
    )
    off = np.concatenate([line.undistorted - _feet(line.undistorted, line.after) for line in lines])
    left = float(np.sqrt((off**2).sum(-1).mean()))
    factor = max(
        1, int(float(f"{0.95 * DRAWN * evidence.calibration.camera.width / max(bend, 1e-9):.0e}"))
    )
    shown = (
        (data_url(picture), data_url(_undistorted(evidence, picture, depth)))
        if picture is not None
        else ("", "")
    )
    before = [(line.before, line.seen) for line in lines]
    after = [(line.after, line.undistorted) for line in lines]
    panels = (
        _panel(
            evidence,
            before,
            factor,
            shown[0],
            f"As it was taken: straight lines bend by up to {bend:.2g} px.",
        ),
        _panel(
            evidence,
            after,
            factor,
            shown[1],
            f"Undistorted: corners lie beside straight lines by {left:.2g} px (RMS).",
        ),
    )
    said = f", drawn {factor} times as large" if factor > 1 else ""
    name = escape(evidence.calibration.views[view].name)
    gone = (
        ""
        if picture is not None
        else (
            " The session's pictures were not found, or it has none: only lines and corners are"
            " drawn."
        )
    )
    return (
        f'<div class="pair">{"".join(panels)}</div>'
        f"<p>{name}, and the same undistorted for the depth of its board, {depth:.2g} m. Orange:"
        " the board's rows and columns, continued "
        "across the picture, as lens and cover show them; how far they are from straight lines,"
        f" blue, is what they bend{said}. Dots: the "
        f"corners that were detected, likewise, less what the board itself is bent.{gone}</p>"
    )


def _feet(points: Array, line: Array) -> Array:
    """(n, 2) px on the straight line that misses the (k, 2) px of a line least, the nearest to (n,
    2) px.
    """
    middle = line.mean(0)
    along = np.linalg.svd(line - middle, full_matrices=False)[2][0]
    return np.asarray(middle + np.outer((points - middle) @ along, along))


def _panel(
    evidence: Evidence, lines: list[tuple[Array, Array]], factor: float, picture: str, title: str
) -> str:
    """Args: lines: each with its corners."""
    camera = evidence.calibration.camera

    def drawn(points: Array, line: Array) -> list[str]:
        feet = _feet(points, line)
        return [f"{x:.1f} {y:.1f}" for x, y in feet + factor * (points - feet)]

    straight = "".join(
        "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in _feet(line[[0, -1]], line))
        for line, _ in lines
    )
    bent = "".join("M" + "L".join(drawn(line, line)) for line, _ in lines)
    dots = "".join(f"M{place}h0" for line, corners in lines for place in drawn(corners, line))
    image = f'<img src="{picture}" alt="">' if picture else ""
    return (
        '<div><div class="shot lines" style="aspect-ratio:'
        f' {camera.width}/{camera.height}">{image}<svg viewBox="-0.5 -0.5 {camera.width}'
        f' {camera.height}" role="img" aria-label="{escape(title)}"><path class="bent"'
        f' d="{bent}"/><path class="straight" d="{straight}"/><path class="dots"'
        f' d="{dots}"/></svg></div><p>{escape(title)}</p></div>'
    )
