"""The next commands can be typed as they are printed."""

import shlex
from pathlib import Path

from calib.fit_record.request import Settings
from calib.verdict.next_commands import NextCommands


def test_paths_are_quoted_and_usual_options_left_out() -> None:
    commands = NextCommands(Path("my session"), Path("my session/calibration"), Settings())
    assert commands.fit() == "calib fit 'my session'"
    assert commands.capture() == "capture 'my session'"
    assert shlex.split(commands.diagnose("--holdout", "a b")) == [
        "calib",
        "diagnose",
        "my session/calibration",
        "--holdout",
        "a b",
    ]
    assert commands.evaluate() == "calib evaluate 'my session/calibration' HOLDOUT"
    out = "my session/calibration"
    words = [
        "calib",
        "undistort",
        out,
        "my session/frames",
        "--depth",
        "0.5",
        "-o",
        f"{out}/undistorted",
    ]
    assert shlex.split(commands.undistort(0.5)) == words


def test_a_map_that_is_written_is_used_and_not_exported_again(tmp_path: Path) -> None:
    commands = NextCommands(tmp_path, tmp_path / "calibration", Settings())
    assert commands.use_maps(0.5) == commands.evaluate(), "there are no pictures to undistort"
    (tmp_path / "a.png").touch()
    assert f"undistort {tmp_path / 'calibration'} {tmp_path} --depth 0.5" in commands.use_maps(0.5)
    (tmp_path / "frames").mkdir()
    assert str(tmp_path / "frames") in commands.use_maps(0.5)


def test_a_fit_is_asked_for_again_as_it_was() -> None:
    settings = Settings(method="paper", grid=(8, 6), free=("thickness", "index"))
    commands = NextCommands(Path("s"), Path("out"), settings)
    assert commands.fit() == "calib fit s --method paper --grid 8x6 --free thickness,index -o out"
    assert (
        commands.fit("--free", "all") == "calib fit s --method paper --grid 8x6 -o out --free all"
    )
    assert "8x6" not in commands.fit("--grid", "auto")
