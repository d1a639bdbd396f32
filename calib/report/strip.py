"""The row or column of corners that bends most, as taken and undistorted: two strips of the
picture, enlarged across the row, so that a bend of a pixel can be seen beside a straight line.
"""

from dataclasses import dataclass
from html import escape

import cv2
import numpy as np

from calib.report.board_lines import BoardLine
from calib.report.evidence import Array, Evidence
from calib.report.pictures import data_url
from calib.rounding import two_digits

WIDTH, HEIGHT = 960, 150
"""px, of a strip."""
MARGIN = 0.02
"""The part of a strip before the first corner and after the last one, in lengths of the line."""
DRAWN_BEND = 0.3
"""The drawn bend, as a fraction of the strip's height."""
MAX_FACTOR = 60
"""The largest enlargement: the blur of an edge, a pixel or two, is enlarged as well."""
LEAST_BEND = 0.05
"""The drawn bend, as a fraction of the strip's height, below which there is nothing to see."""
CONTRAST = 4.0
"""The contrast of a strip against that of the picture, so that the blur of an edge is narrow."""
MAX_BYTES = 24_000
"""The size of a strip in the page."""
COLUMNS = 121
"""Points along a strip at which the undistortion is computed; it is interpolated in between."""
UNSEEN, UNSEEN_GREY = -9.0, 220
"""px: outside the picture, and the grey that is drawn there."""


@dataclass(frozen=True, slots=True)
class Strip:
    """A strip of a picture along a straight line."""

    start: Array
    """(2,) px, the first corner of the line."""
    chord: Array
    """(2,) px, from the first corner to the last one."""
    factor: int
    """The enlargement across the line."""

    @property
    def scale(self) -> float:
        """px of the strip per px of the picture, along the line."""
        return WIDTH / ((1 + 2 * MARGIN) * float(np.linalg.norm(self.chord)))

    @property
    def normal(self) -> Array:
        """(2,) the unit vector across the line."""
        direction = np.array([-self.chord[1], self.chord[0]])
        return np.asarray(direction / np.linalg.norm(self.chord))

    @property
    def reach(self) -> float:
        """px of the picture from the line to the border of the strip."""
        return HEIGHT / 2 / (self.scale * self.factor)

    def pixels(self, steps: Array, offsets: Array) -> Array:
        """Return the (m, n, 2) px of the picture for (n,) fractions of the line and (m,) px across
        it.
        """
        line = self.start + steps[:, None] * self.chord
        return np.asarray(line + offsets[:, None, None] * self.normal)

    def place(self, points: Array) -> Array:
        """Return the (n, 2) px of the strip of (n, 2) px of the picture."""
        offset = points - self.start
        step = offset @ self.chord / (self.chord @ self.chord)
        x = (step + MARGIN) / (1 + 2 * MARGIN) * WIDTH - 0.5
        y = offset @ self.normal * self.scale * self.factor + HEIGHT / 2 - 0.5
        return np.column_stack([x, y])

    def html(self, image: str, curve: Array, corners: Array, title: str) -> str:
        """Return the strip as HTML, with a straight line, the line as the model has it, and the
        corners.
        """
        drawn = "L".join(f"{x:.1f} {y:.1f}" for x, y in self.place(curve))
        dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in self.place(corners))
        middle = HEIGHT / 2 - 0.5
        picture = f'<img src="{image}" alt="">' if image else ""
        return (
            f'<p>{escape(title)}</p><div class="shot strip" style="aspect-ratio: {WIDTH}/{HEIGHT}">'
            f'{picture}<svg viewBox="-0.5 -0.5 {WIDTH} {HEIGHT}" role="img" aria-label='
            f'"{escape(title)}"><path class="straight" d="M-0.5 {middle}H{WIDTH}"/>'
            f'<path class="bent" d="M{drawn}"/><path class="dots" d="{dots}"/></svg></div>'
        )


