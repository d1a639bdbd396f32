"""A whole fleet: its cameras done on a cluster, whatever dies on the way, and looked at side by
side.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from calib.fleet.cluster import Place, client_of
from calib.fleet.findings import Fleet, judge_fleet
from calib.fleet.identity import Asked
from calib.fleet.job import Job
from calib.fleet.manifest import Entry
from calib.fleet.output import check_output
from calib.fleet.page import fleet_page
from calib.fleet.result import PAGES, Result, State
from calib.fleet.run import run_jobs
from calib.fleet.table import fleet_csv
from calib.io.file_set import FileSet
from calib.progress import Progress


def calibrate_fleet(
    entries: Sequence[Entry],
    asked: Asked,
    output: Path,
    place: Place,
    progress: Progress,
    say: Callable[[str], None],
    inputs: Sequence[Path] = (),
    *,
    overwrite: bool = False,
) -> tuple[Fleet, list[Path]]:
    """Every camera's result in `output`/cameras, fleet.html and fleet.csv; what lies there already
    and is still true is kept.

    Args:
        output: an absolute path that every worker sees.
        say: is told where the cluster can be watched, and what it waits for.
        inputs: the manifest, and other files that are read and never replaced.
        overwrite: files that calib did not write may be replaced.

    Returns:
        What stands out, and the paths of the page and the table.

    Raises:
        FleetError: the cluster is gone; the same call goes on from there.
        InputError: there is no such cluster, or `output` cannot be written or is in use by another,
            or a result would replace what is not calib's own; nothing is written then.
    """
    results: dict[str, Result] = {}
    check_output(entries, asked, output, inputs, overwrite=overwrite)
    with FileSet(output, overwrite=overwrite, inputs=inputs) as files:
        with client_of(place, output) as client:
            if find_spec("bokeh"):  # without it, Dask has no pages to show
                say(f"Dask's dashboard: {client.dashboard_link}")
            if place.scheduler and not client.scheduler_info()["workers"]:
                say(
                    f"The cluster has no worker yet: start some by 'dask worker {place.scheduler}"
                    " --nthreads 1'."
                )
            advance = progress.task("Cameras", len(entries))
            for result in run_jobs(
                client, [Job(entry, asked, str(output), overwrite) for entry in entries]
            ):
                results[result.id] = result
                advance(len(results), _words(results))
        fleet = judge_fleet(entries, results)
        written = [
            files.write(PAGES[0], fleet_page(fleet, output.name)),
            files.write(PAGES[1], fleet_csv(fleet)),
        ]
        files.commit()
    return fleet, written


def _words(results: dict[str, Result]) -> str:
    states = Counter(result.state for result in results.values())
    return ", ".join(
        f"{states[state]} {state.value.replace('_', ' ')}" for state in State if states[state]
    )
