"""What the site needs beside docs/: the files that pages link to outside of it come along, so that
every link is one within the site.

mkdocs calls these as hooks (mkdocs.yml). A page outside docs/, such as fixtures/README.md, becomes
a page; any other file is copied.
"""

import ast
import os
import posixpath
import re
from html import escape, unescape
from itertools import zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
LINK = re.compile(r"(!?\[[^\]]*\]\()([^()\s]+)(\))")
TYPED = re.compile(
    r"(# .*\n)*\.?\S*(calib|capture|python3?|pip|sudo|git|cd|export|mkdir|uname|rpicam-\w+"
    r"|\.ci/\S+|\.) "
)
"""The beginning of a block of commands."""
OUTPUT = re.compile(r'(<div class="highlight">)<pre>((?:(?!<span class).)*?)</pre>', re.DOTALL)
"""A block without colours: what a command prints."""
SHORT_CODE = re.compile(r"(?<!</span>)(?<!<pre>)<code>([^<\n]{1,36})</code>")
"""Code within a sentence that is narrower than a phone."""
CODE = re.compile(r"<code(?: [^>]*)?>.*?</code>", re.DOTALL)
OPTION = re.compile(r"(?<=[>\s])(--?[A-Za-z][A-Za-z0-9-]*)(?=[<\s=])")
UNIT = re.compile(r"(?<=[\s>(-])([0-9.]+) (µm|mm|m|px|s|ms|GB|MB|%)(?=[<\s,.;:)])")
TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
HEADING = re.compile(r"<th[^>]*>(.*?)</th>", re.DOTALL)
ROW = re.compile(r"<tr>.*?</tr>", re.DOTALL)
CELL = re.compile(r"<td[^>]*>(.*?)</td>", re.DOTALL)
ANY_CELL = re.compile(r"<t[dh][^>]*>(.*?)</t[dh]>", re.DOTALL)
MANY_COLUMNS, LONG_ROW = 3, 100
PHONE, LETTER, PADDING, NARROWEST = 300, 7.0, 34, 80  # px
DENSE, SMALL_LETTER, SMALL_PADDING = 350, 6.2, 6  # px
LONGEST_NUMBER = 11
"""The letters of a cell of a table of numbers, such as 0.148, 12 % or (820, 1232)."""
FEWEST, MOST = 42, 110
"""Columns: fewer have room on a phone, and more could not be read there."""
TABULAR = re.compile(r"[│┃┏┡├└]|\S {2,}\S")
"""A line of a table, which must not wrap."""
ALERT = re.compile(r"^> \[!(\w+)\]\n((?:> .*\n)+)", re.MULTILINE)
"""A warning or a note as GitHub reads it."""
MESSAGES = "<!-- the site lists every message here -->"
RAISED = {
    "BusyError",
    "CaptureError",
    "FleetError",
    "GuidanceError",
    "InputError",
    "NoCameraError",
    "NotEnoughDataError",
    "OtherBoardError",
    "RefracalError",
    "error",
}
"""The errors whose message a person reads."""
PARTS = {
    "Options, files and folders": ("calib/commands", "calib/io"),
    "session.yaml": ("calib/session",),
    "The board in the pictures": ("calib/corners", "calib/sheet"),
    "Import": ("calib/importing",),
    "Fit and test: `calib fit`, `evaluate`, `diagnose`, `check`, `report`": (
        *("calib/fitting", "calib/intrinsics", "calib/diagnosis", "calib/checking"),
        *("calib/fit_record", "calib/calibration_file.py", "calib/optics", "calib/planning"),
        *("calib/plots", "calib/report"),
    ),
    "Use: `calib undistort`, `stream`, `measure`, `pose`, `immerse`, `export`": (
        *("calib/apply", "calib/undistortion", "calib/export", "capture/streaming"),
    ),
    "Several cameras: `calib rig`": ("calib/rig", "capture/rig"),
    "Many cameras: `calib batch`, `calib fleet-prior`": ("calib/fleet",),
    "A screen as the target": ("calib/fringes", "capture/screen"),
    "Record: `capture`": ("capture",),
}
"""The headings of the messages, each with the parts of the code whose errors stand below it; a part
counts for the first heading that has it.
"""
FEWEST_WORDS = 4
"""The words of a message that do not change: with fewer of them it cannot be searched for."""
WORD = re.compile(r"(?<![\w…])[A-Za-z][\w'-]*(?![\w…])")
TASKS = {
    f"{name}.md"
    for name in (
        *("board", "calibrating", "capture", "check", "coming-from", "diagnose", "exports"),
        *("immersing", "imports", "install", "measuring", "raspberry-pi", "rigs"),
        *("screen-target", "streaming", "troubleshooting", "tutorial", "undistorting", "unknown"),
    )
}
OUTSIDE = "source"
"""The folder of the site that holds what is from outside docs/."""


