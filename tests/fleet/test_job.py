"""One camera's job: what it leaves, when it is done again, and what becomes of a camera that cannot
be calibrated.
"""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import fsspec
import pytest

from calib.calibration import Calibration
from calib.fleet.identity import FleetOptions
from calib.fleet.job import Job, run_job
from calib.fleet.manifest import Entry
from calib.fleet.result import JobState, place_of, read_result
from calib.io.file_set import FileSet
from fixtures.fleet import write_session
from tests.fleet.conftest import ASKED, LINE, QUICK

pytestmark = pytest.mark.usefixtures("without_figures")


@pytest.fixture
def session(recorded: Path, tmp_path: Path) -> Path:
    """One that may be changed."""
    return Path(shutil.copytree(recorded / LINE.name(0), tmp_path / "session"))


def job(
    session: Path | str, tmp_path: Path, fleet_options: FleetOptions = ASKED, prior: str = ""
) -> Job:
    return Job(Entry("a", str(session), prior=prior), fleet_options, str(tmp_path / "fleet"))


@pytest.mark.slow
def test_a_job_writes_a_calibration_a_report_exports_and_one_json(
    session: Path, tmp_path: Path
) -> None:
    result = run_job(job(session, tmp_path, FleetOptions(QUICK, (0.5,), ("stmap", "npz"))))
    assert (result.state, result.sentence, result.views) == (JobState.CALIBRATED, "", 6)
    folder = tmp_path / "fleet" / "cameras" / "a"
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert {
        "calibration.yaml",
        "calibration.npz",
        "rays.npz",
        "map_0.5m.npz",
        "report.html",
        "npz/map_0.5m.npz",
    } <= names
    assert any(name.startswith("stmap/") for name in names)
    assert {f"cameras/a/{name}" for name in names} >= set(result.written)
    assert Calibration.load(folder).request.session == str(session)
    assert result.numbers["error_px"].value == Calibration.load(folder).stages[-1].rms_px
    assert read_result(tmp_path / "fleet", "a") == result
    assert json.loads(place_of(tmp_path / "fleet", "a").read_text())["state"] == "calibrated"


@pytest.mark.slow
def test_finished_work_is_repeated_only_after_a_change(session: Path, tmp_path: Path) -> None:
    first_job = job(session, tmp_path)
    written = tmp_path / "fleet" / "cameras" / "a" / "calibration.yaml"

    def again(item: Job) -> bool:
        """Whether it is fitted anew."""
        modified = written.stat().st_mtime_ns
        assert run_job(item).state is JobState.CALIBRATED
        return written.stat().st_mtime_ns != modified

    first = run_job(first_job)
    assert not again(first_job)
    os.utime(session / "session.yaml", (1, 1))  # copied, with the same contents
    assert not again(first_job)
    (session / ".hidden").write_text("")
    (session / "calibration").mkdir()
    (session / "calibration" / "calibration.yaml").write_text("")
    assert not again(first_job)
    assert run_job(first_job) == replace(first, identity=run_job(first_job).identity)
    assert again(replace(first_job, options=FleetOptions(replace(QUICK, grid=(4, 4)))))
    lines = (session / "corners.vnl").read_text().splitlines(keepends=True)
    (session / "corners.vnl").write_text("".join(lines[:-36]))
    assert again(replace(first_job, options=FleetOptions(replace(QUICK, grid=(4, 4)))))
    (tmp_path / "fleet" / "cameras" / "a" / "report.html").unlink()
    assert again(replace(first_job, options=FleetOptions(replace(QUICK, grid=(4, 4)))))


