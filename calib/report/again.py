"""Everything that is needed to make a calibration again."""

import shlex
from html import escape
from pathlib import Path
from typing import Any

import yaml

from calib.fitting.provenance import KEY
from calib.report.evidence import Evidence
from calib.report.tables import table


def again_html(evidence: Evidence) -> str:
    calibration = evidence.calibration
    settings = calibration.settings
    origin: dict[str, Any] = settings.get(KEY, {})
    name = Path(str(origin.get("session", "SESSION"))).name
    facts = {
        "refracal": calibration.refracal,
        **{key: value for key, value in origin.items() if key != "session"},
        "gauge": calibration.gauge,
    }
    rest = yaml.safe_dump(
        {key: value for key, value in settings.items() if key not in (KEY, "diagnosis")}, sort_keys=False, allow_unicode=True, width=100
    )
    return (
        f"<pre>{escape(shlex.join(command(settings, name)))}</pre>"
        + table(("", ""), [(escape(key), f"<code>{escape(str(value))}</code>") for key, value in facts.items()])
        + "<p>calibration.yaml and calibration.npz hold the corners, the poses and all numbers: the fit can be made again from them alone. "
        "session_sha256 is the SHA-256 of what <code>sha256sum</code> prints for the files of the session that the fit read.</p>"
        + f"<details><summary>Settings and outcome</summary><pre>{escape(rest)}</pre></details>"
    )


def command(settings: dict[str, Any], session: str) -> list[str]:
    """The command line that asks for the same fit."""
    words = ["calib", "fit", session, "--method", str(settings["method"])]
    if settings["grid"]:
        words += ["--grid", "x".join(str(n) for n in settings["grid"])]
    if settings["free"]:
        words += ["--free", ",".join(settings["free"])]
    if validation := settings.get("cross_validation"):
        words += ["--folds", str(validation["folds"])]
    if settings.get("diagnosis"):
        words += ["--effects", "auto"]
    if settings["method"] == "paper":
        words += ["--steps", str(settings["steps"])]
    return words if settings["exact_hit"] else [*words, "--neglect-shift"]
