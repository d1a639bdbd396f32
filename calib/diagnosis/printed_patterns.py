"""The closed forms nearest to a field of shifts over a board: a wave, a step, a cusp, a polynomial,
rings, or a lattice of the squares.

The sizes of a form are fitted by linear least squares for every period, direction or place of a
scan. Shifts that a pose of the board can do are projected out of form and field. The adjusted R^2
corrects for the better fit of more flexible forms by chance.

Source: M. Ezekiel, Methods of correlation analysis (1930), for the adjustment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.estimation.orthogonal_projection import project_out

Array = NDArray[np.float64]

PERIODS = 40
ANGLES = 12
"""Directions of the scan, over half a turn."""
MIN_PERIOD = 2.2
"""The shortest period, in spacings of the corners; shorter waves alias to longer ones."""
ZOOMS = 4
ZOOM_STEPS = 7
"""Steps of a finer scan along each direction."""
AXIS_TOLERANCE = np.radians(5)


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """A formula, and the fraction of a field that it explains."""

    name: str
    words: str
    """The formula in words, with its parameters."""
    explains: float
    """The adjusted fraction of the field's sum of squares."""
    cause: str
    """The usual cause of such a print."""

    def __str__(self) -> str:
        return (
            f"{self.words[0].upper()}{self.words[1:]} explains {100 * self.explains:.0f} % of the"
            f" field: {self.cause}."
        )


@dataclass(frozen=True, slots=True)
class _Form:
    columns: Array
    """(2n, k)"""
    scanned: int
    """The number of parameters that a scan chose in addition to the k sizes."""
    name: str
    words: str
    cause: str


def closed_forms(points: Array, shifts: Array, spacing: float) -> list[ClosedForm]:
    """Return the best form of each kind, the one that explains most first.

    Args:
        points: (n, 2) m, corners of the board.
        shifts: (n, 2) m, the field at these points.
        spacing: the distance between corners in m.
    """
    centred = points - (points.min(0) + points.max(0)) / 2
    pose_columns = _pose_columns(centred)
    field = project_out(pose_columns, shifts.T.ravel())
    if not field.any():
        return []

    def fraction(form: _Form) -> float:
        return _adjusted_share(project_out(pose_columns, form.columns), field, form.scanned)

    waves = [
        _wave(centred, period, angle)
        for period in _periods(centred, spacing)
        for angle in np.arange(ANGLES) * np.pi / ANGLES
    ]
    kinds: list[Iterable[_Form]] = [
        [
            _refined_wave(
                centred, max(waves, key=lambda wave: fraction(wave[1]))[0], fraction, spacing
            )
        ],
        _steps(centred, spacing),
        _cusps(centred, spacing),
        _polynomials(centred),
        [_ring(centred, period) for period in _periods(centred, spacing)],
        [_lattice(centred, spacing)],
    ]
    best = [max(kind, key=fraction) for kind in kinds]
    forms = [ClosedForm(form.name, form.words, fraction(form), form.cause) for form in best]
    return sorted(forms, key=lambda form: -form.explains)


def _adjusted_share(columns: Array, field: Array, scanned: int) -> float:
    remainder = project_out(columns, field)
    count, parameters = len(field), columns.shape[1] + scanned
    ratio = float((remainder**2).sum() / (field**2).sum())
    return float(max(0.0, 1.0 - ratio * count / max(1, count - parameters)))


def _pose_columns(points: Array) -> Array:
    """Return (2n, 4) the shifts by a pose in the board's plane: two translations, a rotation and a
    scale, because nearer boards look larger.
    """
    x, y = points.T
    zeros, unit = np.zeros_like(x), np.ones_like(x)
    return np.concatenate(
        [np.column_stack([unit, zeros, -y, x]), np.column_stack([zeros, unit, x, y])]
    )


def _both_axes(*profiles: Array) -> Array:
    """Return (2n, 2k) columns: shifts along x and along y by each (n,) profile."""
    columns = np.column_stack(profiles)
    zeros = np.zeros_like(columns)
    return np.block([[columns, zeros], [zeros, columns]])


def _periods(points: Array, spacing: float) -> Array:
    return np.geomspace(MIN_PERIOD * spacing, 2 * float(np.ptp(points, axis=0).max()), PERIODS)


