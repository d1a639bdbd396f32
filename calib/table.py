"""A table of texts in sections, which terminal, screen, notebook and report draw in their ways."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape

LARGE = 10.0
"""From this ratio on, a change is a factor, not a percentage."""


@dataclass(frozen=True, slots=True)
class TableSection:
    """Rows that belong together."""

    name: str
    """A word by which programs find it, such as cover."""
    title: str
    rows: tuple[tuple[str, ...], ...]
    """The cells of each row, as many as the table has columns."""
    headed: bool = True
    """False if the headings of the columns do not suit the cells, in HTML."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table; a notebook shows it as HTML, and `print` as text."""

    title: str
    columns: tuple[str, ...]
    """The headings; that of the first column, which names the rows, is empty."""
    sections: tuple[TableSection, ...]
    notes: tuple[str, ...] = ()
    """Sentences below the table that explain words in it."""

    def first_columns(self, count: int) -> "Table":
        """Return the table without the columns after the first `count`."""
        sections = tuple(
            replace(section, rows=tuple(row[:count] for row in section.rows))
            for section in self.sections
        )
        return replace(self, columns=self.columns[:count], sections=sections)

    def as_json(self) -> list[dict[str, object]]:
        """Return the sections, each with its name, its title and its rows."""
        return [
            {"name": section.name, "title": section.title, "rows": section.rows}
            for section in self.sections
        ]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """Yield the lines of the table as text. A line of a row or a note begins with a space."""
        rows = [self.columns, *(row for section in self.sections for row in section.rows)]
        widths = [max(len(row[column]) for row in rows) for column in range(len(self.columns))]
        yield self.title
        yield _line(self.columns, widths)
        for section in self.sections:
            yield section.title
            yield from (_line(row, widths) for row in section.rows)
        yield from (f"  {note}" for note in self.notes)

    def _repr_html_(self) -> str:
        return f"<p><b>{escape(self.title)}</b></p>{self.html()}"

    def html(self) -> str:
        """Return the table as HTML, without its title. A column that is empty in a section has no
        heading there, and the last columns that are empty in all sections are left out.
        """
        rows = [row for section in self.sections for row in section.rows]
        count = max((last_filled(row) for row in rows), default=len(self.columns))
        shown = self.first_columns(count)
        parts = (
            f"<h3>{escape(section.title)}</h3>"
            + html_table(
                shown.headings(section), [[escape(cell) for cell in row] for row in section.rows]
            )
            for section in shown.sections
        )
        notes = "<br>".join(map(escape, self.notes))
        return "".join(parts) + (f"<p>{notes}</p>" if notes else "")

    def headings(self, section: TableSection) -> list[str]:
        """Return the headings of the columns that are not empty in a section; else empty texts."""
        return [
            heading if section.headed and any(row[column] for row in section.rows) else ""
            for column, heading in enumerate(self.columns)
        ]


def last_filled(row: Sequence[str]) -> int:
    """Return the number of cells up to the last one with a text."""
    return max((place for place, cell in enumerate(row, start=1) if cell), default=0)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = (f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True))
    return f"  {'  '.join(padded)}".rstrip()


def change(value: float, reference: float) -> str:
    """Return by how much a value is above or below its reference, in whole percent with a sign, as
    text: `0 %`, never `-0 %`; from ten times on, as a factor.
    """
    if value >= LARGE * reference:
        return f"{value / reference:.0f} times"
    percent = round(100 * (value / reference - 1))
    return f"{percent:+d} %" if percent else "0 %"


def board_error(rmse_cm: float) -> str:
    """Return an error on the board, given in cm as results have it, as text in mm: every length
    near the board is read in mm.
    """
    return f"{10 * rmse_cm:.3f} mm"


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of HTML cells. On a narrow screen, each cell is a line with its label."""
    first = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(map(_cell, head, row))}</tr>" for row in rows)
    return (
        "<div"
        f' class="wide"><table><thead><tr>{first}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _cell(label: str, cell: str) -> str:
    if not cell:
        return "<td></td>"
    attribute = f' data-label="{escape(label)}"' if label else ""
    return f"<td{attribute}><div>{cell}</div></td>"
