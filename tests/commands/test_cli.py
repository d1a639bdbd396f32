"""The command as a person runs it: names, exit codes, JSON keys, sentences, and no traceback
ever.
"""

import math
import re
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main
from calib.commands.printing import print_json
from calib.diagnosis.requested_effects import NAMES
from calib.io.files import check_writable
from calib.io.output_folder import LEDGER
from calib.verdict.next_commands import HOLDOUT_NOTE, TESTED_NOTE
from fixtures.synthetic import scene
from tests.session.malformed import MALFORMED, Malformed, write_good_session
from tests.test_calibration import write_session


def test_fit_json_keeps_the_contract(fitted: tuple[Path, dict[str, object]]) -> None:
    _, document = fitted
    contract = {
        "frames_used",
        "frames_rejected",
        "corners",
        "noise_px",
        "seconds",
        "stages",
        "effects",
        "verdict",
        "written",
    }
    calibrated = {"camera", "cover", "board", "calibration"}
    details = {"still_boards", "second_look", "outlier_corners", "view_noise", "lens"}
    assert set(document) == contract | calibrated | details
    assert document["frames_used"] == 6
    assert document["frames_rejected"] == []
    assert document["corners"] == 6 * 81
    assert document["effects"] == []
    stages = document["stages"]
    assert isinstance(stages, list)
    assert [stage["name"] for stage in stages] == ["pinhole", "cover", "cover+rbf"]
    assert all(set(stage) == {"name", "rms_px", "rmse_cm"} for stage in stages)


def test_fit_json_says_what_was_calibrated(fitted: tuple[Path, dict[str, object]]) -> None:
    folder, document = fitted
    calibration = Calibration.load(str(document["calibration"]))
    assert document["calibration"] == str(folder / "calibration" / "calibration.yaml")
    camera = document["camera"]
    assert isinstance(camera, dict)
    assert set(camera) == {"fx", "fy", "cx", "cy", "lens", "distortion", "width", "height"}
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    assert camera["fx"] == {"value": intrinsics.fx.value, "sigma": intrinsics.fx.sigma}
    cover = document["cover"]
    assert isinstance(cover, dict)
    thickness = calibration.cover.parameters["thickness"]
    assert cover["thickness_mm"]["value"] == pytest.approx(1e3 * thickness.value)
    assert thickness.sigma > 0
    assert cover["thickness_mm"]["sigma"] == pytest.approx(1e3 * thickness.sigma)
    assert cover["thickness_mm"]["declared"] == pytest.approx(3.0)


def test_fit_json_carries_the_verdict_and_the_written_files(
    fitted: tuple[Path, dict[str, object]],
) -> None:
    folder, answer = fitted
    out = folder / "calibration"
    names = ("calibration.yaml", "rays.npz", "map_1m.npz", "map_0.5m.npz", "report.html")
    assert answer["written"] == [str(out / name) for name in names]
    verdict = answer["verdict"]
    assert isinstance(verdict, dict)
    assert list(verdict) == ["word", "maps_hold", "reasons", "suspects", "next", "notes"]
    assert verdict["word"] == "care"
    assert any("6 poses of the board are too few" in reason for reason in verdict["reasons"])
    assert verdict["next"].endswith(str(folder))


