"""Everything that is needed to make a calibration again."""

import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import yaml

from calib.fitting.provenance import ASKED, DIAGNOSED, KEY
from calib.fitting.stages import Settings
from calib.report.evidence import Evidence
from calib.report.tables import table


def again_html(evidence: Evidence, folder: Path) -> str:
    """Args: folder: where the calibration lies."""
    calibration = evidence.calibration
    settings = calibration.settings
    origin: dict[str, Any] = settings.get(KEY, {})
    facts = {
        "refracal": calibration.refracal,
        **{key: value for key, value in origin.items() if key != "session"},
        "gauge": calibration.gauge,
        "calibration_sha256": calibration.digest,
    }
    rest = yaml.safe_dump(
        {
            key: value
            for key, value in settings.items()
            if key not in (KEY, ASKED, DIAGNOSED, "diagnosis")
        },
        sort_keys=False,
        allow_unicode=True,
        width=100,
    )
    lines = "\n".join(map(pasted, commands(settings, folder)))
    return (
        f"<pre>{escape(lines)}</pre>"
        + table(
            ("", ""),
            [(escape(key), f"<code>{escape(str(value))}</code>") for key, value in facts.items()],
        )
        + "<p>calibration.yaml and calibration.npz hold the corners, the poses and all numbers: the"
        " fit can be made again from them alone. session_sha256 is the SHA-256 of what"
        " <code>sha256sum</code> prints for the files of the session that the fit read,"
        " calibration_sha256 the SHA-256 of calibration.npz.</p>"
        + f"<details><summary>Settings and outcome</summary><pre>{escape(rest)}</pre></details>"
    )


def commands(settings: dict[str, Any], folder: Path) -> list[list[str]]:
    """The command lines that make the calibration of a folder again, in their order: its fit, and
    what diagnosed it.
    """
    diagnoses: list[dict[str, str]] = settings.get(DIAGNOSED, [])
    places = [*(one["calibration"] for one in diagnoses), str(folder.resolve())]
    said = [
        [
            "calib",
            "fit",
            str(settings.get(KEY, {}).get("session", "SESSION")),
            *_options(settings),
            "-o",
            places[0],
        ]
    ]
    for one, out in zip(diagnoses, places[1:], strict=True):
        holdout = ["--holdout", one["holdout"]] if one["holdout"] else []
        said.append(["calib", "diagnose", one["calibration"], *holdout, "-o", out])
    return said


def pasted(words: Sequence[str]) -> str:
    """As a shell takes it.

    What lies in the person's home is found from there: a report that is passed on does not tell
    their name.
    """
    home = f"{Path('~').expanduser()}/"
    return " ".join(
        f"~/{shlex.quote(word.removeprefix(home))}" if word.startswith(home) else shlex.quote(word)
        for word in words
    )


def _options(settings: dict[str, Any]) -> list[str]:
    """What was not left at its default."""
    usual, asked = Settings(), settings.get(ASKED, {})
    words: list[str] = []
    if (method := settings.get("method", usual.method)) != usual.method:
        words += ["--method", method]
    if (grid := settings.get("grid")) and tuple(grid) != usual.grid:
        words += ["--grid", "x".join(map(str, grid))]
    if (free := tuple(settings.get("free", usual.free))) != usual.free:
        words += ["--free", ",".join(free) or "none"]
    by_library = ["auto"] if "diagnosis" in settings and DIAGNOSED not in settings else []
    if effects := asked.get("effects") or by_library:
        words += ["--effects", ",".join(effects)]
    if validation := settings.get("cross_validation"):
        words += ["--folds", str(validation["folds"])]
    if (steps := settings.get("steps", usual.steps)) != usual.steps:
        words += ["--steps", str(steps)]
    if not settings.get("exact_hit", usual.exact_hit):
        words.append("--neglect-shift")
    if depths := asked.get("depths", []):
        words += ["--depth", *(str(depth) for depth in depths)]
    return words
