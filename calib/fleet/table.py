"""fleet.csv: a row for each camera, for spreadsheets and other programs."""

from __future__ import annotations

import csv
import io

from calib.fleet.findings import Fleet
from calib.fleet.limits import QUALITY

FIRST = (
    "id",
    "serial",
    "fixture",
    "date",
    "state",
    "verdict",
    "stands_out",
    "why",
    "views",
    "effects",
    "prior",
    "prior_p_value",
)


def fleet_csv(fleet: Fleet) -> str:
    """Return the table: numbers with their sigmas, and their shifts from the prior in sigmas.

    A cell is empty if its number is unknown.
    """
    names = list(dict.fromkeys(name for result in fleet.results for name in result.numbers))
    compared = list(dict.fromkeys(name for result in fleet.results for name in result.shifts))
    uncertain = [name for name in names if name not in QUALITY]
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    shift_names = [f"{name}.moved_sigmas" for name in compared]
    writer.writerow(
        [
            *FIRST,
            *names,
            *(f"{name}.sigma" for name in uncertain),
            *shift_names,
            "report",
            "sentence",
        ]
    )
    for index, (entry, result) in enumerate(zip(fleet.entries, fleet.results, strict=True)):
        findings = fleet.findings.get(entry.id, ())
        writer.writerow(
            [
                *(
                    entry.id,
                    entry.serial,
                    entry.fixture,
                    fleet.day(index),
                    result.state.value,
                    result.verdict.get("word", ""),
                ),
                *(
                    int(bool(findings)),
                    "; ".join(finding.sentence for finding in findings),
                    result.views or "",
                    " ".join(result.effects),
                ),
                *(result.check.get("answer", ""), result.check.get("p_value", "")),
                *(
                    f"{result.numbers[name].value:.10g}" if name in result.numbers else ""
                    for name in names
                ),
                *(
                    f"{result.numbers[name].sigma:.4g}" if name in result.numbers else ""
                    for name in uncertain
                ),
                *(
                    f"{result.shifts[name].sigmas:.3f}" if name in result.shifts else ""
                    for name in compared
                ),
                *(result.report, result.sentence),
            ]
        )
    return text.getvalue()
