"""The scripts of a page: its data, the drawing libraries, and the programs that draw with them.

The libraries are vendored (calib/report/web/licences.txt; docs/decisions/report-figures.md says how
to build them again). They stand in the page as gzip in base64, and a program unpacks them. The
page's content security policy allows these scripts alone, by their hashes.
"""

from __future__ import annotations

import gzip
from base64 import b64encode
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from html import escape
from importlib.resources import files

from calib.report.payload import Data, to_json

WEB = files("calib.report") / "web"
REPORT = (
    "data",
    "panels",
    "copy",
    "corners",
    "charts",
    "viewer",
    "space",
    "scene",
    "main",
    "report",
)
RIG = ("data", "panels", "copy", "corners", "viewer", "space", "scene", "main", "rig")
FLEET = ("data", "panels", "main", "fleet")
"""The files of calib/report/web that draw a page, in the order in which they run."""


@dataclass(frozen=True, slots=True)
class Scripts:
    """The scripts at the end of a page."""

    html: str
    policy: str
    """The sources that the content security policy allows: the hashes of the scripts."""

    @staticmethod
    def of(data: Data, programs: tuple[str, ...] = REPORT) -> Scripts:
        """Return the scripts of a page with this data, which these programs draw."""
        licences = (WEB / "licences.txt").read_text(encoding="utf-8")
        return Scripts(
            f"<details><summary>Licences of the figures' libraries</summary><pre>{escape(licences)}"
            '</pre></details>\n<script type="application/json" id="data">'
            f'{to_json(data)}</script>\n<script type="text/plain" id="libraries">'
            f"{b64encode(_libraries()).decode()}</script>\n<script>{_program(programs)}</script>",
            allowed_scripts(programs),
        )


@lru_cache(maxsize=2)
def allowed_scripts(programs: tuple[str, ...] = REPORT) -> str:
    """Return the hashes of the scripts of every report that this version writes, as the sources of
    a content security policy; or of another page that these programs draw.
    """
    return f"{_source(_program(programs).encode())} {_source(gzip.decompress(_libraries()))}"


def _libraries() -> bytes:
    return (WEB / "libraries.js.gz").read_bytes()


def _program(names: tuple[str, ...]) -> str:
    texts = [(WEB / f"{name}.js").read_text(encoding="utf-8") for name in names]
    return '"use strict";\n' + "".join(texts)


def _source(script: bytes) -> str:
    """Return a script's hash as a content security policy writes it."""
    return f"'sha256-{b64encode(sha256(script).digest()).decode()}'"
