"""What a splined lens has beside a fisheye's numbers: control points of a displacement over the
picture.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib.session.schema import Quantity, Section

FEWEST, MOST = 4, 100
SHIFT = Quantity("spline")
EXAMPLE = "{columns: 8, rows: 6, x_px: [...], y_px: [...]}"


@dataclass(frozen=True, slots=True)
class Spline:
    """Control points of a bicubic B-spline surface, evenly over the picture and one spacing beyond
    it on every side; they are held.
    """

    size: tuple[int, int]
    """px, of the picture."""
    columns: int
    rows: int
    x: tuple[float, ...]
    """(rows * columns,) px, row by row: what is added to a pixel's x before the fisheye's formula.
    """
    y: tuple[float, ...]
    """The same of y."""


def read_spline(intrinsics: Section, size: tuple[int, int]) -> Spline:
    section = intrinsics.section("spline", EXAMPLE)
    section.only(("columns", "rows", "x_px", "y_px"))
    columns, rows = (section.whole(key, FEWEST, MOST) for key in ("columns", "rows"))
    x, y = (_shifts(section, key, columns * rows) for key in ("x_px", "y_px"))
    return Spline(size, columns, rows, x, y)


def spline_to_yaml(spline: Spline) -> dict[str, object]:
    """The mapping that `read_spline` reads as this spline."""
    return {
        "columns": spline.columns,
        "rows": spline.rows,
        "x_px": list(spline.x),
        "y_px": list(spline.y),
    }


def _shifts(section: Section, key: str, count: int) -> tuple[float, ...]:
    expected = f"a list of {count} numbers, rows times columns of them"
    written = section.get(key, expected)
    if not isinstance(written, list) or len(written) != count:
        raise section.wrong(key, written, expected)
    return tuple(
        section.number(f"{key}[{i}]", entry, SHIFT).value for i, entry in enumerate(written)
    )