def test_the_last_lines_are_the_verdict_and_the_next_command(
    fitted: tuple[Path, dict[str, object]], capsys: pytest.CaptureFixture[str]
) -> None:
    out = fitted[0] / "calibration"
    assert main(["evaluate", str(out), str(fitted[0])]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "Take care before you trust it." in lines
    assert lines[-3].startswith("- ")
    assert lines[-2] == f"Next: {shlex.join(['calib', 'evaluate', str(out), 'HOLDOUT'])}"
    assert lines[-1] == HOLDOUT_NOTE


@pytest.mark.usefixtures("without_figures")
def test_a_fit_that_has_tested_itself_proposes_no_other_folds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = Path(__file__).parents[2] / "fixtures" / "covered-bare"
    options = ["--grid", "1x1", "--folds", "3", "-o", str(tmp_path)]
    assert main(["fit", str(session), *options]) == 0
    output = capsys.readouterr().out
    assert "Tested by 3 more fits, each of which left out a different part of the views:" in output
    assert output.splitlines()[-1] == TESTED_NOTE


@pytest.mark.usefixtures("without_figures")
def test_a_fit_ends_with_the_next_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = Path(__file__).parents[2] / "fixtures" / "covered-bare"
    assert main(["fit", str(session), "--grid", "5x5", "-o", str(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert "fitted cover" in output
    assert "cover+rbf" not in output
    *_, test, following, second, third, note = output.splitlines()
    assert note == HOLDOUT_NOTE
    undistort = shlex.split(following.removeprefix("Next: "))
    evaluate = shlex.split(test.removeprefix("Test: "))
    diagnose, export = shlex.split(second.removeprefix("Then: ")), shlex.split(third)
    assert evaluate == ["calib", "evaluate", str(tmp_path), "HOLDOUT"]
    assert diagnose == ["calib", "diagnose", str(tmp_path)]
    assert main(undistort[1:]) == 0
    assert (tmp_path / "undistorted" / "0000.jpg").exists()
    assert export[:3] == ["calib", "export", str(tmp_path)]


def test_the_help_of_a_fit_names_every_effect(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["fit", "--help-all"])
    output = capsys.readouterr().out
    assert max(map(len, output.splitlines())) <= 80
    names = output.partition("\neffects: ")[2].partition(".")[0]
    assert names.replace("\n", " ").split(", ") == list(NAMES)


def test_the_help_describes_every_effect(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a terminal of 80 columns a long line goes on below its second column."""
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["diagnose", "--help-all"])
    output = capsys.readouterr().out
    assert max(map(len, output.splitlines())) <= 80
    listed = re.findall(
        r"^  (\w+) +(\S.*(?:\n {20}\S.*)*)$", output.partition("\neffects:\n")[2], re.MULTILINE
    )
    assert [name for name, _ in listed] == list(NAMES)
    assert all(len(words.split()) > 2 for _, words in listed)
    assert any("\n" in words for _, words in listed)


@pytest.mark.slow
@pytest.mark.usefixtures("without_figures")
def test_a_trusted_fit_names_an_export_command_that_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_session(
        tmp_path / "my session", scene(11, views=24, noise=0.05, depths=(0.35, 1.2))
    )
    assert main(["fit", str(folder), "--grid", "5x5"]) == 0
    *_, word, _, last, _, _ = capsys.readouterr().out.splitlines()
    assert word == "You can trust this calibration where the board was in the picture."
    program, *arguments = shlex.split(last.removeprefix("Next: "))
    assert program == "calib"
    assert main(arguments) == 0
    assert list((folder / "calibration" / "export").glob("map_*.npz"))
    assert main(["fit", str(folder), "--grid", "5x5", "--depth", "0.5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    following = next(line for line in lines if line.startswith("Next: "))
    assert "export" not in following, "the map is written"


def test_fit_leaves_calibration_field_and_a_map_for_every_depth(
    fitted: tuple[Path, dict[str, object]],
) -> None:
    out = fitted[0] / "calibration"
    assert sorted(path.name for path in out.iterdir()) == [
        LEDGER,
        "calibration.npz",
        "calibration.yaml",
        "map_0.5m.npz",
        "map_1m.npz",
        "rays.npz",
        "report.html",
    ]
    with np.load(out / "map_1m.npz") as file:
        assert set(file) == {"calibration", "map_x", "map_y", "valid", "depth_m", "sigma"}
        assert file["calibration"] == Calibration.load(out).digest
        assert file["map_x"].shape == (2464, 3280)
        assert file["depth_m"] == 1.0


def test_export_gives_the_same_map_without_the_session(
    fitted: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    out = fitted[0] / "calibration"
    assert main(["export", str(out), "--format", "npz", "--depth", "0.5", "-o", str(tmp_path)]) == 0
    with np.load(out / "map_0.5m.npz") as ours, np.load(tmp_path / "map_0.5m.npz") as theirs:
        assert np.abs(ours["map_x"] - theirs["map_x"]).max() < 1e-6


def test_the_field_gives_any_other_depth(fitted: tuple[Path, dict[str, object]]) -> None:
    from calib.calibration import Calibration
    from calib.export.npz import read_field

    out = fitted[0] / "calibration"
    field = read_field(out / "rays.npz")
    direct = Calibration.load(out).undistort_maps(0.33)[0]
    assert np.abs(field.map_at(0.33).x - direct).max() < 1e-3


@pytest.mark.parametrize(
    ("depth", "colour"),
    [(np.uint8, False), (np.uint8, True), (np.uint16, False), (np.uint16, True)],
)
def test_undistort_applies_the_exported_map(
    fitted: tuple[Path, dict[str, object]], tmp_path: Path, depth: type, colour: bool
) -> None:
    """A smooth ramp: every undistorted pixel holds its own distorted coordinate, so the map can be
    read off the picture.
    """
    out = fitted[0] / "calibration"
    top = np.iinfo(depth).max
    ramp: np.ndarray = np.broadcast_to(np.arange(3280) / 3280 * 0.8 * top, (2464, 3280)).astype(
        depth
    )
    cv2.imwrite(str(tmp_path / "ramp.png"), np.dstack([ramp] * 3) if colour else ramp)
    assert (
        main(
            [
                "undistort",
                str(out),
                str(tmp_path / "ramp.png"),
                "--depth",
                "1",
                "-o",
                str(tmp_path / "flat"),
            ]
        )
        == 0
    )
    flat = cv2.imread(str(tmp_path / "flat" / "ramp.png"), cv2.IMREAD_UNCHANGED)
    assert flat is not None
    assert flat.dtype == depth
    assert flat.ndim == (3 if colour else 2)
    with np.load(out / "map_1m.npz") as file:
        expected, valid = file["map_x"] / 3280 * 0.8 * top, file["valid"]
    inner = valid & (expected > 0.01 * top) & (expected < 0.78 * top)
    grey = flat[..., 0] if colour else flat
    assert np.abs(grey[inner].astype(float) - expected[inner]).max() < max(2.0, 2e-4 * top)
    assert (grey[~valid] == 0).all()


@pytest.mark.parametrize("case", MALFORMED, ids=lambda case: case.name)
def test_malformed_sessions_get_their_sentence_and_exit_code(
    case: Malformed, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = write_good_session(tmp_path / "session")
    case.spoil(folder)
    code = main(["fit", str(folder), "--steps", "2", "--json"])
    out, err = capfd.readouterr()
    assert code == (3 if case.is_extra else case.exit_code), err
    assert code in (2, 3)
    assert not case.is_extra or "(0003.npy is left out: " in err
    assert out == ""
    assert "Traceback" not in err
    _, *below = err[err.index("calib: error: ") :].strip().splitlines()
    assert all(line.startswith("  ") for line in below), "choices alone stand below the sentence"


def test_undistort_asks_for_the_distance(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["undistort", "x", "y", "-o", "z"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--depth 0.8" in line
    assert "--depth-image" in line


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fit"], "SESSION"),
        (["fit", "x", "--grid", "8"], "write two whole numbers from 2 to 64, such as 8x8"),
        (["fit", "x", "--grid", "1x8"], "write two whole numbers"),
        (["fit", "x", "--steps", "0"], "whole number above 0"),
        (["fit", "x", "--depth", "-1"], "metres above 0"),
        (["fit", "x", "--depth", "nan"], "metres above 0"),
        (["export", "x", "--format", "bmp", "-o", "y"], "invalid choice"),
        (["calibrate"], "invalid choice"),
        (["fti"], "did you mean fit?"),
        (["show", "x"], "did you mean report?"),
        (["fit", "x", "--cover", "window"], "did you mean flat?"),
        (["export", "x", "--format", "npz", "--depth", "0.8,1", "-o", "y"], "blanks between them"),
        (["fit", "x", "--squaremm", "2"], "did you mean --square-mm?"),
        (["export", "x", "--format", "opencb", "-o", "y"], "did you mean opencv?"),
        ([], "COMMAND"),
    ],
)
def test_wrong_usage_exits_with_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert says in capsys.readouterr().err


def test_undistort_refuses_existing_outputs_and_pictures_of_another_size(
    fitted: tuple[Path, dict[str, object]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(fitted[0] / "calibration")
    picture = tmp_path / "small.png"
    cv2.imwrite(str(picture), np.zeros((48, 64), np.uint8))
    (tmp_path / "loop.png").symlink_to(tmp_path / "loop.png")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    twice = [str(picture), str(picture), "-o", str(tmp_path / "out")]
    for arguments, says in (
        (twice, "is 64x48 px where the calibration is for 3280x2464"),
        ([str(picture), "-o", str(tmp_path)], "would be overwritten"),
        (
            [str(picture), "-o", str(tmp_path / "out")],
            "is 64x48 px where the calibration is for 3280x2464",
        ),
        ([str(tmp_path / "none.png"), "-o", str(tmp_path / "out")], "none.png"),
        ([str(tmp_path / "none"), "-o", str(tmp_path / "out")], "none cannot be read (No such"),
        (
            [str(tmp_path / "empty"), "-o", str(tmp_path / "out")],
            "There are no pictures to undistort",
        ),
        ([str(tmp_path / f"{'x' * 300}.jpg"), "-o", str(tmp_path / "out")], "File name too long"),
        ([str(tmp_path / "loop.png"), "-o", str(tmp_path / "out")], "loop.png cannot be read"),
        ([str(picture), "-o", str(tmp_path / "loop")], "loop cannot be made"),
        ([str(picture), "-o", str(tmp_path / "straight.jpg")], "looks like a picture: write -o"),
        (
            [str(tmp_path / "noext"), "-o", str(tmp_path / "out")],
            "noext is neither a picture nor a video by its name",
        ),
        ([str(tmp_path / "b.jpg.bak"), "-o", str(tmp_path / "out")], "one of .png, .jpg"),
        (
            [str(tmp_path / "a.gif"), "-o", str(tmp_path / "out")],
            "a.gif is of a type that is not read: convert them, such as by `mogrify",
        ),
    ):
        (tmp_path / "empty").mkdir(exist_ok=True)
        for name in ("noext", "b.jpg.bak", "a.gif"):
            (tmp_path / name).touch()
        assert main(["undistort", out, *arguments, "--depth", "1"]) == 2
        assert says in capsys.readouterr().err


@pytest.mark.parametrize("name", ["deep.jpg", "deep.BMP"])
def test_sixteen_bits_are_not_clipped_into_eight(
    fitted: tuple[Path, dict[str, object]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
) -> None:
    cv2.imwrite(str(tmp_path / "deep.png"), np.full((2464, 3280), 40000, np.uint16))
    (tmp_path / "deep.png").rename(tmp_path / name)
    out = str(fitted[0] / "calibration")
    assert (
        main(["undistort", out, str(tmp_path / name), "--depth", "1", "-o", str(tmp_path / "flat")])
        == 2
    )
    assert (
        f"{name} holds 16-bit pixels, which a {Path(name).suffix.lower()} cannot"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "flat").exists()


def test_unreadable_pictures_are_one_sentence(
    fitted: tuple[Path, dict[str, object]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    is_dir = Path.is_dir

    def locked(path: Path) -> bool:
        if path.parent.name == "locked":
            raise PermissionError(13, "Permission denied", str(path))
        return is_dir(path)

    monkeypatch.setattr(Path, "is_dir", locked)
    picture = str(tmp_path / "locked" / "a.png")
    assert (
        main(
            [
                "undistort",
                str(fitted[0] / "calibration"),
                picture,
                "--depth",
                "1",
                "-o",
                str(tmp_path / "out"),
            ]
        )
        == 2
    )
    assert f"{picture} cannot be read (Permission denied)" in capsys.readouterr().err


@pytest.mark.parametrize(("options", "said"), [([], True), (["--crop", "0"], False)])
def test_black_borders_are_explained(
    fitted: tuple[Path, dict[str, object]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    said: bool,
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((2464, 3280), np.uint8))
    words = [str(fitted[0] / "calibration"), str(tmp_path / "a.png"), "--depth", "1", *options]
    assert main(["undistort", *words, "-o", str(tmp_path / "straight")]) == 0
    printed = capsys.readouterr().err
    assert ("% of the straight picture is black" in printed) == said
    assert ("Type --crop 0 for a picture with no black border." in printed) == said


@pytest.mark.parametrize("failing", ["make", "write"])
def test_an_output_folder_is_tried_before_the_fit(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    failing: str,
) -> None:
    def late(*_: object) -> None:
        raise AssertionError("the fit began")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("calib.fitting.fit.fit", late)
    folder = write_session(tmp_path / "s", scene(8, views=3))
    if failing == "make":
        (tmp_path / "out").write_text("in the way")
    else:
        monkeypatch.setattr("calib.io.files.fsync", full)
    assert main(["fit", str(folder), "-o", str(tmp_path / "out")]) == 2
    says = (
        "out cannot be made"
        if failing == "make"
        else "out cannot be written (No space left on device): free some space there"
    )
    assert says in capsys.readouterr().err


def test_a_trial_write_leaves_nothing(tmp_path: Path) -> None:
    check_writable(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_json_has_null_where_a_number_is_not_finite(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": math.nan, "b": [{"c": np.float64(np.inf), "d": 1.5}], "e": (1, "NaN", None)})
    assert (
        capsys.readouterr().out
        == '{"a": null, "b": [{"c": null, "d": 1.5}], "e": [1, "NaN", null]}\n'
    )


def test_results_that_cannot_be_written_are_one_sentence(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder = write_session(tmp_path / "s", scene(8, views=3))
    (tmp_path / "file").write_text("in the way")
    assert main(["fit", str(folder), "--steps", "1", "-o", str(tmp_path / "file")]) == 2
    assert "cannot be made" in capsys.readouterr().err
