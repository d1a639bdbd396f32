"""A fleet: workers calibrate its cameras, and the results are compared with each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from pathlib import Path

from calib.fleet.cluster import Place, client_of, remarks_on
from calib.fleet.findings import Fleet, judge_fleet
from calib.fleet.identity import FleetOptions
from calib.fleet.job import Job
from calib.fleet.local import run_locally
from calib.fleet.manifest import Entry
from calib.fleet.output import check_output
from calib.fleet.page import fleet_page
from calib.fleet.result import PAGES, JobState, Result
from calib.fleet.run import run_jobs
from calib.fleet.table import fleet_csv
from calib.io.file_set import FileSet
from calib.progress import Progress


def calibrate_fleet(
    entries: Sequence[Entry],
    options: FleetOptions,
    output: Path,
    place: Place,
    progress: Progress,
    say: Callable[[str], None],
    inputs: Sequence[Path] = (),
    *,
    overwrite: bool = False,
) -> tuple[Fleet, list[Path]]:
    """Write every camera's result to `output`/cameras, and fleet.html and fleet.csv. Results of an
    earlier run stay if nothing has changed.

    Args:
        output: an absolute path that every worker sees.
        say: gets a line for each remark: who can reach the cluster, which worker died, and what the
            fleet waits for.
        inputs: the manifest, and other files that are read and never replaced.
        overwrite: True to replace files that calib did not write.

    Returns:
        The fleet with its findings, and the paths of the page and the table.

    Raises:
        FleetError: the cluster is gone, or no worker can start; the same call goes on from there.
        InputError: there is no such cluster, or another process writes to `output`, or it cannot
            be written, or a result would replace a file that is not calib's own; nothing is
            written then.
    """
    results: dict[str, Result] = {}
    check_output(entries, options, output, inputs, overwrite=overwrite)
    with FileSet(output, overwrite=overwrite, inputs=inputs) as files:
        jobs = [Job(entry, options, str(output), overwrite) for entry in entries]
        with closing(_results(jobs, place, output, say)) as ended:
            advance = progress.task("Cameras", len(entries))
            for result in ended:
                results[result.id] = result
                advance(len(results), _words(results))
        fleet = judge_fleet(entries, results)
        written = [
            files.write(PAGES[0], fleet_page(fleet, output.name)),
            files.write(PAGES[1], fleet_csv(fleet)),
        ]
        files.commit()
    return fleet, written


def _results(
    jobs: Sequence[Job], place: Place, output: Path, say: Callable[[str], None]
) -> Generator[Result, None, None]:
    """Yield every camera's result when it ends, from wherever the workers run."""
    if place.is_local:
        yield from run_locally(jobs, place, say)
        return
    with client_of(place, output) as client:
        for remark in remarks_on(place, client):
            say(remark)
        yield from run_jobs(client, jobs, say, place.patience_s)


def _words(results: dict[str, Result]) -> str:
    states = Counter(result.state for result in results.values())
    return ", ".join(
        f"{states[state]} {state.value.replace('_', ' ')}" for state in JobState if states[state]
    )
