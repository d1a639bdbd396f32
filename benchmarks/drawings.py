"""The drawings of docs/measuring.md: what each number of a cover is. `python -m benchmarks.drawings
[-o DIR]`.

Sections to scale, in millimetres of the camera frame (z to the right, y down), through the
fixtures' cone, window and dome.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

Point = tuple[float, float]
INK, GLASS, MEASURE, FAINT = "#1e293b", "#99d0e6", "#b0543a", "#94a3b8"
HEAD = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0:.0f} {1:.0f}" width="{0:.0f}" height="{1:.0f}" role="img"
 font-family="DejaVu Sans, Verdana, sans-serif" font-size="13">
<title>{2}</title>
<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto-start-reverse">
<path d="M0,0 L10,5 L0,10 z" fill="{3}"/></marker></defs>
<rect width="100%" height="100%" rx="8" fill="#ffffff"/>
"""  # noqa: E501


@dataclass
class Drawing:
    """A section; what is drawn is given in mm, from `corner` on."""

    title: str
    corner: Point
    size: Point
    scale: float = 5.0
    elements: list[str] = field(default_factory=list)

    def at(self, z: float, y: float) -> Point:
        return (z - self.corner[0]) * self.scale, (y - self.corner[1]) * self.scale

    def line(
        self,
        *points: Point,
        colour: str = INK,
        wide: float = 1.5,
        dashes: str = "",
        fill: str = "none",
    ) -> None:
        path = " ".join("{:.1f},{:.1f}".format(*self.at(*point)) for point in points)
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        self.elements.append(
            f'<polyline points="{path}" fill="{fill}" stroke="{colour}"'
            f' stroke-width="{wide}"{dashed}/>'
        )

    def ring(self, centre: Point, inner: float, outer: float, *, half: bool) -> None:
        """Between two circles; of a dome only the half towards the scene."""
        (x, y), small, large = self.at(*centre), inner * self.scale, outer * self.scale
        if half:
            path = (
                f"M{x:.1f},{y - large:.1f} A{large:.1f},{large:.1f} 0 0 1 {x:.1f},{y + large:.1f}"
                f" L{x:.1f},{y + small:.1f} "
            )
            path += f"A{small:.1f},{small:.1f} 0 0 0 {x:.1f},{y - small:.1f} Z"
        else:
            path = "".join(
                f"M{x - r:.1f},{y:.1f} a{r:.1f},{r:.1f} 0 1 0 {2 * r:.1f},0 a{r:.1f},{r:.1f} 0 1 0"
                f" {-2 * r:.1f},0 Z"
                for r in (large, small)
            )
        self.elements.append(
            f'<path d="{path}" fill="{GLASS}" fill-rule="evenodd" stroke="{INK}"'
            ' stroke-width="1.2"/>'
        )

    def measure(self, start: Point, end: Point, name: str, text_at: Point, value: str = "") -> None:
        """A measured length, with arrows at both ends, and its key of session.yaml."""
        (x, y), (u, v) = self.at(*start), self.at(*end)
        arrows = 'marker-start="url(#tip)" marker-end="url(#tip)"'
        self.elements.append(
            f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{u:.1f}" y2="{v:.1f}" stroke="{MEASURE}"'
            f' stroke-width="1.4" {arrows}/>'
        )
        self.text(text_at, name, MEASURE, bold=True)
        if value:
            self.text((text_at[0], text_at[1] + 16 / self.scale), value, MEASURE)

    def text(
        self,
        at: Point,
        words: str,
        colour: str = INK,
        *,
        bold: bool = False,
        anchor: str = "middle",
    ) -> None:
        x, y = self.at(*at)
        weight = ' font-weight="bold"' if bold else ""
        self.elements.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
            f' fill="{colour}" stroke="#ffffff" stroke-width="4" paint-order="stroke"'
            f"{weight}>{words}</text>"
        )

    def camera(self) -> None:
        """A body behind the pinhole, which lies at the origin, in the middle of the lens's entrance
        pupil.
        """
        self.line((-17, -6), (-5, -6), (-5, 6), (-17, 6), (-17, -6), fill="#334155")
        self.line((-5, -4), (2.5, -5), (2.5, 5), (-5, 4), (-5, -4), fill="#475569")
        self.line(
            (-5, 0), (self.corner[0] + self.size[0] - 3, 0), colour=FAINT, dashes="7 4", wide=1.2
        )
        x, y = self.at(0, 0)
        self.elements.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="#facc15" stroke="{INK}"/>'
        )

    def axes(self, vertical: str = "y") -> None:
        z, y = self.corner[0] + 3, self.corner[1] + 3
        for end, name, offset in (((z + 9, y), "z", (2, 1)), ((z, y + 9), vertical, (0, 4))):
            (a, b), (c, d) = self.at(z, y), self.at(*end)
            self.elements.append(
                f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}" stroke="{FAINT}" stroke-width="1.4"'
                ' marker-end="url(#tip)"/>'
            )
            self.text((end[0] + offset[0], end[1] + offset[1]), name, FAINT)

    def svg(self) -> str:
        wide = self.size[0] * self.scale
        high = self.size[1] * self.scale
        return (
            HEAD.format(wide, high, self.title, MEASURE) + "\n".join(self.elements) + "\n</svg>\n"
        )