def _wave(points: Array, period: float, angle: float) -> tuple[Array, _Form]:
    """Return the period and direction of a wave, and its form."""
    phase = 2 * np.pi / period * (points @ [np.cos(angle), np.sin(angle)])
    from_axis = (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4  # from the nearer axis
    degrees = f"at {np.degrees(angle) % 180:.0f} degrees to x"
    direction = (
        degrees
        if abs(from_axis) > AXIS_TOLERANCE
        else f"along {'x' if abs(np.cos(angle)) > 0.5 else 'y'}"
    )
    words = f"a wave of {1e3 * period:.0f} mm {direction}"
    form = _Form(
        _both_axes(np.cos(phase), np.sin(phase)), 2, "wave", words, "a printer's feed or drum"
    )
    return np.array([period, angle]), form


def _refined_wave(
    points: Array, start: Array, fraction: Callable[[_Form], float], spacing: float
) -> _Form:
    """Refine the best wave of the scan by finer scans."""
    best, reach = start, np.array([0.1 * start[0], np.pi / ANGLES])
    for _ in range(ZOOMS):
        offsets = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, ZOOM_STEPS)]), -1).reshape(-1, 2)
        waves = [
            _wave(points, max(float(period), MIN_PERIOD * spacing), float(angle))
            for period, angle in best + reach * offsets
        ]
        best, form = max(waves, key=lambda wave: fraction(wave[1]))
        reach = 2 * reach / (ZOOM_STEPS - 1)
    return form


def _dividing_lines(points: Array, spacing: float) -> Iterator[tuple[str, Array, float]]:
    """Yield lines between the corners: the axis that they cross, the (n,) signed distances of the
    points, and the place of the line from the board's centre, in m.
    """
    for axis, coordinate in zip("xy", points.T, strict=True):
        for place in np.arange(
            coordinate.min() + 1.5 * spacing, coordinate.max() - spacing, spacing
        ):
            yield axis, coordinate - place, float(place)


def _steps(points: Array, spacing: float) -> Iterator[_Form]:
    for axis, distance, place in _dividing_lines(points, spacing):
        words = f"a step across {axis}, {1e3 * place:+.0f} mm from the middle"
        yield _Form(
            _both_axes(np.sign(distance)),
            1,
            "step",
            words,
            "two sheets side by side, or a picture put together of parts",
        )


def _cusps(points: Array, spacing: float) -> Iterator[_Form]:
    for axis, distance, place in _dividing_lines(points, spacing):
        words = f"a cusp across {axis}, {1e3 * place:+.0f} mm from the middle"
        yield _Form(
            _both_axes(np.abs(distance)),
            1,
            "cusp",
            words,
            "a crease, or parts printed to different scales",
        )


def _polynomials(points: Array) -> Iterator[_Form]:
    u, v = (points / np.abs(points).max(0)).T
    terms: list[Array] = [u, v]  # beside what a pose can do: unequal scales and a shear
    for degree in (2, 3):
        terms += [u ** (degree - j) * v**j for j in range(degree + 1)]
        yield _Form(
            _both_axes(*terms),
            0,
            "polynomial",
            f"a polynomial of degree {degree}",
            "paper that stretched or shrank unevenly",
        )


def _ring(points: Array, period: float) -> _Form:
    radius = np.linalg.norm(points, axis=1)
    outwards = points / np.maximum(radius, 1e-12)[:, None]
    phase = 2 * np.pi * radius / period
    columns = np.concatenate(
        [outwards[:, [axis]] * np.column_stack([np.cos(phase), np.sin(phase)]) for axis in (0, 1)]
    )
    return _Form(
        columns,
        1,
        "ring",
        f"rings of {1e3 * period:.0f} mm around the middle",
        "a lens: turn the board, and it stays in the picture",
    )


def _lattice(points: Array, spacing: float) -> _Form:
    column = (-1.0) ** np.round((points[:, 0] - points[:, 0].min()) / spacing)
    row = (-1.0) ** np.round((points[:, 1] - points[:, 1].min()) / spacing)
    return _Form(
        columns=_both_axes(column, row, column * row),
        scanned=0,
        name="lattice",
        words="a lattice of the squares",
        cause="the pattern of the squares shifts the corners, as blur or sharpening does",
    )