def strips_html(evidence: Evidence, line: BoardLine, picture: np.ndarray | None) -> str:
    """Return both strips along a line as HTML; without a picture only lines and corners. Empty if
    the line hardly bends.
    """
    chord = line.distorted[-1] - line.distorted[0]
    factor = _factor(line.bend * Strip(line.distorted[0], chord, 1).scale)
    taken = Strip(line.distorted[0], chord, factor)
    if line.bend * taken.scale * factor < LEAST_BEND * HEIGHT:
        return ""
    undistorted_chord = line.undistorted[-1] - line.undistorted[0]
    undistorted = Strip(line.undistorted[0], undistorted_chord, factor)
    images = ["", ""]
    if picture is not None:
        images = [
            data_url(_sampled(picture, places), MAX_BYTES)
            for places in (_as_taken(line, taken), _undistorted(evidence, line, undistorted))
        ]
    enlarged = f", enlarged {factor} times across the row" if factor > 1 else ""
    return (
        '<div class="strips">'
        + taken.html(
            images[0],
            line.distorted,
            line.corners,
            f"As taken: the row bends by {two_digits(line.bend)} px.",
        )
        + undistorted.html(
            images[1],
            line.undistorted,
            line.undistorted_corners,
            f"Undistorted: its corners are {two_digits(line.rms)} px (RMS) off a straight line.",
        )
        + f"</div><p>The row or column of corners that bends most{enlarged}, with more contrast."
        " Blue: a straight line. Orange: the row by the model, and the detected corners.</p>"
    )


def _factor(drawn_bend: float) -> int:
    """Return the enlargement, with one digit, for a bend in px of a strip that is not enlarged."""
    largest = min(MAX_FACTOR, DRAWN_BEND * HEIGHT / max(drawn_bend, 1e-9))
    return max(1, int(float(f"{largest:.0e}")))


def _as_taken(line: BoardLine, strip: Strip) -> Array:
    """Return the (HEIGHT, WIDTH, 2) px of the picture for the strip as taken."""
    steps, offsets = _grid(strip, WIDTH, HEIGHT)
    return strip.pixels(steps, offsets) + _bow(line, steps)


def _undistorted(evidence: Evidence, line: BoardLine, strip: Strip) -> Array:
    """Return the (HEIGHT, WIDTH, 2) px of the picture for the undistorted strip; UNSEEN where the
    camera sees nothing.
    """
    steps, offsets = _grid(strip, COLUMNS, 2)
    undistorted = strip.pixels(steps, offsets) + _bow(line, steps)
    depth = np.interp(steps, np.linspace(0, 1, len(line.depth)), line.depth)
    depths = np.broadcast_to(depth, (2, COLUMNS)).reshape(-1)
    distorted, visible = evidence.field.distort_pixels(undistorted.reshape(-1, 2), depths)
    coarse = np.where(visible[:, None], distorted, UNSEEN).reshape(2, COLUMNS, 2)
    fine_steps, fine_offsets = _grid(strip, WIDTH, HEIGHT)
    edges = np.stack(
        [[np.interp(fine_steps, steps, edge[:, axis]) for axis in range(2)] for edge in coarse]
    )  # (2 edges, 2 axes, WIDTH)
    weight = ((fine_offsets - offsets[0]) / (offsets[1] - offsets[0]))[:, None, None]
    return np.asarray(((1 - weight) * edges[0] + weight * edges[1]).swapaxes(1, 2))


def _grid(strip: Strip, columns: int, rows: int) -> tuple[Array, Array]:
    """Return the (columns,) fractions of the line and the (rows,) px across it at the middles of
    the cells of a strip.
    """
    steps = ((np.arange(columns) + 0.5) / columns) * (1 + 2 * MARGIN) - MARGIN
    offsets = ((np.arange(rows) + 0.5) / rows * 2 - 1) * strip.reach
    return steps, offsets


def _bow(line: BoardLine, steps: Array) -> Array:
    """Return the (n, 2) px by which the board's own bend shifts the line at (n,) fractions."""
    chord = line.undistorted[-1] - line.undistorted[0]
    at_corners = (line.undistorted_corners - line.undistorted[0]) @ chord / (chord @ chord)
    return np.column_stack([np.interp(steps, at_corners, line.bow[:, axis]) for axis in range(2)])


def _sampled(picture: np.ndarray, places: Array) -> np.ndarray:
    """Return the grey of a picture at (m, n, 2) px, with more contrast."""
    x, y = np.moveaxis(places.astype(np.float32), -1, 0)
    grey = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    dark, bright = np.percentile(grey, (5, 95))
    middle = (dark + bright) / 2
    enhanced = np.clip(middle + CONTRAST * (grey - middle), dark, bright)
    return np.asarray(np.where(x < -0.5, UNSEEN_GREY, enhanced), np.uint8)
