"""The site: every link of the README and the pages leads somewhere, mkdocs builds it strictly, and
it says what the code says.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import threading
from functools import partial
from html import unescape
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from PIL import Image

import calib
from calib.errors import InputError, NotEnoughDataError, RefracalError
from calib.session.cover_section import cover_sections, read_cover
from calib.session.schema import Section
from calib.session.shapes.registry import dimensions
from calib.session.tolerances import ANY_WATER
from capture.errors import CaptureError
from tests.capture.tui.browser import CHROMIUM, FLAGS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "fixtures/README.md")
] + sorted(DOCS.rglob("*.md"))
LARGEST = 1_000_000
"""bytes, of the film."""
PHONE = """<body style="margin:0"><pre></pre><script>
const pages = location.hash.slice(1).split(","), answers = document.querySelector("pre");
(async () => {
  for (const page of pages) {
    const frame = document.createElement("iframe");
    frame.style = "width:390px;height:844px;border:0";
    frame.src = page;
    document.body.append(frame);
    await new Promise(done => frame.onload = done);
    await new Promise(done => setTimeout(done, 50));
    const root = frame.contentDocument;
    const wide = [...root.querySelectorAll("pre > code")]
      .filter(code => code.scrollWidth > code.clientWidth + 1)
      .map(code => code.innerText.slice(0, 40).replace(/\\n/g, " "));
    for (const code of root.querySelectorAll("pre.output > code")) {
      const size = parseFloat(frame.contentWindow.getComputedStyle(code).fontSize);
      const start = code.innerText.slice(0, 40).replace(/\\n/g, " ");
      if (size < 10) wide.push(`letters of ${size.toFixed(1)} px: ${start}`);
    }
    if (root.documentElement.scrollWidth > 391) wide.push("the page");
    for (const box of root.querySelectorAll(".md-typeset__scrollwrap"))
      if (box.scrollWidth > box.clientWidth + 1)
        wide.push(`a table: ${box.innerText.slice(0, 40).replace(/\\s/g, " ")}`);
    answers.textContent += `${page}: ${wide.join("; ") || "ok"}\\n`;
    frame.remove();
  }
})();
</script>
"""
"""A page that loads others in a window of a phone, and says what is wider or has small letters."""
BLOCK_COLUMNS = 90
"""Characters that a block of code has room for on GitHub in a wide window, with some to spare."""


class QuietHandler(SimpleHTTPRequestHandler):
    """A server that prints no line for each request."""

    def log_message(self, format: str, *args: object) -> None:
        pass


def _hooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("site_hooks", ROOT / ".ci" / "site.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


HOOKS = _hooks()


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub and the site make of headings."""
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    headings = (
        re.sub(r"\[([^]]*)\]\([^)]*\)|[`*]", r"\1", line).strip()
        for line in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    )
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken(page: Path) -> list[str]:
    """Links of a page that lead nowhere."""
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    links = []
    for _, link, _ in HOOKS.LINK.findall(text):
        if re.match(r"\w+:", link):
            continue
        name, _, anchor = link.partition("#")
        path = HOOKS.target_of(page, name) if name else page
        if not path.is_file() or (anchor and anchor not in anchors(path)):
            links.append(link)
    return links


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_leads_somewhere(page: Path) -> None:
    assert broken(page) == []


def test_the_readme_is_short_and_its_blocks_do_not_scroll() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(readme.splitlines()) <= 120
    assert len(readme.split()) <= 900
    for block in re.findall(r"^```\n(.*?)^```$", readme, re.DOTALL | re.MULTILINE):
        assert max(map(len, block.splitlines())) <= BLOCK_COLUMNS, block


