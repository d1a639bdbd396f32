"""The closed forms nearest to a field of shifts over a board: a wave, a step, a cusp, a low
polynomial, a ring, a lattice of the squares.

A form's sizes are fitted by linear least squares for every period, direction or place of a scan;
what a pose of the board does as well is projected out of form and field. That the more flexible
form fits better by chance is allowed for as the adjusted R^2 allows for it.

Source: M. Ezekiel, Methods of correlation analysis (1930), for the adjustment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PERIODS = 40
ANGLES = 12
"""Of the scan, over half a turn."""
FINEST = 2.2
"""Spacings of the corners: shorter waves look like longer ones."""
ZOOMS = 4
ACROSS = 7
"""Of a finer scan, along each direction."""
ALONG_AN_AXIS = np.radians(5)


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """One formula and how much of a field it is."""

    name: str
    words: str
    """With its parameters."""
    explains: float
    """The fraction of the field's sum of squares, adjusted."""
    cause: str
    """What prints so."""

    def __str__(self) -> str:
        return (
            f"{self.words[0].upper()}{self.words[1:]} explains {100 * self.explains:.0f} % of the"
            f" field: {self.cause}."
        )


@dataclass(frozen=True, slots=True)
class _Form:
    columns: Array
    """(2n, k)"""
    chosen: int
    """Parameters that a scan chose beside the k sizes."""
    name: str
    words: str
    cause: str


def closed_forms(points: Array, shifts: Array, spacing: float) -> list[ClosedForm]:
    """The best of each kind, the one that explains most first.

    Args:
        points: (n, 2) m, corners of the board.
        shifts: (n, 2) m, the field there.
        spacing: m between the corners.
    """
    at = points - (points.min(0) + points.max(0)) / 2
    still = _poses(at)
    field = _without(still, shifts.T.ravel())
    if not field.any():
        return []

    def explained(form: _Form) -> float:
        return _share(_without(still, form.columns), field, form.chosen)

    waves = [
        _wave(at, period, angle)
        for period in _periods(at, spacing)
        for angle in np.arange(ANGLES) * np.pi / ANGLES
    ]
    kinds: list[Iterable[_Form]] = [
        [_finest_wave(at, max(waves, key=lambda wave: explained(wave[1]))[0], explained, spacing)],
        _steps(at, spacing),
        _cusps(at, spacing),
        _polynomials(at),
        [_ring(at, period) for period in _periods(at, spacing)],
        [_lattice(at, spacing)],
    ]
    best = [max(kind, key=explained) for kind in kinds]
    found = [ClosedForm(form.name, form.words, explained(form), form.cause) for form in best]
    return sorted(found, key=lambda form: -form.explains)


def _share(columns: Array, field: Array, chosen: int) -> float:
    left = _without(columns, field)
    count, free = len(field), columns.shape[1] + chosen
    remains = float((left**2).sum() / (field**2).sum())
    return float(max(0.0, 1.0 - remains * count / max(1, count - free)))


def _without(columns: Array, rows: Array) -> Array:
    return np.asarray(rows - columns @ np.linalg.lstsq(columns, rows, rcond=1e-9)[0])


def _poses(at: Array) -> Array:
    """(2n, 4) what a pose does in the board's plane: shifts, a turn, and a scale, as nearer boards
    are larger.
    """
    x, y = at.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    return np.concatenate([np.column_stack([one, zero, -y, x]), np.column_stack([zero, one, x, y])])


def _each_way(*profiles: Array) -> Array:
    """(2n, 2k) of (n,) profiles: a shift along x and one along y by each."""
    along = np.column_stack(profiles)
    zero = np.zeros_like(along)
    return np.block([[along, zero], [zero, along]])


def _periods(at: Array, spacing: float) -> Array:
    return np.geomspace(FINEST * spacing, 2 * float(np.ptp(at, axis=0).max()), PERIODS)


def _wave(at: Array, period: float, angle: float) -> tuple[Array, _Form]:
    """Where it stands in the scan, and itself."""
    phase = 2 * np.pi / period * (at @ [np.cos(angle), np.sin(angle)])
    off = (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4  # from the nearer axis
    degrees = f"at {np.degrees(angle) % 180:.0f} degrees to x"
    way = (
        degrees if abs(off) > ALONG_AN_AXIS else f"along {'x' if abs(np.cos(angle)) > 0.5 else 'y'}"
    )
    words = f"a wave of {1e3 * period:.0f} mm {way}"
    form = _Form(
        _each_way(np.cos(phase), np.sin(phase)), 2, "wave", words, "a printer's feed or drum"
    )
    return np.array([period, angle]), form


def _finest_wave(
    at: Array, start: Array, explained: Callable[[_Form], float], spacing: float
) -> _Form:
    """From the scan's best on, by scans ever finer."""
    place, reach = start, np.array([0.1 * start[0], np.pi / ANGLES])
    for _ in range(ZOOMS):
        steps = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, ACROSS)]), -1).reshape(-1, 2)
        tried = [
            _wave(at, max(float(period), FINEST * spacing), float(angle))
            for period, angle in place + reach * steps
        ]
        place, form = max(tried, key=lambda wave: explained(wave[1]))
        reach = 2 * reach / (ACROSS - 1)
    return form


def _places(at: Array, spacing: float) -> Iterator[tuple[str, Array, float]]:
    """Lines between the corners, with the (n,) distances from them and, in m, where they are from
    the board's middle.
    """
    for axis, along in zip("xy", at.T, strict=True):
        for place in np.arange(along.min() + 1.5 * spacing, along.max() - spacing, spacing):
            yield axis, along - place, float(place)


def _steps(at: Array, spacing: float) -> Iterator[_Form]:
    for axis, along, place in _places(at, spacing):
        words = f"a step across {axis}, {1e3 * place:+.0f} mm from the middle"
        yield _Form(
            _each_way(np.sign(along)),
            1,
            "step",
            words,
            "two sheets side by side, or a picture put together of parts",
        )


def _cusps(at: Array, spacing: float) -> Iterator[_Form]:
    for axis, along, place in _places(at, spacing):
        words = f"a cusp across {axis}, {1e3 * place:+.0f} mm from the middle"
        yield _Form(
            _each_way(np.abs(along)),
            1,
            "cusp",
            words,
            "a crease, or parts printed to different scales",
        )


def _polynomials(at: Array) -> Iterator[_Form]:
    u, v = (at / np.abs(at).max(0)).T
    terms: list[Array] = [u, v]  # beside what a pose can do: unequal scales and a shear
    for degree in (2, 3):
        terms += [u ** (degree - j) * v**j for j in range(degree + 1)]
        yield _Form(
            _each_way(*terms),
            0,
            "polynomial",
            f"a polynomial of degree {degree}",
            "paper that stretched or shrank unevenly",
        )


def _ring(at: Array, period: float) -> _Form:
    radius = np.linalg.norm(at, axis=1)
    outwards = at / np.maximum(radius, 1e-12)[:, None]
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


def _lattice(at: Array, spacing: float) -> _Form:
    column, row = ((-1.0) ** np.round((along - along.min()) / spacing) for along in at.T)
    cause = "corners pulled by the squares' own pattern, as blur or sharpening does"
    return _Form(
        _each_way(column, row, column * row), 0, "lattice", "a lattice of the squares", cause
    )
