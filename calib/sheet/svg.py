"""Write a sheet as SVG: one unit is one mm, text is text, and the target's black areas are one
path.
"""

from xml.sax.saxutils import escape

from calib.sheet.sheet import LineSegment, Sheet, Text, decimal
from calib.sheet.target import Polygon


def to_svg(sheet: Sheet) -> str:
    """Return the file's text."""
    width, height = decimal(sheet.paper.width), decimal(sheet.paper.height)
    return "\n".join(
        (
            (
                f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm"'
                f' viewBox="0 0 {width} {height}">'
            ),
            f"<title>{escape(sheet.title)}</title>",
            f'<rect width="{width}" height="{height}" fill="white"/>',
            f'<path id="target" d="{" ".join(map(_outline, sheet.polygons))}"/>',
            *map(_line, sheet.lines),
            '<g font-family="Helvetica, Arial, Liberation Sans, sans-serif">',
            *map(_text, sheet.texts),
            "</g>",
            "</svg>\n",
        )
    )


def _outline(polygon: Polygon) -> str:
    return "M" + " ".join(f"{decimal(x)},{decimal(y)}" for x, y in polygon) + "Z"


def _line(line: LineSegment) -> str:
    x1, y1, x2, y2, width = map(decimal, (*line.start, *line.end, line.width))
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="black" stroke-width="{width}"/>'


def _text(text: Text) -> str:
    x, y, size = map(decimal, (*text.place, text.size))
    turn = f' transform="rotate(-90 {x} {y})"' if text.upwards else ""
    weight = ' font-weight="bold"' if text.bold else ""
    return f'<text x="{x}" y="{y}" font-size="{size}"{weight}{turn}>{escape(text.words)}</text>'
