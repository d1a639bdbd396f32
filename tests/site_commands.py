"""The commands that the README and the pages of the site tell people to type."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TYPED = re.compile(
    r"(\S+=\S+"
    r" )*(\S*/)?(calib|capture|python3?|pip|smoke|pi\.sh|pi_wheel\.sh|sudo|apt-get|git|uname|rpicam-hello|cd|\.)(?= |$)"  # noqa: E501
)
"""The beginning of a typed line; all other lines of a block are printed ones."""
CONTINUED = re.compile(r" \\\n *|(?<= &&)\n *")
"""The end of a line that goes on in the next: a backslash, or `&&`."""


@dataclass(frozen=True)
class Typed:
    """One command of a page, without what follows it in the line."""

    page: str
    line: str

    @property
    def program(self) -> str:
        match = TYPED.match(self.line)
        return match[3] if match else ""

    @property
    def kind(self) -> str:
        """`run`; `parsed`: ours, but it needs a camera, a person, a fleet, a rig, or hours;
        `shell`: it changes this machine, so bash reads it alone.
        """
        needs_camera = self.line.startswith("calib stream") and "--source video:" not in self.line
        needs_many = self.line.startswith(("calib fleet-prior", "calib rig", "calib import rig"))
        if needs_camera or needs_many or "--scheduler" in self.line:
            return "parsed"
        if (
            self.program == "calib"
            or self.line in ("capture sources",)
            or "sha256sum" in self.line
            or "--print-completion" in self.line
        ):
            return "run"
        if self.program == "capture" or (
            " -m " in self.line and not re.search(r" -m (venv|pip|build)", self.line)
        ):
            return "parsed"
        return "shell"


def commands() -> Iterator[Typed]:
    for page in PAGES:
        for language, block in BLOCK.findall(page.read_text(encoding="utf-8")):
            for line in CONTINUED.sub(" ", block).splitlines() if not language else ():
                if TYPED.match(line):
                    command = re.sub(r"\s+#.*$", "", line)
                    command_parts = [command] if "sha256sum" in command else command.split(" && ")
                    yield from (
                        Typed(page.relative_to(ROOT).as_posix(), command_part)
                        for command_part in command_parts
                    )


def mentioned() -> Iterator[tuple[str, str]]:
    """A page, and a command of ours or a module that it names within a sentence."""
    for page in PAGES:
        prose = BLOCK.sub("", page.read_text(encoding="utf-8"))
        for words in re.findall(r"`((?:calib|capture|python\s+-m)\s[^`]+)`", prose):
            yield page.relative_to(ROOT).as_posix(), " ".join(words.split())
