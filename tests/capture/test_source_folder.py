"""Checks of a source folder: the same pictures cannot be those with and those without the cover."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from capture.cli import main
from capture.source_folder import describe_repeat
from tests.capture.recordings import BOARD_FLAGS, noise, write_recording


def _picture(seed: int) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (48, 64), np.uint8)


def _write(folder: Path, *seeds: int, suffix: str = ".png") -> Path:
    folder.mkdir(parents=True)
    for number, seed in enumerate(seeds):
        cv2.imwrite(str(folder / f"{number:04d}{suffix}"), _picture(seed))
    return folder


def test_the_same_pictures_are_not_taken_for_both_kinds(tmp_path: Path) -> None:
    session = tmp_path / "session"
    _write(session / "bare", 1, 2)
    photos = _write(tmp_path / "photos", 1, 2, 3)
    bare = session / "bare"
    assert describe_repeat(f"folder:{photos}", session, covered=True) == (
        f"folder:{photos} has the pictures that were recorded without the cover: name others,"
        " which were taken through the cover. If these show the cover, first move the pictures in"
        f" {bare} elsewhere."
    )
    assert describe_repeat(f"folder:{photos}", session, covered=False) == ""
    bare.rename(session / "frames")
    sentence = describe_repeat(str(photos), session, covered=False)
    assert "recorded through the cover: name others, which were taken without" in sentence
    assert "If these show no cover" in sentence


def test_pictures_of_the_same_names_are_no_repetition(tmp_path: Path) -> None:
    """A camera numbers its pictures from the same number each time."""
    session = tmp_path / "session"
    _write(session / "bare", 1, 2)
    photos = _write(tmp_path / "photos", 3, 4)
    assert describe_repeat(f"folder:{photos}", session, covered=True) == ""
    (photos / "0000.png").write_bytes(b"damaged")
    assert describe_repeat(f"folder:{photos}", session, covered=True) == ""
    assert describe_repeat("folder:/nowhere", session, covered=True) == ""
    assert describe_repeat("v4l2:/dev/video0", session, covered=True) == ""


def test_a_recording_refuses_the_pictures_of_the_other_kind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_recording(tmp_path / "source", noise(2))
    session = tmp_path / "session"
    words = ["record", str(session), "--source", f"folder:{source}", *BOARD_FLAGS, "--all"]
    assert main([*words, "--bare"]) == 0
    assert main(words) == 2
    assert "has the pictures that were recorded without the cover" in capsys.readouterr().err
    assert not (session / "frames").exists()
