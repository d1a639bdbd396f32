"""The job of one camera: it is fitted, checked against its prior, diagnosed if its verdict asks for
it, reported and exported. Any process that sees the fleet's folder can run it.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from calib.calibration import DERIVED, Calibration
from calib.checking.answer import Answer
from calib.checking.check import check
from calib.checking.pictures import read_pictures
from calib.diagnosis.diagnose import diagnose
from calib.errors import InputError, NotEnoughDataError, RefracalError, brief
from calib.export.export import Export, export
from calib.export.formats import FORMATS
from calib.export.npz import write_npz
from calib.fitting.fit import fit
from calib.fitting.provenance import KEY, asked, diagnosed
from calib.fleet.identity import FleetOptions, Identity
from calib.fleet.manifest import Entry
from calib.fleet.numbers import USUAL_DEPTH, camera_numbers, prior_shifts
from calib.fleet.places import at_hand, is_remote
from calib.fleet.result import CAMERAS, Result, State, read_result
from calib.io.file_set import BusyError, FileSet
from calib.io.files import read_file
from calib.io.json_text import json_text
from calib.progress import Silent
from calib.report.write import write_report
from calib.session.session import Session, read_session
from calib.verdict.judge import judge
from calib.verdict.verdict import Verdict, Word

PATIENCE_S = 900.0
"""The longest wait for another worker that was thought dead and still writes to the same camera."""
EPOCH_S = 1e9
"""s; smaller times of frames.csv are no Unix times."""
DIAGNOSED = "diagnosed"
FITTED = ".fitted.json"
"""The file in a camera's folder that has the identity of its calibration."""


@dataclass(frozen=True, slots=True)
class Job:
    """A camera and its options, which a worker gets."""

    entry: Entry
    options: FleetOptions
    fleet: str
    """The folder of all results."""


def run_job(job: Job) -> Result:
    """Return the camera's result, which is also written to the fleet's folder, or the result of an
    earlier run if nothing has changed since.

    It raises nothing: an error is the camera's result.
    """
    fleet, entry = Path(job.fleet), job.entry
    start = time.monotonic()
    try:
        with _held(fleet / CAMERAS / entry.id) as files:
            previous = read_result(fleet, entry.id)
            earlier = previous.identity if previous else None
            identity = Identity.of(entry, job.options, earlier)
            if previous and previous.finished(identity, fleet):
                return previous
            try:
                result = _calibrated(job, files, identity)
            except NotEnoughDataError as error:
                result = Result(entry.id, State.TOO_LITTLE, str(error))
            result = replace(result, identity=identity, seconds=time.monotonic() - start)
            result.write(fleet)
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
    result = Result(camera, State.FAILED, sentence)
    with suppress(RefracalError):  # a disk that is full: the sentence says so
        result.write(fleet)
    return result


def give_up(job: Job, sentence: str) -> Result:
    """Write and return the failure of a camera that no worker could finish."""
    return _failed(Path(job.fleet), job.entry.id, sentence)


@contextmanager
def _held(folder: Path) -> Iterator[FileSet]:
    """Yield the camera's folder when no other process writes to it."""
    end = time.monotonic() + PATIENCE_S
    with ExitStack() as stack:
        while True:
            try:
                files = stack.enter_context(FileSet(folder))
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
        for stale in (DIAGNOSED, *(form.name for form in FORMATS)):
            shutil.rmtree(folder / stale, ignore_errors=True)
        prior, answer, remarks = _checked(entry, session_folder)
        try:
            first, names = _fitted(folder, identity) or _fit(job, files, identity, session)
        except NotEnoughDataError as error:
            return Result(
                entry.id,
                State.TOO_LITTLE,
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
                last = diagnosed(last, folder, None)
                with FileSet(folder / DIAGNOSED) as diagnosis_files:
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
    if verdict.word is not Word.DO_NOT_USE:
        written += _exported(last, wanted, folder)
    elif wanted.formats:
        remarks = (*remarks, "It was not exported, for its verdict is not to use it.")
    return Result(
        id=entry.id,
        state=State.CALIBRATED,
        verdict=verdict.as_json(),
        numbers=camera_numbers(first, last, next(iter(wanted.depths), USUAL_DEPTH)),
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
    first = asked(fit(session, wanted.settings), (), wanted.depths)
    if is_remote(job.entry.session):  # the copy will be gone
        first = replace(
            first,
            settings=first.settings | {KEY: first.settings[KEY] | {"session": job.entry.session}},
        )
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
) -> tuple[Calibration | None, Answer | None, tuple[str, ...]]:
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


def _exported(calibration: Calibration, wanted: FleetOptions, folder: Path) -> list[Path]:
    """Write every format to its own folder, and return the paths."""
    written: list[Path] = []
    for form in FORMATS:
        if form.name in wanted.formats:
            with FileSet(folder / form.name) as files:
                written += export(
                    Export(calibration, form, form.lenses, wanted.depths, files, Silent())
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
