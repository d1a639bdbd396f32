"""Read and write mrcal's corners file, a vnlog: "# filename x y level", then a line for each
corner.

Corners come row by row, columns fastest. A corner of level k has the weight 2^-k; "-" for x and y,
or for the level, or a negative level, marks a corner that is not visible. A picture with a single
line of "-" shows no board. Without the column `level` all corners count alike. The file may be
packed by gzip. Three more columns may give each corner's covariance, "xx xy yy", px^2;
mrcal itself reads only files without them.
"""

import math
import zlib
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError, brief
from calib.io.files import read_file, write_atomically
from calib.io.numerals import counted
from calib.session.board import Board

LEGEND = "# filename x y level"
COVARIANCE = ("xx", "xy", "yy")
HIGHEST_LEVEL = 100
"""A corner of weight 2^-100 has no influence any more, and smaller weights soon have the square
0.
"""
MAX_BYTES = 256 << 20
"""A million corners take a quarter of it, packed or not."""
BATCH_SIZE = 16_384
"""The number of lines that are read together."""
GZIP = b"\x1f\x8b"
NO_COVARIANCE = (math.nan, math.nan, math.nan)


class _Row(NamedTuple):
    line: int
    name: str
    x: float
    y: float
    weight: float
    covariance: tuple[float, ...]
    """px^2, xx, xy, yy; NaN where the file has none."""


class _Rows(NamedTuple):
    """The N rows of a file, column by column."""

    lines: NDArray[np.int64]
    """(N,) the number of each row's line."""
    names: list[str]
    corners: NDArray[np.float64]
    """(N, 2) px; NaN for a corner that is not visible."""
    weights: NDArray[np.float64]
    covariances: NDArray[np.float64]
    """(N, 3) px^2, xx, xy, yy; NaN where the file has none."""


def read_corners(path: Path, board: Board) -> tuple[View, ...]:
    """Return the views of a corners file, in its order. Pictures in which no corner is visible are
    left out.
    """
    rows = _read_rows(path)
    views: dict[str, View | None] = {}
    first = 0
    for name, group in groupby(rows.names):
        block = slice(first, first + len(list(group)))
        count, first = block.stop - block.start, block.stop
        where = f"{path}, line {rows.lines[block.start]}"
        if name in views:
            raise InputError(
                f"{where}: {brief(name)} comes a second time: keep all lines of one picture"
                " together, and each picture once."
            )
        has_corners = bool((rows.weights[block] > 0).any())
        if count != board.count and (has_corners or count > 1):
            raise InputError(
                f"{where}: {brief(name)} has {count} of the {board.count} lines that a {board}"
                ' board needs: write one for each inner corner ("-" if not seen), or correct board'
                " in session.yaml."
            )
        views[name] = _view(name, rows, block) if has_corners else None
    if not views:
        raise InputError(
            f'{path} has no corners: below "{LEGEND}", write one line for each corner of each'
            " picture."
        )
    if not any(views.values()):
        raise NotEnoughDataError(
            f"{path} lists {counted(len(views), 'picture')}, none with a board in it: detect the"
            " corners again."
        )
    return tuple(view for view in views.values() if view)


def write_corners(path: Path, views: Sequence[View]) -> None:
    """Write views so that `read_corners` returns the same numbers."""
    with_covariances = any(view.covariance is not None for view in views)
    lines = [" ".join((LEGEND, *COVARIANCE)) if with_covariances else LEGEND]
    for view in views:
        if view.name.startswith("#") or view.name.split() != [view.name]:
            raise InputError(
                f'{path} cannot name a picture "{view.name}": rename it without spaces and without'
                ' a leading "#".'
            )
        corners = [
            f"{view.name} {_format_corner(xy, weight)}"
            for xy, weight in zip(view.corners, view.weight, strict=True)
        ]
        if with_covariances:
            corners = [
                f"{corner} {_format_covariance(covariance)}"
                for corner, covariance in zip(corners, _covariances(view), strict=True)
            ]
        lines += corners
    write_atomically(path, "\n".join(lines) + "\n")


def _view(name: str, rows: _Rows, block: slice) -> View:
    variances = rows.covariances[block]
    covariance = (
        variances[:, [0, 1, 1, 2]].reshape(-1, 2, 2) if np.isfinite(variances).any() else None
    )
    return View(name, rows.corners[block], rows.weights[block], covariance=covariance)


def _covariances(view: View) -> NDArray[np.float64]:
    return np.full((len(view.weight), 2, 2), np.nan) if view.covariance is None else view.covariance


def _format_covariance(covariance: NDArray[np.float64]) -> str:
    xx = float(covariance[0, 0])
    xy = float(covariance[0, 1])
    yy = float(covariance[1, 1])
    return f"{xx!r} {xy!r} {yy!r}" if math.isfinite(xx + xy + yy) else "- - -"


def _format_corner(xy: NDArray[np.float64], weight: float) -> str:
    if not 0 <= weight <= 1:
        raise ValueError(f"a corner has the weight {weight}, where a corners file takes 0 to 1")
    if weight < 0.5**HIGHEST_LEVEL:
        return "- - -"
    return f"{float(xy[0])!r} {float(xy[1])!r} {-math.log2(weight) + 0.0:.17g}"


