"""A pattern such as 'card/**/*' that stands for the pictures of one camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.importing.named_pictures import find_pictures
from calib.importing.picture_session import Description, describe_pictures
from calib.progress import Silent
from calib.session.board import Board

PATTERN = Path("card/**/*")


@pytest.fixture
def card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two pictures in each of two folders of one name, and what is no picture."""
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate(("a/DCIM/1.png", "a/DCIM/2.png", "b/DCIM/1.png", "b/DCIM/2.png")):
        path = Path("card") / name
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), np.full((4, 6), number, np.uint8))
    for name in ("b/DCIM/3.HEIC", "b/DCIM/._1.png", ".Trashes/4.png"):
        path = Path("card") / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"foreign")
    return Path("card")


def describe() -> tuple[str, ...]:
    source = find_pictures([PATTERN])
    description = Description(Board(4, 3, 0.02), {"shape": "none"}, {}, {})
    return describe_pictures(source, description, Silent())


def test_each_picture_is_taken_once(card: Path) -> None:
    """The pattern matches the folders, too, and hidden files are not meant."""
    source = find_pictures([PATTERN])
    assert [str(path.relative_to(card)) for path in source.pictures] == [
        "a/DCIM/1.png",
        "a/DCIM/2.png",
        "b/DCIM/1.png",
        "b/DCIM/2.png",
    ]
    assert source.session == card / "session"


def test_pictures_of_equal_names_stay_apart_and_others_are_named(card: Path) -> None:
    (notice,) = describe()
    assert notice.startswith("left out, files that are not read as pictures: 3.HEIC.")
    names = sorted(path.name for path in (card / "session" / "frames").glob("*.png"))
    assert names == ["a-DCIM-1.png", "a-DCIM-2.png", "b-DCIM-1.png", "b-DCIM-2.png"]


def test_the_copies_of_an_earlier_fit_are_not_taken(card: Path) -> None:
    describe()
    calibration = card / "session" / "calibration"
    calibration.mkdir()
    (calibration / "calibration.yaml").touch()
    assert len(find_pictures([PATTERN]).pictures) == 4
    copies = find_pictures([Path("card/session/frames/a-*.png")])
    assert len(copies.pictures) == 2, "they are meant if they alone are named"
