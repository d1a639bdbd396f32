"""The section of a report with the commands and inputs that reproduce its calibration."""

import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import yaml

from calib.fitting.provenance import ASKED, DIAGNOSED, KEY
from calib.fitting.stages import Settings
from calib.report.evidence import Evidence
from calib.report.tables import html_table


def again_html(evidence: Evidence, folder: Path) -> str:
    """Return the section as HTML; `folder` holds the calibration."""
    calibration = evidence.calibration
    settings = calibration.settings
    origin: dict[str, Any] = settings.get(KEY, {})
    facts = {
        "refracal": calibration.refracal,
        **{key: value for key, value in origin.items() if key != "session"},
        "gauge": calibration.gauge,
        "calibration_sha256": calibration.digest,
    }
    outcome = yaml.safe_dump(
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
        + html_table(
            ("", ""),
            [(escape(key), f"<code>{escape(str(value))}</code>") for key, value in facts.items()],
        )
        + "<p>calibration.yaml and calibration.npz hold the corners, the poses and all numbers; the"
        " fit can be repeated from them alone. session_sha256 is the SHA-256 of the text that"
        " <code>sha256sum</code> prints for the session files that the fit read;"
        " calibration_sha256 is the SHA-256 of calibration.npz.</p>"
        + f"<details><summary>Settings and outcome</summary><pre>{escape(outcome)}</pre></details>"
    )


def commands(settings: dict[str, Any], folder: Path) -> list[list[str]]:
    """Return the command lines that reproduce the calibration of a folder: its fit, then each
    diagnosis.
    """
    diagnoses: list[dict[str, str]] = settings.get(DIAGNOSED, [])
    places = [*(diagnosis["calibration"] for diagnosis in diagnoses), str(folder.resolve())]
    lines = [
        [
            "calib",
            "fit",
            str(settings.get(KEY, {}).get("session", "SESSION")),
            *_options(settings),
            "-o",
            places[0],
        ]
    ]
    for diagnosis, out in zip(diagnoses, places[1:], strict=True):
        holdout = ["--holdout", diagnosis["holdout"]] if diagnosis["holdout"] else []
        lines.append(["calib", "diagnose", diagnosis["calibration"], *holdout, "-o", out])
    return lines


def pasted(words: Sequence[str]) -> str:
    """Quote a command line for a shell.

    Paths in the user's home begin with ~, so that a report that is passed on does not reveal the
    user's name.
    """
    home = f"{Path('~').expanduser()}/"
    return " ".join(
        f"~/{shlex.quote(word.removeprefix(home))}" if word.startswith(home) else shlex.quote(word)
        for word in words
    )


def _options(settings: dict[str, Any]) -> list[str]:
    """Return the options that differ from their defaults."""
    defaults, requested = Settings(), settings.get(ASKED, {})
    words: list[str] = []
    if (method := settings.get("method", defaults.method)) != defaults.method:
        words += ["--method", method]
    if (grid := settings.get("grid")) and tuple(grid) != defaults.grid:
        words += ["--grid", "x".join(map(str, grid))]
    if (free := tuple(settings.get("free", defaults.free))) != defaults.free:
        words += ["--free", ",".join(free) or "none"]
    by_library = ["auto"] if "diagnosis" in settings and DIAGNOSED not in settings else []
    if effects := requested.get("effects") or by_library:
        words += ["--effects", ",".join(effects)]
    if validation := settings.get("cross_validation"):
        words += ["--folds", str(validation["folds"])]
    if (steps := settings.get("steps", defaults.steps)) != defaults.steps:
        words += ["--steps", str(steps)]
    if not settings.get("exact_hit", defaults.exact_hit):
        words.append("--neglect-shift")
    if depths := requested.get("depths", []):
        words += ["--depth", *(str(depth) for depth in depths)]
    return words
