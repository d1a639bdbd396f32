"""The additional numbers of a splined lens: control points of a displacement over the picture,
applied before a fisheye's formula.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib.session.schema import Quantity, Section

MIN_CONTROL_POINTS = 4
MAX_CONTROL_POINTS = 100
SHIFT = Quantity("spline")
EXAMPLE = "{columns: 8, rows: 6, x_px: [...], y_px: [...]}"


@dataclass(frozen=True, slots=True)
class LensSpline:
    """Control points of a bicubic B-spline surface, evenly spaced over the picture and one spacing
    beyond it on every side. A fit holds them fixed.
    """

    size: tuple[int, int]
    """px, of the picture."""
    columns: int
    rows: int
    x: tuple[float, ...]
    """(rows * columns,) px, row by row: the offset added to a pixel's x before the fisheye's
    formula.
    """
    y: tuple[float, ...]
    """(rows * columns,) px, the offset added to y."""


def read_spline(intrinsics: Section, size: tuple[int, int]) -> LensSpline:
    """Read the section `spline`; `size` is the picture's width and height, px."""
    section = intrinsics.section("spline", EXAMPLE)
    section.allow_only(("columns", "rows", "x_px", "y_px"))
    columns = section.integer("columns", MIN_CONTROL_POINTS, MAX_CONTROL_POINTS)
    rows = section.integer("rows", MIN_CONTROL_POINTS, MAX_CONTROL_POINTS)
    x = _offsets(section, "x_px", columns * rows)
    y = _offsets(section, "y_px", columns * rows)
    return LensSpline(size, columns, rows, x, y)


def spline_to_yaml(spline: LensSpline) -> dict[str, object]:
    """Return the mapping that `read_spline` reads as this spline."""
    return {
        "columns": spline.columns,
        "rows": spline.rows,
        "x_px": list(spline.x),
        "y_px": list(spline.y),
    }


def _offsets(section: Section, key: str, count: int) -> tuple[float, ...]:
    """Return the `count` numbers under a key."""
    expected = f"a list of {count} numbers, rows times columns of them"
    offsets = section.get(key, expected)
    if not isinstance(offsets, list) or len(offsets) != count:
        raise section.error(key, offsets, expected)
    return tuple(
        section.number(f"{key}[{i}]", entry, SHIFT).value for i, entry in enumerate(offsets)
    )
