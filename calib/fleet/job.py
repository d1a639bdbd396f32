"""The job of one camera: it is fitted, checked against its prior, diagnosed if its verdict asks for
it, reported and exported. Any process that sees the fleet's folder can run it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from calib.calibration import Calibration
from calib.calibration_file import DERIVED, FILES
from calib.checking.check import check
from calib.checking.pictures import read_pictures
from calib.checking.result import CheckResult
from calib.diagnosis.diagnose import diagnose
from calib.errors import InputError, NotEnoughDataError, RefracalError, brief
from calib.export.export import ExportRequest, export
from calib.export.formats import FORMATS
from calib.export.npz import npz_file_names, write_npz
from calib.fitting.fit import fit
from calib.fitting.provenance import record_diagnosis, record_request
from calib.fleet.identity import FleetOptions, Identity
from calib.fleet.manifest import Entry
from calib.fleet.numbers import USUAL_DEPTH, fleet_numbers, prior_shifts
from calib.fleet.places import at_hand, is_remote
from calib.fleet.result import CAMERAS, JobState, Result, read_result, result_name
from calib.io.file_set import FileSet, remove_set
from calib.io.files import read_file
from calib.io.folder_lock import BusyError
from calib.io.json_text import json_text
from calib.io.output_folder import check_no_link
from calib.io.result_names import DIAGNOSED
from calib.progress import Silent
from calib.report.write import NAME, write_report
from calib.session.session import Session, read_session
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust, Verdict

PATIENCE_S = 900.0
"""The longest wait for another worker that was thought dead and still writes to the same camera."""
EPOCH_S = 1e9
"""s; smaller times of frames.csv are no Unix times."""
FITTED = ".fitted.json"
"""The file in a camera's folder that has the identity of its calibration."""


@dataclass(frozen=True, slots=True)
class Job:
    """A camera and its options, which a worker gets."""

    entry: Entry
    options: FleetOptions
    fleet: str
    """The folder of all results."""
    overwrite: bool = False
    """Files in it that calib did not write may be replaced."""


def run_job(job: Job) -> Result:
    """Return the camera's result, which is also written to the fleet's folder, or the result of an
    earlier run if nothing has changed since.

    It raises nothing: an error is the camera's result.
    """
    fleet, entry = Path(job.fleet), job.entry
    start = time.monotonic()
    try:
        camera_folder = check_no_link(fleet / CAMERAS / entry.id)
        with _held(camera_folder, overwrite=job.overwrite) as files:
            previous = read_result(fleet, entry.id)
            earlier = previous.identity if previous else None
            identity = Identity.of(entry, job.options, earlier)
            if previous and previous.finished(identity, fleet):
                return previous
            try:
                result = _calibrated(job, files, identity)
            except NotEnoughDataError as error:
                result = Result(entry.id, JobState.TOO_LITTLE, str(error))
            result = replace(result, identity=identity, seconds=time.monotonic() - start)
            result.write(fleet, overwrite=job.overwrite)
            return result
    except RefracalError as error:
        return _failed(fleet, entry.id, str(error))
    except Exception as error:
        return _failed(
            fleet,
            entry.id,
            f"This is a bug in calib ({type(error).__name__}: {brief(error)}): report it with this"
            " session.",
        )


def _failed(fleet: Path, camera: str, sentence: str) -> Result:
    result = Result(camera, JobState.FAILED, sentence)
    with suppress(RefracalError):  # a disk that is full: the sentence says so
        result.write(fleet)
    return result


def give_up(job: Job, sentence: str) -> Result:
    """Write and return the failure of a camera that no worker could finish."""
    return _failed(Path(job.fleet), job.entry.id, sentence)


@contextmanager
def _held(folder: Path, *, overwrite: bool) -> Iterator[FileSet]:
    """Yield the camera's folder when no other process writes to it."""
    end = time.monotonic() + PATIENCE_S
    with ExitStack() as stack:
        while True:
            try:
                files = stack.enter_context(FileSet(folder, overwrite=overwrite))
            except BusyError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.5)
            else:
                break
        yield files


