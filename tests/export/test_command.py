"""calib export: its files, what it says about the misfit, and what it refuses."""

import os
import re
from pathlib import Path

import pytest

from calib.calibration import Calibration
from calib.cli import main
from calib.export.file_names import file_names
from calib.export.formats import FORMATS, Format
from calib.io.output_folder import LEDGER


@pytest.fixture(scope="module")
def saved(covered: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibration")
    covered.save(folder)
    return folder


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_every_format_of_the_help_writes_its_files(
    small: Calibration,
    flat: Calibration,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    form: Format,
) -> None:
    if form.name == "stmap-exr":
        pytest.importorskip("OpenEXR")
    saved, out_folder = tmp_path / "saved", tmp_path / "out"
    (flat if form.name == "calibmar" else small).save(saved)
    assert (
        main(
            [
                "export",
                str(saved),
                "--format",
                form.name,
                "--depth",
                "0.5",
                "0.5",
                "-o",
                str(out_folder),
            ]
        )
        == 0
    )
    out, err = capsys.readouterr()
    written = out.split()
    files = sorted(path for path in out_folder.iterdir() if path.name != LEDGER)
    assert sorted(written) == [str(path) for path in files]  # 0.5 m is written once
    camera = Calibration.load(saved).camera
    names = file_names(form, (0.5,), (camera.width, camera.height))
    assert sorted(names) == [path.name for path in files], "what is in their way is refused early"
    for_every_depth = (
        not form.needs_depth and form.name != "npz"
    )  # npz takes depths, and needs none
    assert any("0.5m" in path for path in written) is not for_every_depth
    assert ("px RMS (" in err) is (bool(form.lenses) and not for_every_depth)


def test_the_help_lists_every_format(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["export", "--help-all"])
    text = " ".join(capsys.readouterr().out.split())
    for form in FORMATS:
        assert f" {form.name} {form.summary} " in f"{text} "


def test_a_file_for_every_depth_and_the_misfit_on_the_terminal(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(
            [
                "export",
                str(saved),
                "--format",
                "ros",
                "--depth",
                "0.2",
                "1",
                "-o",
                str(tmp_path / "new"),
            ]
        )
        == 0
    )
    out, err = capsys.readouterr()
    written = [tmp_path / "new" / name for name in ("camera_info_0.2m.yaml", "camera_info_1m.yaml")]
    assert out.split() == [str(path) for path in written]
    misfits = [line for line in err.splitlines() if "it is off by" in line]
    printed = [re.findall(r"([\d.]+) px RMS \(", line) for line in misfits]
    for path, numbers in zip(written, printed, strict=True):
        stated = re.findall(r"Misfit over the image: ([\d.]+) px RMS", path.read_text())
        # three decimals are printed of the four in the file
        assert [float(n) for n in stated] == pytest.approx([float(n) for n in numbers], abs=6e-4)
    assert "the camera model holds at 0.2 m. At" in err
    assert "for the distortion depends on the depth: export one for each depth" in err


def test_outputs_of_an_earlier_fit_are_named(
    small: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved, out = tmp_path / "saved", tmp_path / "out"
    small.save(saved)
    made = (saved / "calibration.yaml").stat().st_mtime
    out.mkdir()
    for name, age_s in (
        ("map_0.3m.npz", 60),
        ("map_0.4m.npz", -60),
        ("notes.npz", 60),
    ):
        (out / name).write_bytes(b"")
        os.utime(out / name, (made - age_s, made - age_s))
    assert main(["export", str(saved), "--format", "npz", "--depth", "0.5", "-o", str(out)]) == 0
    assert "map_0.3m.npz in the same folder comes from an earlier fit" in capsys.readouterr().err
    assert (out / "map_0.5m.npz").stat().st_size


def test_a_central_camera_is_not_warned_about(
    bare: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare.save(tmp_path / "bare")
    assert (
        main(
            [
                "export",
                str(tmp_path / "bare"),
                "--format",
                "mrcal",
                "--depth",
                "1",
                "-o",
                str(tmp_path),
            ]
        )
        == 0
    )
    err = capsys.readouterr().err
    assert re.findall(r"([\d.]+) px RMS \(", err) == ["0.000"] * 3
    assert "Take care" not in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ["--format", "ros"],
            (
                "--format ros holds for one depth: write the distance of the scene in metres, such"
                " as --depth 1.0."
            ),
        ),
        (["--format", "stmap"], "such as --depth 1.0"),
        (
            ["--format", "kalibr", "--lens", "plumb_bob", "--depth", "1"],
            "the format kalibr has no lens model plumb_bob: write one of radtan, equidistant.",
        ),
        (["--format", "npz", "--lens", "equidistant"], "drop --lens"),
        (["--format", "npz", "--axes", "opengl"], "drop --axes, or write --format ray-image."),
        (
            ["--format", "calibmar"],
            "this cover is a cone: write --format generic, which holds every shape.",
        ),
        (["--format", "colmap", "--depth", "0.01"], "depth 0.01 m is too near"),
        (["--format", "npz", "--depth", "1", "0.01"], "m or more, beyond the cover, such as 0.5."),
    ],
)
def test_wrong_input_gets_its_sentence(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    assert main(["export", str(saved), *arguments, "-o", str(tmp_path / "out")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err
    assert "Traceback" not in err