def _read_rows(path: Path) -> _Rows:
    data = read_file(path, MAX_BYTES)
    if data.startswith(GZIP):
        data = _unpack(path, data)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f'{path} is not a UTF-8 text file: write a vnlog that starts with "{LEGEND}".'
        ) from error
    lines = text.splitlines()
    tables = []
    legend: list[str] = []
    for first in range(0, len(lines), BATCH_SIZE):
        batch = lines[first : first + BATCH_SIZE]
        table = _visible_rows(batch, legend, first) if legend else None
        if table is None:  # a comment, a corner that is not seen, or a mistake
            rows = list(_rows(batch, legend, first, path))
            table = _Rows(
                np.array([row.line for row in rows], np.int64),
                [row.name for row in rows],
                np.array([(row.x, row.y) for row in rows], np.float64).reshape(-1, 2),
                np.array([row.weight for row in rows], np.float64),
                np.array([row.covariance for row in rows], np.float64).reshape(-1, 3),
            )
        tables.append(table)
    if not tables:
        tables.append(
            _Rows(np.zeros(0, np.int64), [], np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)))
        )
    return _Rows(
        np.concatenate([table.lines for table in tables]),
        [name for table in tables for name in table.names],
        np.concatenate([table.corners for table in tables]),
        np.concatenate([table.weights for table in tables]),
        np.concatenate([table.covariances for table in tables]),
    )


def _visible_rows(lines: Sequence[str], legend: Sequence[str], first: int) -> _Rows | None:
    """Return the rows of lines that all have a visible corner, in a tenth of the time of `_rows`;
    None for any other lines.

    Args:
        first: the number of lines before these.
    """
    if len(set(legend)) != len(legend) or not set(legend).isdisjoint(COVARIANCE):
        return None
    fields = [line.split() for line in lines]
    if any(len(row) != len(legend) or row[0][0] == "#" for row in fields):
        return None
    columns = dict(zip(legend, zip(*fields, strict=True), strict=True))
    try:
        corners = np.column_stack([[float(text) for text in columns[axis]] for axis in "xy"])
        levels = np.array([float(text) for text in columns.get("level", "0" * len(lines))])
    except ValueError:
        return None
    if not (np.isfinite(corners).all() and (levels >= 0).all() and (levels <= HIGHEST_LEVEL).all()):
        return None
    return _Rows(
        np.arange(first + 1, first + 1 + len(lines)),
        list(columns["filename"]),
        corners,
        0.5**levels,
        np.full((len(lines), len(COVARIANCE)), math.nan),
    )


def _rows(lines: Sequence[str], legend: list[str], first: int, path: Path) -> Iterator[_Row]:
    """Yield the rows of any lines.

    Args:
        legend: the names of the columns, which this function adds when it reads them.
        first: the number of lines before these.
    """
    for number, line in enumerate(lines, start=first + 1):
        fields = line.split()
        if not fields:
            continue
        if line.lstrip().startswith("#"):
            columns = line.lstrip()[1:].split()
            if not legend and {"filename", "x", "y"} <= set(columns):
                legend += columns
            continue
        where = f"{path}, line {number}"
        if not legend:
            raise InputError(
                f'{where}: no line above says what the columns are: start the file with "{LEGEND}".'
            )
        if len(fields) != len(legend):
            raise InputError(
                f'{where} has {len(fields)} columns: write {len(legend)}, "{" ".join(legend)}" ("-"'
                " for none)."
            )
        yield _row(dict(zip(legend, fields, strict=True)), number, where)


def _unpack(path: Path, data: bytes) -> bytes:
    """Return the contents of a gzip file; InputError if it is damaged or too large."""
    unpacker = zlib.decompressobj(wbits=16 + zlib.MAX_WBITS)
    try:
        text = unpacker.decompress(data, MAX_BYTES)
    except zlib.error as error:
        raise InputError(
            f"{path} is a damaged gzip file ({brief(error)}): unpack it with gunzip, or copy it"
            " again."
        ) from error
    if not unpacker.eof:
        raise InputError(
            f"{path} is a gzip file that is incomplete, or larger than {MAX_BYTES >> 20} MB when"
            " unpacked: copy it again."
        )
    return text


def _row(fields: dict[str, str], number: int, where: str) -> _Row:
    x = _number(fields["x"], "x", where)
    y = _number(fields["y"], "y", where)
    level = _number(fields.get("level", "0"), "level", where)
    if level is not None and level > HIGHEST_LEVEL:
        raise InputError(
            f"{where}: level is {level:g}: write 0 for the best corners, 1 for vaguer ones, and so"
            ' on, or "-" if not seen.'
        )
    if (x is None) != (y is None):
        raise InputError(
            f'{where}: only one of x and y is "-": write both numbers, or "-" for both if the'
            " corner was not seen."
        )
    weight = 0.5**level if level is not None and level >= 0 else 0.0
    if x is None or y is None or weight == 0:
        return _Row(number, fields["filename"], math.nan, math.nan, 0.0, NO_COVARIANCE)
    xx = _number(fields.get("xx", "-"), "xx", where)
    xy = _number(fields.get("xy", "-"), "xy", where)
    yy = _number(fields.get("yy", "-"), "yy", where)
    if xx is None or xy is None or yy is None:
        return _Row(number, fields["filename"], x, y, weight, NO_COVARIANCE)
    if xx <= 0 or xx * yy <= xy**2:
        raise InputError(
            f"{where}: xx, xy and yy are {xx:g}, {xy:g} and {yy:g}, which is no covariance: correct"
            ' them, or write "- - -".'
        )
    return _Row(number, fields["filename"], x, y, weight, (xx, xy, yy))


def _number(text: str, column: str, where: str) -> float | None:
    if text == "-":
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f'{where}: {column} is "{brief(text)}": write a number, or "-" if the corner was not'
            " seen."
        )
    return value