def links(text: str) -> list[str]:
    """Where a page's relative links lead, without their anchors; blocks of code are left out."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    return [
        target.partition("#")[0]
        for _, target, _ in LINK.findall(prose)
        if not re.match(r"\w+:|#", target)
    ]


def target_of(page: Path, link: str) -> Path:
    """The file that a link of a page leads to; of a folder its README."""
    path = Path(os.path.normpath(page.parent / link))
    return path / "README.md" if path.is_dir() else path


def place_of(path: Path) -> str:
    """Where a file of the project is in the site's sources."""
    if path.is_relative_to(DOCS):
        return path.relative_to(DOCS).as_posix()
    return f"{OUTSIDE}/{path.relative_to(ROOT).as_posix()}"


def from_outside() -> list[Path]:
    """All files outside docs/ that its pages lead to, directly or by way of each other."""
    found: list[Path] = []
    waiting = sorted(DOCS.rglob("*.md"))
    while waiting:
        page = waiting.pop()
        for path in (target_of(page, link) for link in links(page.read_text(encoding="utf-8"))):
            if (
                path.is_file()
                and path not in found
                and path.is_relative_to(ROOT)
                and not path.is_relative_to(DOCS)
            ):
                found.append(path)
                waiting += [path] if path.suffix == ".md" else []
    return sorted(found)


def on_files(files: Any, config: Any) -> Any:
    from mkdocs.structure.files import File, InclusionLevel

    for path in from_outside():
        file = File.generated(
            config, place_of(path), abs_src_path=str(path), inclusion=InclusionLevel.NOT_IN_NAV
        )
        files.append(file)
    for file in files:
        if re.match(r"(effects|decisions)/(?!README)", file.src_uri):  # reached from their README
            file.inclusion = InclusionLevel.NOT_IN_NAV
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links between docs/ and what came along lead to where that is in the site. Warnings become
    admonitions.
    """
    here = Path(page.file.abs_src_path)
    page.meta.setdefault("search", {"boost": boost_of(page.file.src_uri)})
    if MESSAGES in markdown:
        markdown = markdown.replace(MESSAGES, all_messages())
    markdown = ALERT.sub(admonition, markdown)

    def moved(match: re.Match[str]) -> str:
        before, target, after = match.groups()
        if re.match(r"\w+:|#", target):
            return match[0]
        name, mark, anchor = target.partition("#")
        path = target_of(here, name)
        if not path.is_file():
            return match[0]  # mkdocs says that it is not found
        relative = posixpath.relpath(place_of(path), posixpath.dirname(page.file.src_uri) or ".")
        return f"{before}{relative}{mark}{anchor}{after}"

    parts = re.split(r"(^```.*?^```)", markdown, flags=re.DOTALL | re.MULTILINE)
    return "".join(
        coloured(part) if index % 2 else LINK.sub(moved, part) for index, part in enumerate(parts)
    )


def boost_of(page: str) -> float:
    """The weight of a page in the search: what people do comes before how it was found out."""
    is_background = page.startswith(("development/", "decisions/", OUTSIDE)) or page == "paper.md"
    return 0.3 if is_background else 3.0 if page in TASKS else 1.0


def all_messages() -> str:
    """Every message of an error in the code: below the heading of its part, sorted by its first
    words.
    """
    found: dict[str, set[str]] = {heading: set() for heading in PARTS}
    for package in ("calib", "capture"):
        for file in sorted((ROOT / package).rglob("*.py")):
            if messages := messages_of(file):
                found.setdefault(heading_of(file), set()).update(messages)
    return "\n".join(
        f"## {heading}\n\n{listed(messages)}\n" for heading, messages in found.items() if messages
    )


def heading_of(file: Path) -> str:
    """The heading of the messages of a file."""
    path = file.relative_to(ROOT)
    headings = (
        heading
        for heading, parts in PARTS.items()
        if any(path.is_relative_to(part) for part in parts)
    )
    return next(headings, "Other parts")


def messages_of(file: Path) -> set[str]:
    """The messages of the errors that a file raises, if they have enough words to search for."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    messages = {message_of(node) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    return {message for message in messages if len(WORD.findall(message)) >= FEWEST_WORDS}


def listed(messages: set[str]) -> str:
    """A list of messages, sorted by their first words."""
    lines = sorted(messages, key=lambda message: message.strip("… :").lower())
    return "\n".join(f"- `{line.replace('`', chr(39))}`" for line in lines)


def message_of(call: ast.Call) -> str:
    """The text of an error that a call makes, with … for what is put into it; else nothing."""
    name = call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")
    if not (name in RAISED and call.args):
        return ""
    match call.args[0]:
        case ast.Constant(value=str(text)):
            return " ".join(text.split())
        case ast.JoinedStr(values=parts):
            words = (part.value if isinstance(part, ast.Constant) else "…" for part in parts)
            return " ".join("".join(map(str, words)).split())
    return ""


