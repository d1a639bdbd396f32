"""The reason why the maps' accuracy is not computed, in words that say what is known."""

import shutil
from pathlib import Path

import pytest

from capture.session_file import read_setup
from capture.tui.adviser import COMPUTED, LENS_BY_FIT, LENS_FIRST, Adviser
from capture.tui.camera import Task
from tests.capture.tui.test_session import FIXTURE


@pytest.mark.parametrize(
    ("like", "sentence"),
    [
        (
            "clean",
            (
                "computed by the fit: the known lens is for pictures of 1640x1232 px, and these"
                " have 820x616."
            ),
        ),
        ("covered-bare", "computed by the fit: the lens is not known."),
    ],
)
def test_missing_lens_numbers_are_named_before_the_first_view(
    tmp_path: Path, like: str, sentence: str
) -> None:
    adviser = Adviser(
        Task(tmp_path, "", read_setup(FIXTURE.parent / like / "session.yaml"), bare=False),
        (820, 616),
    )
    assert len(list(adviser.improve([]))) == 1
    assert adviser.remark.endswith(sentence)
    adviser.close()


@pytest.mark.parametrize(
    ("like", "has_bare", "sentence"),
    [
        ("covered-bare", False, LENS_BY_FIT),
        ("covered-bare", True, LENS_FIRST),
        ("clean", False, LENS_BY_FIT),  # its lens is for pictures of another size
        ("tilted", False, COMPUTED),
    ],
)
def test_what_the_accuracy_of_the_maps_waits_for_is_said(
    tmp_path: Path, like: str, has_bare: bool, sentence: str
) -> None:
    if has_bare:
        shutil.copytree(FIXTURE / "bare", tmp_path / "bare")
    task = Task(tmp_path, "", read_setup(FIXTURE.parent / like / "session.yaml"), bare=False)
    adviser = Adviser(task, (820, 616))
    assert adviser.awaited == sentence
    adviser.close()


@pytest.mark.slow
def test_guidance_is_computed_before_the_first_view_for_a_known_lens(tmp_path: Path) -> None:
    adviser = Adviser(
        Task(tmp_path, "", read_setup(FIXTURE.parent / "tilted" / "session.yaml"), bare=False),
        (820, 616),
    )
    assert list(adviser.improve([]))
    assert not adviser.remark
    assert adviser.advise([])[1].sentence.startswith("The maps are likely off by")
    adviser.close()
