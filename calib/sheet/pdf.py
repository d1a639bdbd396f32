"""Write a sheet as PDF 1.4: one page in mm, in black, with the fonts that every PDF reader has.

Its numbers are those of the SVG, and nothing is compressed, so a text editor shows them.
"""

from calib.sheet.sheet import LineSegment, Sheet, Text, decimal
from calib.sheet.target import Polygon

POINTS = 72 / 25.4  # in a mm
FONTS = {False: ("regular", "Helvetica"), True: ("bold", "Helvetica-Bold")}
ENCODING = "cp1252"
"""Python's name for PDF's WinAnsiEncoding."""


def to_pdf(sheet: Sheet) -> bytes:
    """Return the file's bytes."""
    width, height = sheet.paper.width * POINTS, sheet.paper.height * POINTS
    fonts = " ".join(
        f"/{name} << /Type /Font /Subtype /Type1 /BaseFont /{font} /Encoding /WinAnsiEncoding >>"
        for name, font in FONTS.values()
    )
    drawing = _drawing(sheet, height)
    return _file(
        (
            # without this, readers fit pages to the printer
            b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
            b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Resources <<"
            f" /Font << {fonts} >> >> /Contents 4 0 R >>".encode(),
            f"<< /Length {len(drawing)} >>\nstream\n".encode() + drawing + b"\nendstream",
            b"<< /Title " + _string(sheet.title) + b" /Creator (refracal) >>",
        )
    )


def _drawing(sheet: Sheet, height: float) -> bytes:
    """Return the page's contents. They start with the change from points upwards from the lower
    left to mm downwards from the upper left.
    """
    commands = [f"{POINTS:.9f} 0 0 -{POINTS:.9f} 0 {height:.4f} cm".encode()]
    commands += [" ".join(map(_outline, sheet.polygons)).encode(), b"f"]
    commands += [_line(line) for line in sheet.lines]
    commands += [b"BT", *map(_text, sheet.texts), b"ET"]
    return b"\n".join(commands)


def _outline(polygon: Polygon) -> str:
    points = [f"{decimal(x)} {decimal(y)}" for x, y in polygon]
    return f"{points[0]} m " + " ".join(f"{point} l" for point in points[1:]) + " h"


def _line(line: LineSegment) -> bytes:
    x1, y1, x2, y2, width = map(decimal, (*line.start, *line.end, line.width))
    return f"{width} w {x1} {y1} m {x2} {y2} l S".encode()


def _text(text: Text) -> bytes:
    turn = "0 -1 -1 0" if text.upwards else "1 0 0 -1"
    x, y, size = map(decimal, (*text.place, text.size))
    return (
        f"/{FONTS[text.bold][0]} {size} Tf {turn} {x} {y} Tm ".encode()
        + _string(text.words)
        + b" Tj"
    )


def _string(words: str) -> bytes:
    for special in "\\()":
        words = words.replace(special, f"\\{special}")
    return b"(" + words.encode(ENCODING) + b")"


def _file(objects: tuple[bytes, ...]) -> bytes:
    """Assemble the file from its objects, numbered from 1. The first is the catalog, the last the
    document's information.
    """
    body = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n"
    table = b"0000000000 65535 f \n"
    for number, content in enumerate(objects, 1):
        table += b"%010d 00000 n \n" % len(body)
        body += b"%d 0 obj\n%b\nendobj\n" % (number, content)
    size = len(objects) + 1
    trailer = b"trailer\n<< /Size %d /Root 1 0 R /Info %d 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        size,
        len(objects),
        len(body),
    )
    return body + b"xref\n0 %d\n" % size + table + trailer