def admonition(alert: re.Match[str]) -> str:
    """The same warning or note as the site's Markdown has it."""
    text = re.sub(r"^> ", "    ", alert[2], flags=re.MULTILINE)
    return f"!!! {alert[1].lower()}\n\n{text}"


def coloured(block: str) -> str:
    """A block of commands gets the language that colours them; every other block is unchanged."""
    if block.startswith("```\n") and TYPED.match(block[4:]):
        return "```sh" + block[3:]
    return block


def on_page_content(html: str, **_: Any) -> str:
    """Every block of output says how many columns it has, for the style sheet. A short command in a
    sentence stays in one line, and an option everywhere.
    """
    html = OUTPUT.sub(lambda match: f"{match[1]}{sized(match[2])}", html)
    html = SHORT_CODE.sub(r'<code class="whole">\1</code>', html)
    html = CODE.sub(lambda code: OPTION.sub(r'<span class="option">\1</span>', code[0]), html)
    html = CELL.sub(lambda cell: UNIT.sub("\\1\N{NO-BREAK SPACE}\\2", cell[0]), html)
    return TABLE.sub(lambda table: labelled(table[0]), html)


def labelled(table: str) -> str:
    """A table of many columns with sentences, whose cells have the headings of their columns: on a
    phone they stand below each other. A table of numbers stays a table there, with small letters.
    """
    headings = [
        escape(unescape(re.sub("<[^>]+>", "", heading).strip()))
        for heading in HEADING.findall(table)
    ]
    longest = max(len(re.sub("<[^>]+>", "", row)) for row in ROW.findall(table))
    has_room = len(headings) < MANY_COLUMNS or longest < LONG_ROW
    if has_room and width_of(table, LETTER, PADDING, NARROWEST) < PHONE:
        return table
    if has_numbers(table) and width_of(table, SMALL_LETTER, SMALL_PADDING, 0) < DENSE:
        return table.replace("<table>", "<table data-numbers>", 1)

    def row(match: re.Match[str]) -> str:
        labels = iter(headings)
        return CELL.sub(
            lambda cell: f'<td data-label="{next(labels, "")}"><div>{cell[1]}</div></td>', match[0]
        )

    return ROW.sub(row, table.replace("<table>", "<table data-stacked>", 1))


def has_numbers(table: str) -> bool:
    """True if every cell of a table is short, but for those of the first column."""
    cells = [
        re.sub("<[^>]+>", "", cell).strip()
        for row in ROW.findall(table)
        for cell in CELL.findall(row)[1:]
    ]
    return bool(cells) and all(len(cell) <= LONGEST_NUMBER for cell in cells)


def width_of(table: str, letter: float, padding: float, narrowest: float) -> float:
    """The px that a table needs at least: those of the longest word of each column, and of its
    padding.
    """
    rows = [
        [re.sub("<[^>]+>", "", cell).split() for cell in ANY_CELL.findall(row)]
        for row in ROW.findall(table)
    ]
    columns = zip_longest(*filter(None, rows), fillvalue=[])
    longest = [
        max((len(word) for cell in column for word in cell), default=0) for column in columns
    ]
    return sum(max(letter * length + padding, narrowest) for length in longest)


def sized(block: str) -> str:
    """The <pre> of a block, with the columns of its tables. Sentences wrap, and keep the size of
    their letters if they stand below a table.
    """
    lines = [unescape(re.sub(r"<[^>]+>", "", line)) for line in block.splitlines()]
    tabular = [
        place for place, line in enumerate(lines) if TABULAR.search(line) and len(line) <= MOST
    ]
    if len(tabular) < 2:  # one line with wide gaps is no table, and may wrap
        tabular = []
    columns = max(FEWEST, *(len(lines[place]) for place in tabular), 0)
    if tabular and "</code>" in block:
        listed = [i for i, line in enumerate(lines) if line[:1] == " " and len(line) <= columns]
        block = with_sentences(block, max(*tabular, *listed) + 1)
    return f'<pre class="output" style="--columns: {columns}">{block}</pre>'


def with_sentences(block: str, first: int) -> str:
    """A block whose lines from the `first` one on are marked as sentences. A line that continues a
    sentence is joined to it, because a phone breaks lines elsewhere.
    """
    code, end, rest = block.rpartition("</code>")
    lines = code.split("\n")
    table, sentences = lines[:first], re.sub(r"\n(?=[a-z])", " ", "\n".join(lines[first:]))
    if not sentences.strip():
        return block
    return "\n".join([*table, f'<span class="sentences">{sentences}</span>']) + end + rest