def test_a_json_that_was_cut_short_is_no_result(session: Path, tmp_path: Path) -> None:
    first_job = job(session, tmp_path)
    run_job(first_job)
    place = place_of(tmp_path / "fleet", "a")
    complete_text = place.read_text()
    for text in (
        complete_text[: len(complete_text) // 2],
        "[]",
        '{"format": 1}',
        complete_text.replace('"numbers": {', '"numbers": {"x": 1, ', 1),
    ):
        place.write_text(text)
        assert read_result(tmp_path / "fleet", "a") is None
    refused = run_job(first_job)
    assert refused.state is JobState.FAILED
    assert "cameras/a.json has changed since calib wrote it" in refused.sentence
    assert place.read_text() == text
    assert run_job(replace(first_job, overwrite=True)).state is JobState.CALIBRATED
    assert read_result(tmp_path / "fleet", "a") is not None


def test_a_worker_that_is_killed_after_its_fit_leaves_it_to_the_next(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("calib.fleet.job.fleet_numbers", killed)
        with pytest.raises(KeyboardInterrupt):
            run_job(job(session, tmp_path))
    assert read_result(tmp_path / "fleet", "a") is None
    written = tmp_path / "fleet" / "cameras" / "a" / "calibration.yaml"
    modified = written.stat().st_mtime_ns
    assert run_job(job(session, tmp_path)).state is JobState.CALIBRATED
    assert written.stat().st_mtime_ns == modified
    place_of(tmp_path / "fleet", "a").unlink()
    assert (
        run_job(job(session, tmp_path, FleetOptions(replace(QUICK, grid=(4, 4))))).state
        is JobState.CALIBRATED
    )
    assert written.stat().st_mtime_ns != modified


def test_too_little_data_is_a_result_that_stays(session: Path, tmp_path: Path) -> None:
    lines = (session / "corners.vnl").read_text().splitlines(keepends=True)
    (session / "corners.vnl").write_text("".join(lines[: 1 + 2 * 36]))
    result = run_job(job(session, tmp_path))
    assert result.state is JobState.TOO_LITTLE
    assert result.sentence.startswith("A fit needs 3 usable views and there are 2")
    place = place_of(tmp_path / "fleet", "a")
    modified = place.stat().st_mtime_ns
    assert run_job(job(session, tmp_path)) == result
    assert place.stat().st_mtime_ns == modified


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("truncated", "line 91 has 3 columns"),
        ("missing", "does not exist"),
        ("empty", "has no session.yaml"),
    ],
)
def test_unreadable_input_is_a_result_that_is_tried_again(
    session: Path, tmp_path: Path, damage: str, message: str
) -> None:
    damaged = Path(shutil.copytree(session, tmp_path / "kept"))
    if damage == "truncated":
        lines = (session / "corners.vnl").read_text().splitlines(keepends=True)
        (session / "corners.vnl").write_text("".join(lines[:90]) + lines[90].rpartition(" ")[0])
    else:
        shutil.rmtree(session)
        if damage == "empty":
            session.mkdir()
    result = run_job(job(session, tmp_path))
    assert result.state is JobState.FAILED
    assert message in result.sentence
    shutil.rmtree(session, ignore_errors=True)
    damaged.rename(session)
    assert run_job(job(session, tmp_path)).state is JobState.CALIBRATED


def test_a_bug_is_a_result_too(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("calib.fleet.job.fit", broken)
    result = run_job(job(session, tmp_path))
    assert result.state is JobState.FAILED
    assert (
        result.sentence
        == "This is a bug in calib (ZeroDivisionError: by zero): report it with this session."
    )


@pytest.mark.slow
def test_a_camera_is_checked_against_its_prior(recorded: Path, tmp_path: Path) -> None:
    """The camera's session of another day agrees with the prior; that of another camera, with a
    bumped lens, does not.
    """
    for attempt, fleet in ((1, "before"), (2, "now")):
        write_session(tmp_path / fleet / "session", replace(LINE, views=8), 0, attempt=attempt)
    run_job(job(tmp_path / "before" / "session", tmp_path / "before"))
    prior = str(tmp_path / "before" / "fleet" / "cameras" / "a")
    same = run_job(job(tmp_path / "now" / "session", tmp_path / "now", prior=prior))
    assert same.check["answer"] == "valid"
    other_camera = run_job(job(recorded / LINE.name(1), tmp_path / "other", prior=prior))
    assert other_camera.check["answer"] != "valid"
    assert other_camera.check["changes"]
    without_prior = run_job(
        job(tmp_path / "now" / "session", tmp_path / "lost", prior=str(tmp_path / "nowhere"))
    )
    assert without_prior.state is JobState.CALIBRATED
    (remark,) = without_prior.remarks
    assert remark.startswith("Its prior could not be checked: ")
    assert "does not exist" in remark


@pytest.mark.slow
def test_a_camera_whose_verdict_asks_for_it_is_diagnosed(tmp_path: Path) -> None:
    line = replace(LINE, views=14, broken=("stretched-board",))
    number = next(number for number in range(line.cameras) if line.fault(number))
    write_session(tmp_path / "session", line, number)
    result = run_job(job(tmp_path / "session", tmp_path))
    assert result.effects[0] == "board_scale"
    assert result.report == "cameras/a/diagnosed/report.html"
    assert (
        result.numbers["error_px"].value
        > 1.05
        * Calibration.load(tmp_path / "fleet" / "cameras" / "a" / "diagnosed").stages[-1].rms_px
    )


def test_a_job_waits_for_another_one_on_the_same_camera(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calib.fleet.job.PATIENCE_S", 0.1)
    with FileSet(tmp_path / "fleet" / "cameras" / "a"):
        result = run_job(job(session, tmp_path))
    assert result.state is JobState.FAILED
    assert result.sentence.startswith("Another calib writes to")


def test_a_session_at_an_address_is_read_where_the_job_runs(session: Path, tmp_path: Path) -> None:
    files = fsspec.filesystem("memory")
    files.put(str(session), "/line/a", recursive=True)
    remote_job = job("memory://line/a", tmp_path)
    result = run_job(remote_job)
    assert result.state is JobState.CALIBRATED
    assert (
        Calibration.load(tmp_path / "fleet" / "cameras" / "a").request.session == "memory://line/a"
    )
    assert run_job(remote_job) == result
    files.pipe("/line/a/corners.vnl", files.cat("/line/a/corners.vnl") + b"\n")
    assert run_job(remote_job) != result
    assert "cannot be read" in run_job(job("nowhere://a", tmp_path / "else")).sentence
