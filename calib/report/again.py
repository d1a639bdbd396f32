"""The section of a report with the commands and inputs that reproduce its calibration."""

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

from calib.fit_record.history import History
from calib.fit_record.record_file import provenance_to_yaml
from calib.fit_record.request import CommandOptions, FitRequest, Settings
from calib.report.evidence import Evidence
from calib.report.setting_words import words_for
from calib.table import html_table

SETTING_COLUMNS = ("setting", "", "key")


def again_html(evidence: Evidence, folder: Path) -> str:
    """Return the section as HTML; `folder` holds the calibration."""
    calibration = evidence.calibration
    provenance = calibration.request.provenance
    origin = provenance_to_yaml(provenance) if provenance else {}
    facts = {
        "refracal": calibration.refracal,
        **{key: value for key, value in origin.items() if key != "session"},
        "calibration_sha256": calibration.digest,
    }
    outcome = [
        _setting_row(key, {"True": "yes", "False": "no"}.get(value, value))
        for key, value in flat_rows(
            {
                key: value
                for key, value in calibration.record().items()
                if key not in ("made_by", "asked", "diagnosed", "diagnosis")
            }
        )
    ]
    lines = "\n".join(map(pasted, commands(calibration.request, calibration.history, folder)))
    return (
        f'<div class="command"><pre>{command_html(lines)}</pre></div>'
        + html_table(
            SETTING_COLUMNS,
            [_setting_row(key, str(value)) for key, value in facts.items()],
        )
        + "<p>calibration.yaml and calibration.npz hold the corners, the poses and all numbers; the"
        " fit can be repeated from them alone. session_sha256 is the SHA-256 of the text that"
        " <code>sha256sum</code> prints for the session files that the fit read;"
        " calibration_sha256 is the SHA-256 of calibration.npz.</p>"
        + "<details><summary>Settings and outcome, as calibration.yaml has them, rounded</summary>"
        + html_table(SETTING_COLUMNS, outcome)
        + "</details>"
    )


def _setting_row(key: str, value: str) -> tuple[str, str, str]:
    """Return the cells of a row: the key in words, the value, and the key as files have it, unless
    it is the word.
    """
    words = words_for(key)
    code = "" if key == words else f"<code>{escape(key)}</code>"
    return escape(words), escape(value), code


def flat_rows(value: object, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield a row for each leaf of nested mappings and lists: its path, such as stages 1 rms_px,
    and its value. A list of plain values is one row. A value that is None has no row.
    """
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from flat_rows(part, f"{name} {key}".strip())
    elif isinstance(value, Sequence) and any(isinstance(part, Mapping) for part in value):
        for number, part in enumerate(value, start=1):
            yield from flat_rows(part, f"{name} {number}")
    elif isinstance(value, Sequence) and not isinstance(value, str):
        yield name, ", ".join(map(str, value)) or "none"
    elif value is not None:
        yield name, f"{value:.4g}" if isinstance(value, float) else str(value)


def commands(request: FitRequest, history: History, folder: Path) -> list[list[str]]:
    """Return the command lines that reproduce the calibration of a folder: its fit, then each
    diagnosis.
    """
    runs = history.diagnosis_runs
    places = [*(run.calibration for run in runs), str(folder.resolve())]
    lines = [["calib", "fit", request.session, *_options(request, history), "-o", places[0]]]
    for run, out in zip(runs, places[1:], strict=True):
        holdout = ["--holdout", run.holdout] if run.holdout else []
        lines.append(["calib", "diagnose", run.calibration, *holdout, "-o", out])
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


def command_html(lines: str) -> str:
    """Return command lines as HTML in which no line breaks inside of an option."""
    return re.sub(r"(?<!\S)-[\w-]+", r'<span class="option">\g<0></span>', escape(lines))


def _options(request: FitRequest, history: History) -> list[str]:
    """Return the options that differ from their defaults."""
    defaults = Settings()
    settings = request.settings or defaults
    command = request.command or CommandOptions()
    words: list[str] = []
    if settings.method != defaults.method:
        words += ["--method", settings.method]
    if settings.grid and settings.grid != defaults.grid:
        words += ["--grid", "x".join(map(str, settings.grid))]
    if settings.free != defaults.free:
        words += ["--free", ",".join(settings.free) or "none"]
    by_library = ["auto"] if history.diagnosis and not history.diagnosis_runs else []
    if effects := command.effects or by_library:
        words += ["--effects", ",".join(effects)]
    elif settings.flat_board:
        words += ["--effects", "none"]
    if settings.folds:
        words += ["--folds", str(settings.folds)]
    if settings.steps != defaults.steps:
        words += ["--steps", str(settings.steps)]
    if not settings.exact_hit:
        words.append("--neglect-shift")
    if command.depths:
        words += ["--depth", *map(str, command.depths)]
    return words
