"""The settings and fixtures of all tests."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import gettempdir

import pytest
import torch
from hypothesis import configuration, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants
from threadpoolctl import threadpool_limits
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling

settings.register_profile("refracal", derandomize=True, deadline=None, database=None)
settings.load_profile("refracal")
configuration.set_hypothesis_home_dir(
    Path(gettempdir()) / "refracal-hypothesis"
)  # its tables of Unicode: not into the checkout
# It would draw constants from whatever modules of ours are loaded: others for each choice of tests
# and each worker.
setattr(providers, "_get_local_constants", Constants)  # noqa: B010
# Every worker, and every command that a test starts, would compile the same files again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
os.environ["REFRACAL_TRACEBACK"] = "1"  # a bug in a check of the verdict fails the test
sys.dont_write_bytecode = False

SHARED = ("checking", "report", "rig", "verdict")
"""Folders whose tests stay together in one worker, because they share calibrations that take
seconds.
"""
LONGEST = (
    *SHARED,
    *("test_fixtures.py", "capture/tui/test_session.py", "commands/test_choices.py"),
    *(
        "commands/test_coded_boards.py",
        "diagnosis/test_diagnose.py",
        "test_library.py",
        "commands/test_cli.py",
        "optics/test_shapes.py",
    ),
    *(
        "corners/test_board_search.py",
        "corners/test_other_coding.py",
        "test_border_fixtures.py",
    ),
    *("fleet/test_job.py", "fleet/test_run.py"),
    *(
        "capture/tui/test_snapshots.py",
        "capture/test_coded_live.py",
        "corners/test_detect_all.py",
        "capture/tui/test_faults.py",
    ),
)
"""Folders and files of half a minute of work and more: begun first, for whichever comes last leaves
the other worker idle.
"""


class SharedFixtures(LoadFileScheduling):  # type: ignore[misc]
    """Give a worker whole files, as `--dist loadfile` does, and the folders of SHARED whole."""

    def _split_scope(self, nodeid: str) -> str:
        return _unit(Path(super()._split_scope(nodeid)).relative_to("tests")).as_posix()


def _unit(file: Path) -> Path:
    """Return what a worker is given with a file, relative to this folder: it, or its folder."""
    return Path(file.parts[0]) if file.parts[0] in SHARED else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadFileScheduling:
    return SharedFixtures(config, log)


def pytest_configure(config: pytest.Config) -> None:
    config.option.loadscopereorder = False  # xdist would begin with the files of the most tests
    gc.disable()


def pytest_collection_finish() -> None:
    """Freeze the loaded objects, so that no garbage collection looks through torch again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(200_000, 10, 10)
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    folder = Path(__file__).parent
    place = {Path(name): number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(_unit(item.path.relative_to(folder)), len(place)))


@pytest.fixture(autouse=True, scope="session")
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the terminal UI's saved state out of the home of the person who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True, scope="session")
def _activated() -> Iterator[None]:
    """Activate the virtual environment, so that the next commands are named without a folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
        yield


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report without its figures, for tests of something else."""
    monkeypatch.setattr("calib.report.write.DRAWINGS", ())


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> Iterator[None]:
    """Small tensors and matrices: threads only cost time, most of all on a busy machine; in
    processes that tests start, too.
    """
    torch.set_num_threads(1)
    with threadpool_limits(1, user_api="blas"), pytest.MonkeyPatch.context() as patch:
        for library in ("OMP", "OPENBLAS"):
            patch.setenv(f"{library}_NUM_THREADS", "1")
        yield