def test_the_start_page_has_the_command_of_the_readme() -> None:
    start = (DOCS / "index.md").read_text(encoding="utf-8")
    command = re.search(
        r"```\n(.*?)\n```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert command
    assert command[1] in start


def test_the_pictures_of_the_start_page_are_there() -> None:
    """It has one for phones, in HTML, which no other test of links reads; the figures of their
    alternative text are those of the README.
    """
    start = (DOCS / "index.md").read_text(encoding="utf-8")
    pictures = re.findall(r'(?:src|srcset)="([^"]+)" width="(\d+)" height="(\d+)"', start)
    assert [name for name, _, _ in pictures] == ["picture-phone.png", "picture.png"]
    for name, width, height in pictures:
        with Image.open(DOCS / name) as image:
            assert image.size == (int(width), int(height))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    pictures_of_readme = re.findall(r'(?:src|srcset)="([^"]+)"', readme)
    assert pictures_of_readme == [f"docs/{name}" for name, _, _ in pictures]
    figures = re.compile(
        r"OpenCV ([\d.]+), Refracal ([\d.]+); nearer(?:, OpenCV| than the boards) ([\d.]+)"
        r"(?:, Refracal| and) ([\d.]+)\."
    )
    assert figures.findall(start) == figures.findall(readme)


def test_the_start_page_cuts_its_pictures_where_they_are_blank() -> None:
    """The upper half stands above the cards, so that a visitor sees it at once."""
    style = (DOCS / "site.css").read_text(encoding="utf-8")
    cuts = re.findall(r"\.(hero|below-hero img) \{[^}]*aspect-ratio: (\d+) / (\d+)", style)
    assert [half for half, _, _ in cuts] == ["hero", "below-hero img"] * 2
    names = ("picture.png", "picture.png", "picture-phone.png", "picture-phone.png")
    for name, (half, width, rows) in zip(names, cuts, strict=True):
        with Image.open(DOCS / name) as image:
            row = int(rows) if half == "hero" else image.height - int(rows)
            assert image.width == int(width)
            assert image.crop((0, row, image.width, row + 1)).convert("L").getextrema()[0] == 255
    start = (DOCS / "index.md").read_text(encoding="utf-8")
    assert start.index('class="hero"') < start.index("grid cards") < start.index("below-hero")


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# A heading, of `words`\n[1](page.md#a-heading-of-words) [2](other.md) [3](#elsewhere)"
        " [4](page.md)\n```\n[5](none)\n```\n"
    )
    assert broken(page) == ["other.md", "#elsewhere"]


