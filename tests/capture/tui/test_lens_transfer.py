"""A session through its cover without a lens: the fit estimates it, or another session gives its
lens later.
"""

import shutil
from pathlib import Path

import pytest
from textual.widgets import Input

from calib.errors import InputError
from capture.session_file import read_calibrated, read_setup
from capture.tui.lens_transfer import read_lens, write_lens
from capture.tui.session_state import describe_session
from tests.capture.tui.driving import confirm_cover, describe, drive, running, see, until, write
from tests.capture.tui.test_session import FIXTURE

KNOWN = FIXTURE.parent / "tilted"
"""A session that knows its lens, for pictures of the same size."""
FOCAL = 639.6
"""px, of the camera that FIXTURE is rendered with."""
LARGE = FIXTURE.parent / "bumps"


@pytest.fixture
def covered(tmp_path: Path) -> Path:
    """Two pictures through the cover."""
    folder = tmp_path / "covered"
    folder.mkdir()
    for name in ("0001.jpg", "0002.jpg"):
        shutil.copy(FIXTURE / "frames" / name, folder)
    return folder


@pytest.mark.slow
def test_a_lens_that_is_missing_can_be_lent_later(tmp_path: Path, covered: Path) -> None:
    session = tmp_path / "session"
    drive(_lent(session, f"folder:{covered}"))
    _, camera, cover = read_setup(session / "session.yaml")
    assert camera.intrinsics == read_setup(KNOWN / "session.yaml")[1].intrinsics
    assert cover == read_setup(FIXTURE / "session.yaml")[2]


async def _lent(session: Path, source: str) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, source)
        like = pilot.app.screen.query_one("#like", Input)
        await confirm_cover(pilot)
        await see(pilot, "2 views")
        await pilot.press("escape")
        await see(pilot, "continued")
        assert "Views without the cover would make its lens surer." in describe_session(session)
        like.focus()
        await see(pilot, "that knows the lens: that alone is taken from there")
        await pilot.press(*str(FIXTURE), "ctrl+s")
        await see(pilot, "does not know its lens either")
        like.value = str(KNOWN)
        await pilot.press("ctrl+s")
        await see(pilot, "[THROUGH COVER]")
        await see(pilot, "f Fit")
        await pilot.press("escape")
        await until(pilot, lambda: like.disabled)


@pytest.mark.slow
def test_a_camera_of_which_nobody_knows_the_lens_needs_no_views_without_its_cover(
    tmp_path: Path,
) -> None:
    source = shutil.copytree(FIXTURE / "frames", tmp_path / "pictures")
    drive(_unknown(tmp_path / "session", f"folder:{source}"))
    fitted = read_calibrated(tmp_path / "session" / "calibration" / "calibration.yaml")[1]
    assert fitted.intrinsics
    fx = fitted.intrinsics.fx
    assert abs(fx.value - FOCAL) < 3 * fx.sigma < 0.05 * FOCAL


async def _unknown(session: Path, source: str) -> None:
    async with running(session, source) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, source)
        await confirm_cover(pilot)
        await see(pilot, "12 views")
        await see(pilot, "f to fit")
        await pilot.press("f")
        await see(pilot, "[RESULTS]")
        await see(pilot, "You can trust this calibration where the board was in the picture.")


def test_a_lens_of_larger_pictures_is_not_taken_for_theirs(tmp_path: Path, covered: Path) -> None:
    drive(_larger(tmp_path / "session", f"folder:{covered}"))


async def _larger(session: Path, source: str) -> None:
    async with running(session, source) as pilot:
        await see(pilot, "a new session")
        await pilot.press("enter")
        await write(pilot, str(LARGE))
        await see(pilot, "record now through the cover")
        await pilot.press("ctrl+s")
        await see(pilot, "2 views")
        await see(pilot, "computed by the fit: the")


def test_the_other_keys_of_session_yaml_keep_their_text(tmp_path: Path) -> None:
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    file = tmp_path / "session.yaml"
    file.write_text("# mine\n" + file.read_text())
    original, setup = file.read_text(), read_setup(file)
    named_setup = read_lens(tmp_path, str(KNOWN))
    assert named_setup
    write_lens(tmp_path, named_setup)
    assert all(line in file.read_text().splitlines() for line in original.splitlines())
    updated = read_setup(file)
    assert (updated[0], updated[2]) == (setup[0], setup[2])
    assert updated[1].intrinsics == named_setup[1].intrinsics


def test_a_session_that_was_fitted_lends_the_lens_that_its_fit_found(tmp_path: Path) -> None:
    other_session, own_session = tmp_path / "other", tmp_path / "own"
    for folder in (other_session, own_session):
        folder.mkdir()
        shutil.copy(FIXTURE / "session.yaml", folder)
    with pytest.raises(InputError, match="does not know its lens either"):
        read_lens(own_session, str(other_session))
    (other_session / "calibration").mkdir()
    file_found = KNOWN / "session.yaml"  # the part that counts is written alike
    shutil.copy(file_found, other_session / "calibration" / "calibration.yaml")
    named_setup = read_lens(own_session, str(other_session))
    assert named_setup
    assert named_setup[1].intrinsics == read_setup(file_found)[1].intrinsics
    assert named_setup[2] == read_setup(other_session / "session.yaml")[2]


def test_a_camera_in_one_line_gets_its_lens_as_well(tmp_path: Path) -> None:
    file = tmp_path / "session.yaml"
    file.write_text(
        "format: 1\nboard: {columns: 9, rows: 9, square_mm: 20}\ncamera: {width: 820, height:"
        " 616}\ncover: {shape: none}\n"
    )
    named_setup = read_lens(tmp_path, str(KNOWN))
    assert named_setup
    write_lens(tmp_path, named_setup)
    assert read_setup(file)[1].intrinsics == named_setup[1].intrinsics


def test_a_lens_of_larger_pictures_is_refused(tmp_path: Path) -> None:
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    assert read_lens(tmp_path, "") is None
    with pytest.raises(InputError, match="1640x1232 px, and these are 820x616"):
        read_lens(tmp_path, str(LARGE))