def cone_from_the_side() -> Drawing:
    made = Drawing("A cone from the side", (-84, -42), (132, 88))
    axis, radius, slope, thick, half = -30.0, 41.95, -0.105, 3.0, 30.0

    def wall(y: float, side: int, glass: float = 0) -> Point:
        return axis + side * (radius + slope * y + glass), y

    for side in (-1, 1):
        made.line(
            wall(-half, side),
            wall(half, side),
            wall(half, side, thick),
            wall(-half, side, thick),
            wall(-half, side),
            fill=GLASS,
            wide=1.2,
        )
    made.line((axis, -36), (axis, 36), colour=FAINT, dashes="10 3 2 3", wide=1.2)
    made.text((axis, -37), "the cone's axis", FAINT)
    made.camera()
    made.measure(
        (axis, 0), wall(0, -1), "inner_radius_mm", (-52, -5), "at y = 0, the height of the lens"
    )
    made.measure((axis, 14), (0, 14), "axis_offset_mm, z", (-15, 18), "-30: it is behind")
    made.line((0, 4), (0, 16), colour=MEASURE, wide=0.8)
    made.measure(wall(-22, 1), wall(-22, 1, thick), "thickness_mm", (31, -23), "along the radius")
    made.measure((axis, -half), wall(-half, -1), "radius above", (-52, -31.4))
    made.measure((axis, half), wall(half, -1), "radius below", (-52, 34))
    made.text(
        (-28, 42),
        "radius_slope = (radius below - radius above) / height between them",
        MEASURE,
        bold=True,
    )
    made.text((17, 4), "pinhole (0, 0, 0)", INK, anchor="start")
    made.line((16, 3.2), (1, 0.7), colour=FAINT, wide=1)
    made.axes()
    return made


def cone_from_above() -> Drawing:
    made = Drawing("A cone or cylinder from above", (-84, -46), (132, 102))
    axis, radius, thick, aside = (-30.0, 5.0), 41.95, 3.0, 5.0
    made.ring(axis, radius, radius + thick, half=False)
    made.camera()
    x, y = made.at(*axis)
    made.elements.append(
        f'<path d="M{x - 6},{y} h12 M{x},{y - 6} v12" stroke="{INK}" stroke-width="1.5"/>'
    )
    made.text((axis[0], axis[1] + 5), "axis", INK)
    made.measure(
        axis, (axis[0] - radius * 0.7071, axis[1] + radius * 0.7071), "inner_radius_mm", (-56, 14)
    )
    made.measure((axis[0], -16), (0, -16), "axis_offset_mm, z", (-15, -21), "-30")
    made.measure((4, 0), (4, aside), "axis_offset_mm, x", (-7, 11), "here 5: to the right")
    for start, end in (((axis[0], -18), axis), ((0, -18), (0, 0)), (axis, (6, aside))):
        made.line(start, end, colour=MEASURE, wide=0.7, dashes="3 3")
    made.measure(
        (axis[0] + radius, axis[1]), (axis[0] + radius + thick, axis[1]), "thickness_mm", (31, 6)
    )
    made.axes("x")
    return made