def test_the_reference_has_every_name_of_the_library() -> None:
    names = re.findall(
        r"^::: ([\w.]+)$", (DOCS / "reference.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    homes = calib._MODULES  # type: ignore[attr-defined]  # hidden from type checkers
    assert sorted(names) == sorted(f"{home}.{name}" for name, home in homes.items())


def test_the_site_lists_every_message() -> None:
    page = (DOCS / "messages.md").read_text(encoding="utf-8")
    assert HOOKS.MESSAGES in page
    listed = HOOKS.all_messages()
    assert re.findall(r"^## (.*)$", listed, re.MULTILINE) == list(HOOKS.PARTS)
    messages = [line for line in listed.splitlines() if line.startswith("- ")]
    assert len(messages) > 250
    assert all(len(HOOKS.WORD.findall(line)) >= HOOKS.FEWEST_WORDS for line in messages)
    assert any("is a symbolic link, and results are not written through one" in m for m in messages)
    assert {
        kind.__name__ for kind in (InputError, NotEnoughDataError, RefracalError, CaptureError)
    } <= HOOKS.RAISED


def test_sentences_below_a_table_keep_the_size_of_their_letters() -> None:
    table = "<code>what   held out\nlens  0.2 → 0.1"
    marked = HOOKS.sized(f"<span></span>{table}\nWrote out.\n\nYou can trust it.\n</code>")
    assert f'{table}\n<span class="sentences">Wrote out.\n\nYou can trust it.\n</span>' in marked
    wrapped = HOOKS.sized(f"{table}\nGain: how far it falls. These errors\nweigh corners.\n</code>")
    assert "how far it falls. These errors weigh corners.\n</span>" in wrapped
    for block in (f"{table}\n</code>", "<code>You can trust it.\n</code>"):
        assert block in HOOKS.sized(block)


def test_a_number_in_a_table_stays_with_its_unit() -> None:
    page = HOOKS.on_page_content(
        "<table><tr><td>3 mm, 10x10, 10 µm</td><td>2 sets</td></tr></table>"
    )
    assert "3\N{NO-BREAK SPACE}mm, 10x10, 10\N{NO-BREAK SPACE}µm" in page
    assert "2 sets" in page


def test_a_quoted_word_of_a_heading_stays_in_the_label_of_its_cells() -> None:
    heads = "".join(f"<th>{text}</th>" for text in ("method", "time", 'fit, told "a cone" &amp; r'))
    cells = "".join(f"<td>{text}</td>" for text in ("fit", "0.1", "a sentence " * 20))
    stacked = HOOKS.labelled(f"<table><tr>{heads}</tr><tr>{cells}</tr></table>")
    labels = [unescape(label) for label in re.findall(r'<td data-label="([^"]*)"><div>', stacked)]
    assert labels == ["method", "time", 'fit, told "a cone" & r']


def test_the_start_page_has_the_rows_of_the_readme() -> None:
    """Each with the same page and the same command, in the same order."""
    start = (DOCS / "index.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8").replace("](docs/", "](")
    row = re.compile(
        r"^(?:\| )?[^\n`]*\]\(([^)]+)\)[^\n|]* \| ([^\n|]*`[^\n|]*?)(?: \|)?$", re.MULTILINE
    )
    rows = row.findall(readme)
    assert len(rows) > 25
    assert row.findall(start) == rows


def test_the_covers_of_the_measuring_page_are_read() -> None:
    """And every key of every shape is explained there."""
    page = (DOCS / "measuring.md").read_text(encoding="utf-8")
    page += (DOCS / "unknown.md").read_text(encoding="utf-8")
    described = [
        yaml.safe_load(block)["cover"]
        for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    ]
    covers = [
        read_cover(*cover_sections(Section({"cover": cover}, "session.yaml"), ""))
        for cover in described
    ]
    assert [cover.words for cover in covers] == [
        *(
            "a cone",
            "a flat window",
            "a dome",
            "a flat window of 3 layers",
            "a flat window",
            "a dome and a flat window",
            "a dome",
        )
    ]
    assert [cover.layers for cover in covers] == [1, 1, 1, 3, 1, 1, 1]
    for dimension in dimensions():
        assert f"`{dimension.quantity.key}" in page, dimension.quantity.key


@pytest.mark.parametrize("page", ["measuring.md", "calibrating.md"])
def test_a_page_says_how_well_a_plain_index_of_water_is_known(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    assert re.search(rf"plain index of water .* {ANY_WATER.sigma:g}\b", text)


def test_the_first_command_of_the_calibrating_page_is_explained_word_by_word() -> None:
    page = (DOCS / "calibrating.md").read_text(encoding="utf-8")
    command = re.search(r"```\ncalib fit (.*?)```", page, re.DOTALL)
    assert command
    words = re.findall(r"(?:--?\S+ )?\S+", command[1].replace("\\\n", ""))
    section = page.split("\n### ")[0]
    assert re.findall(r"^\| `(.*?)` \|", section, re.MULTILINE) == words


def test_the_drawings_are_what_the_program_draws(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "benchmarks.drawings", "-o", str(tmp_path)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    made = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert made == {path.name: path.read_text() for path in (DOCS / "drawings").iterdir()}
    page = (DOCS / "measuring.md").read_text(encoding="utf-8")
    assert all(f"](drawings/{name})" in page for name in made)


def test_the_film_is_small_and_moves() -> None:
    assert (DOCS / "tui.gif").stat().st_size < LARGEST
    with Image.open(DOCS / "tui.gif") as film:
        assert film.size == (640, 384)
        assert getattr(film, "n_frames", 1) > 30


def build(config: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--config-file",
        str(config),
        "--site-dir",
        str(out),
    ]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run(
        command, cwd=config.parent, env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the site, built strictly."""
    pytest.importorskip(
        "mkdocs",
        reason="mkdocs is not installed (pip install -e '.[docs]'): the site was not built",
    )
    folder = tmp_path_factory.mktemp("site")
    done = build(ROOT / ".ci" / "mkdocs.yml", folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_it_builds_strictly_and_fetches_nothing(site: Path) -> None:
    pages = {path.relative_to(site).with_suffix(".md").as_posix() for path in site.rglob("*.html")}
    written = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    assert written <= {re.sub(r"(?<=/)index.md$", "README.md", page) for page in pages}
    for path in site.rglob("*.html"):
        fetched = re.findall(
            r'<(?:script|img|link)[^>]+(?:src|href)="?(https?://[^" >]+)',
            path.read_text(encoding="utf-8"),
        )
        assert fetched == [], path
        assert "<table class" not in path.read_text(encoding="utf-8"), "Material styles no other"
    reference = (site / "reference.html").read_text(encoding="utf-8")
    assert 'id="calib.calibration.Calibration.undistort_maps"' in reference


@pytest.mark.slow
def test_errors_beside_those_of_peers_stay_in_a_table_on_a_phone(site: Path) -> None:
    page = (site / "peers.html").read_text(encoding="utf-8")
    section = page.partition('id="the-error-near-the-camera"')[2].partition("<h2")[0]
    assert section.count("<table") == 2
    assert "data-stacked" not in section


def look(address: str) -> str:
    """The page as Chromium has it after its scripts."""
    command = [CHROMIUM or "", *FLAGS, "--virtual-time-budget=200000", "--dump-dom", address]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    return done.stdout


@pytest.mark.slow
@pytest.mark.skipif(not CHROMIUM, reason="there is no Chromium to look at the pages with")
def test_no_page_is_wider_than_a_phone(site: Path) -> None:
    """Nor is a block of code, in a window of 390 px, and its letters can be read."""
    pages = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html"))
    pages = [page for page in pages if not re.match(r"assets|404", page)]
    (site / "phone.html").write_text(PHONE, encoding="utf-8")
    handler = partial(QuietHandler, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        seen = look(f"http://127.0.0.1:{server.server_port}/phone.html#{','.join(pages)}")
        server.shutdown()
    answers = re.findall(r"^(?:.*<pre>)?(\S+\.html): (.*)$", seen, re.MULTILINE)
    assert len(answers) == len(pages) > 80
    wide = [f"{page}: {words}" for page, words in answers if words != "ok"]
    assert wide == [], "\n".join(wide)


@pytest.mark.slow
@pytest.mark.skipif(not CHROMIUM, reason="there is no Chromium to search with")
def test_the_search_works_on_files(site: Path) -> None:
    seen = look(f"{(site / 'index.html').as_uri()}?q=refractive")
    found = re.search(r"(\d+) matching documents", seen)
    assert found
    assert int(found[1]) > 5


@pytest.mark.slow
def test_broken_links_and_a_forgotten_page_break_the_build(tmp_path: Path) -> None:
    pytest.importorskip(
        "mkdocs",
        reason="mkdocs is not installed (pip install -e '.[docs]'): the site was not built",
    )
    for name in ("docs", "calib", ".ci", ".github"):
        shutil.copytree(ROOT / name, tmp_path / name)
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "fixtures/README.md", "LICENSE"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    for page, spoilt in (
        ("index.md", "[gone](gone.md)"),
        ("diagnose.md", "[gone](development/measured.md#gone)"),
        ("new.md", "# New"),
    ):
        with (tmp_path / "docs" / page).open("a", encoding="utf-8") as file:
            file.write(f"\n{spoilt}\n")
    done = build(tmp_path / ".ci" / "mkdocs.yml", tmp_path / "site")
    assert done.returncode == 1
    for problem in ("'gone.md'", "measured.md#gone", "new.md"):
        assert problem in done.stderr


def test_every_page_is_in_the_navigation() -> None:
    """Effects and decisions are reached from their README."""
    names = re.findall(
        r"(?:- |: )([\w/.-]+\.md)$",
        (ROOT / ".ci" / "mkdocs.yml").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    written = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    names.remove("source/CHANGELOG.md")
    assert sorted(names) == sorted(
        page for page in written if not re.match(r"(effects|decisions)/(?!README)", page)
    )