def _calibrated(job: Job, files: FileSet, identity: Identity) -> Result:
    entry, wanted, folder = job.entry, job.options, files.folder
    with at_hand(entry.session) as session_folder:
        session = read_session(session_folder)
        files.reserve([*camera_files(wanted.depths), result_name(entry.id)])
        for stale in (DIAGNOSED, *(form.name for form in FORMATS)):
            with suppress(OSError):
                remove_set(folder / stale)
        prior, answer, remarks = _checked(entry, session_folder)
        try:
            first, names = _fitted(folder, identity) or _fit(job, files, identity, session)
        except NotEnoughDataError as error:
            return Result(
                entry.id,
                JobState.TOO_LITTLE,
                str(error),
                check=answer.as_json() if answer else {},
                remarks=remarks,
            )
        written = [folder / name for name in names]
        verdict = judge(first, depths=wanted.depths, folder=folder, session=Path(entry.session))
        last = first
        if asks_for_diagnosis(verdict):
            try:
                last, _ = diagnose(first)
            except NotEnoughDataError as error:
                remarks = (*remarks, f"It was not diagnosed: {error}")
            else:
                last = record_diagnosis(last, folder, None)
                place = check_no_link(folder / DIAGNOSED)
                with FileSet(place, overwrite=job.overwrite) as diagnosis_files:
                    written += [
                        last.write(diagnosis_files),
                        write_report(
                            last, diagnosis_files, Silent(), wanted.depths, pictures=session_folder
                        ),
                    ]
                    diagnosis_files.commit(instead_of=DERIVED)
                verdict = judge(
                    last,
                    depths=wanted.depths,
                    folder=folder / DIAGNOSED,
                    session=Path(entry.session),
                )
    if verdict.word is not Trust.DO_NOT_USE:
        written += _exported(last, job, folder)
    elif wanted.formats:
        remarks = (*remarks, "It was not exported, for its verdict is not to use it.")
    return Result(
        id=entry.id,
        state=JobState.CALIBRATED,
        verdict=verdict.as_json(),
        numbers=fleet_numbers(first, last, next(iter(wanted.depths), USUAL_DEPTH)),
        effects=tuple(added.effect.name for added in last.effects),
        check=answer.as_json() if answer else {},
        shifts=prior_shifts(prior, last) if prior else {},
        remarks=remarks,
        written=tuple(path.relative_to(job.fleet).as_posix() for path in written),
        views=len(last.views),
        recorded=_day(last),
    )


def _fit(
    job: Job, files: FileSet, identity: Identity, session: Session
) -> tuple[Calibration, list[str]]:
    """Fit and write a camera; return the calibration and the names of its files. Their identity is
    written next to them.
    """
    wanted = job.options
    first = record_request(fit(session, wanted.settings), (), wanted.depths)
    origin = first.request.provenance
    if origin and is_remote(job.entry.session):  # the copy will be gone
        origin = replace(origin, session=job.entry.session)
        first = replace(first, request=replace(first.request, provenance=origin))
    written = [first.write(files), *write_npz(first, wanted.depths, files, Silent())]
    written.append(write_report(first, files, Silent(), wanted.depths, pictures=session.path))
    names = [path.name for path in written]
    files.write(FITTED, json_text({"identity": asdict(identity), "written": names}))
    files.commit(instead_of=DERIVED)
    return first, names


def _fitted(folder: Path, identity: Identity) -> tuple[Calibration, list[str]] | None:
    """Return the fit of a worker that was killed after it, and the names of its files; None if it
    belongs to another session or is incomplete.
    """
    try:
        document = json.loads(read_file(folder / FITTED))
        fitted = Identity.read(document["identity"])
        names = [str(name) for name in document["written"]]
        if fitted and fitted.same(identity) and all((folder / name).is_file() for name in names):
            return Calibration.load(folder), names
    except (InputError, ValueError, LookupError, TypeError):
        pass
    return None


def asks_for_diagnosis(verdict: Verdict) -> bool:
    """Return True if a reason of the verdict names a diagnosis as the next command."""
    return any(reason.next.startswith("calib diagnose ") for reason in verdict.reasons)


def _checked(
    entry: Entry, session: Path
) -> tuple[Calibration | None, CheckResult | None, tuple[str, ...]]:
    """Return the prior, its check against the session, and remarks if it could not be checked."""
    if not entry.prior:
        return None, None, ()
    prior: Calibration | None = None
    try:
        with at_hand(entry.prior) as place:
            prior = Calibration.load(place)
        return prior, check(prior, read_pictures((session,), prior, Silent())), ()
    except RefracalError as error:
        return prior, None, (f"Its prior could not be checked: {error}",)


def camera_files(depths: Sequence[float]) -> list[str]:
    """Return the names of the files in a camera's folder, without those in its subfolders."""
    return [*FILES, *npz_file_names(depths), NAME, FITTED]


def _exported(calibration: Calibration, job: Job, folder: Path) -> list[Path]:
    """Write every format to its own folder, and return the paths."""
    written: list[Path] = []
    depths = job.options.depths
    for form in FORMATS:
        if form.name in job.options.formats:
            place = check_no_link(folder / form.name)
            with FileSet(place, overwrite=job.overwrite) as files:
                written += export(
                    ExportRequest(calibration, form, form.lenses, depths, files, Silent())
                ).paths
                files.commit()
    return written


def _day(calibration: Calibration) -> str:
    times = [
        view.time_s
        for view in calibration.views
        if view.time_s is not None and view.time_s > EPOCH_S
    ]
    return datetime.fromtimestamp(min(times), UTC).date().isoformat() if times else ""