def window() -> Drawing:
    made = Drawing("A flat window from the side", (-26, -34), (94, 62), 7.0)
    distance, thick, half = 20.0, 6.0, 24.0
    made.line(
        (distance, -half),
        (distance + thick, -half),
        (distance + thick, half),
        (distance, half),
        (distance, -half),
        fill=GLASS,
        wide=1.2,
    )
    made.camera()
    made.line((distance + 2.3, -18), (distance - 2.3, 18), colour=MEASURE, dashes="5 4", wide=1.2)
    made.measure((0, 11), (distance, 11), "distance_mm", (6, 14.5), "pinhole to inner face,")
    made.text((6, 19), "along the optical axis", MEASURE)
    made.line((0, 3), (0, 12.5), colour=MEASURE, wide=0.8)
    made.measure(
        (distance, -27), (distance + thick, -27), "thickness_mm", (distance + thick / 2, -29)
    )
    tilted = 8.0
    made.text(
        (distance + tilted + 3, 14),
        "tilt_deg: [about x, about y]",
        MEASURE,
        bold=True,
        anchor="start",
    )
    made.text((distance + tilted + 3, 17), "0 where it faces the camera", MEASURE, anchor="start")
    made.text((distance + tilted + 3, -12), "inside: air", INK, anchor="start")
    made.text((distance + tilted + 3, -9), "outside: outside_index", INK, anchor="start")
    made.text((-2, -8), "pinhole (0, 0, 0)", INK)
    made.axes()
    return made


def dome() -> Drawing:
    made = Drawing("A dome from the side", (-46, -64), (128, 128), 4.4)
    centre, radius, thick = -8.0, 50.0, 4.0
    made.ring((centre, 0), radius, radius + thick, half=True)
    made.line((centre, -60), (centre, 60), colour=FAINT, dashes="10 3 2 3", wide=1.2)
    made.text((centre, -61), "through the dome's centre", FAINT)
    made.camera()
    x, y = made.at(centre, 0)
    made.elements.append(
        f'<path d="M{x - 6},{y} h12 M{x},{y - 6} v12" stroke="#ffffff" stroke-width="2"/>'
    )
    made.measure(
        (centre, 0), (centre + radius * 0.7071, -radius * 0.7071), "inner_radius_mm", (-14, -24)
    )
    made.measure(
        (centre + radius * 0.8, radius * 0.6),
        (centre + (radius + thick) * 0.8, (radius + thick) * 0.6),
        "thickness_mm",
        (53, 44),
    )
    made.measure(
        (centre, 22), (0, 22), "centre_mm: [x, y, z]", (-4, 27.5), "z here -8: behind the pinhole"
    )
    made.line((0, 5), (0, 24), colour=MEASURE, wide=0.8)
    made.text((4, -6.5), "pinhole (0, 0, 0)", INK, anchor="start")
    made.axes()
    return made


DRAWINGS: Sequence[tuple[str, Callable[[], Drawing]]] = (
    ("cone-side", cone_from_the_side),
    ("cone-above", cone_from_above),
    ("window", window),
    ("dome", dome),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/drawings"), metavar="DIR")
    output: Path = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    for name, drawn in DRAWINGS:
        (output / f"{name}.svg").write_text(drawn().svg(), encoding="utf-8")
        print(output / f"{name}.svg")


if __name__ == "__main__":
    main()
