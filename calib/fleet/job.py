"""One camera: fitted, checked against its prior, diagnosed where its verdict asks for it, reported
and exported. A plain function of what it is told, which any process runs that sees the fleet's
folder.
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
from calib.fleet.identity import Asked, Identity
from calib.fleet.manifest import Entry
from calib.fleet.numbers import USUAL_DEPTH, moved, numbers
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
"""How long a worker waits for another that was given up for dead and still works on the same
camera.
"""
EPOCH_S = 1e9
"""s: times of frames.csv below are no Unix times."""
DIAGNOSED = "diagnosed"
FITTED = ".fitted.json"
"""In a camera's folder: what its calibration was made from."""


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker is told."""

    entry: Entry
    asked: Asked
    fleet: str
    """The folder of all results."""


def run_job(job: Job) -> Result:
    """The camera's result, which lies in the fleet's folder as well; that of an earlier run where
    nothing has changed since.

    It raises nothing: what goes wrong with a camera is its result.
    """
    fleet, entry = Path(job.fleet), job.entry
    begun = time.monotonic()
    try:
        with _held(fleet / CAMERAS / entry.id) as files:
            before = read_result(fleet, entry.id)
            identity = Identity.of(entry, job.asked, before.identity if before else None)
            if before and before.finished(identity, fleet):
                return before
            try:
                result = _calibrated(job, files, identity)
            except NotEnoughDataError as error:
                result = Result(entry.id, State.TOO_LITTLE, str(error))
            result = replace(result, identity=identity, seconds=time.monotonic() - begun)
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
    """The camera's folder, once nobody else writes there."""
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
    entry, wanted, folder = job.entry, job.asked, files.folder
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
                with FileSet(folder / DIAGNOSED) as beside:
                    written += [
                        last.write(beside),
                        write_report(
                            last, beside, Silent(), wanted.depths, pictures=session_folder
                        ),
                    ]
                    beside.commit(instead_of=DERIVED)
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
        numbers=numbers(first, last, next(iter(wanted.depths), USUAL_DEPTH)),
        effects=tuple(added.effect.name for added in last.effects),
        check=answer.as_json() if answer else {},
        moved=moved(prior, last) if prior else {},
        remarks=remarks,
        written=tuple(path.relative_to(job.fleet).as_posix() for path in written),
        views=len(last.views),
        recorded=_day(last),
    )


def _fit(
    job: Job, files: FileSet, identity: Identity, session: Session
) -> tuple[Calibration, list[str]]:
    """The calibration, and the names of its files, which are in force; what they were made from
    lies beside them.
    """
    wanted = job.asked
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
    """What a worker left that was killed after its fit; None where that is of another session, or
    not whole.
    """
    try:
        said = json.loads(read_file(folder / FITTED))
        before, names = Identity.read(said["identity"]), [str(name) for name in said["written"]]
        if before and before.same(identity) and all((folder / name).is_file() for name in names):
            return Calibration.load(folder), names
    except (InputError, ValueError, LookupError, TypeError):
        pass
    return None


def asks_for_diagnosis(verdict: Verdict) -> bool:
    """Whether a reason's next command is a diagnosis."""
    return any(reason.next.startswith("calib diagnose ") for reason in verdict.reasons)


def _checked(
    entry: Entry, session: Path
) -> tuple[Calibration | None, Answer | None, tuple[str, ...]]:
    """The prior, what the session's views say of it, and why they say nothing."""
    if not entry.prior:
        return None, None, ()
    prior: Calibration | None = None
    try:
        with at_hand(entry.prior) as place:
            prior = Calibration.load(place)
        return prior, check(prior, read_pictures((session,), prior, Silent())), ()
    except RefracalError as error:
        return prior, None, (f"Its prior could not be checked: {error}",)


def _exported(calibration: Calibration, wanted: Asked, folder: Path) -> list[Path]:
    """Every format in a folder of its own."""
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
