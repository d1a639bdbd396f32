"""A recording that cannot be imported gets one sentence and exit code 2, and leaves no file."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cli import main
from tests.importing import recordings
from tests.importing.recordings import CAMCHAIN, OST, SECOND, TARGET

BOARD = ("--board", "7x6", "--square-mm", "25")


@dataclass(frozen=True)
class Refused:
    name: str
    source: str
    make: Callable[[Path], Path]
    """Writes the bad input into a folder and returns what to name on the command line."""
    says: str
    arguments: tuple[str, ...] = BOARD


def text(name: str, content: str | bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def mrcal(**changed: object) -> Callable[[Path], Path]:
    return lambda folder: recordings.cameramodel(folder / "c.cameramodel", **changed)


def edited(old: str, new: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = recordings.cameramodel(folder / "c.cameramodel")
        content = path.read_text()
        assert old in content
        path.write_text(content.replace(old, new))
        return path

    return write


def cut_tar(folder: Path) -> Path:
    path = recordings.tar(folder / "c.tar.gz")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def tar(settings: str = OST) -> Callable[[Path], Path]:
    return lambda folder: recordings.tar(folder / "c.tar.gz", settings)


def stereo(without: str = "") -> Callable[[Path], Path]:
    return lambda folder: recordings.stereo_tar(folder / "c.tar.gz", without)


def kalibr(chain: str = CAMCHAIN, target: str = TARGET) -> Callable[[Path], Path]:
    return lambda folder: recordings.kalibr(folder / "k", chain, target)


def no_pictures(folder: Path) -> Path:
    made = recordings.kalibr(folder / "k")
    for path in (made / "cam0").iterdir():
        path.unlink()
    return made


def spoiled(spoil: Callable[[Path], object]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        made = recordings.write_pictures(folder / "p")
        spoil(made)
        return made

    return write


def cut_half(folder: Path) -> None:
    for number in range(3, 7):
        path = folder / f"shot {number}.png"
        path.write_bytes(path.read_bytes()[:3000])


REFUSED = (
    Refused(
        "mrcal missing",
        "mrcal",
        lambda folder: folder / "none.cameramodel",
        "none.cameramodel cannot be read",
        (),
    ),
    Refused("mrcal folder", "mrcal", lambda folder: folder, "give a .cameramodel file, not", ()),
    Refused(
        "mrcal not a literal",
        "mrcal",
        text("c.cameramodel", "import os"),
        "is not a .cameramodel: give a file that mrcal wrote",
        (),
    ),
    Refused(
        "mrcal binary", "mrcal", text("c.cameramodel", b"\xff\xfe\x00"), "is not a .cameramodel", ()
    ),
    Refused(
        "mrcal another literal",
        "mrcal",
        text("c.cameramodel", "[1, 2]"),
        "is not a .cameramodel",
        (),
    ),
    Refused(
        "mrcal without inputs",
        "mrcal",
        edited("'optimization_inputs'", "'other'"),
        "with `calib import mrcal-corners`",
        (),
    ),
    Refused(
        "mrcal damaged inputs",
        "mrcal",
        edited("'optimization_inputs': b'P", "'optimization_inputs': b'Q"),
        "inputs are damaged",
        (),
    ),
    Refused(
        "mrcal without camera",
        "mrcal",
        edited("'icam_intrinsics': 1,", ""),
        "damaged ('icam_intrinsics')",
        (),
    ),
    Refused(
        "mrcal without observations",
        "mrcal",
        mrcal(observations_board=None),
        "observations_board",
        (),
    ),
    Refused(
        "mrcal flat observations",
        "mrcal",
        mrcal(observations_board=np.zeros((3, 3))),
        "observations of shape (3, 3)",
        (),
    ),
    Refused(
        "mrcal not finite",
        "mrcal",
        mrcal(observations_board=np.full((16, 6, 7, 3), np.inf)),
        "no finite position",
        (),
    ),
    Refused(
        "mrcal spacing",
        "mrcal",
        mrcal(calibration_object_spacing=float("nan")),
        "board.square_mm is nan",
        (),
    ),
    Refused(
        "mrcal size",
        "mrcal",
        edited("'imagersize': [ 640,", "'imagersize': [ 0,"),
        "camera.width is 0",
        (),
    ),
    Refused(
        "corners missing",
        "mrcal-corners",
        lambda folder: folder / "no.vnl",
        "no.vnl cannot be read",
        (*BOARD, "--size", "640x480"),
    ),
    Refused(
        "corners of another board",
        "mrcal-corners",
        text("c.vnl", "# filename x y level\n" + "a.png 1 2 0\n" * 30),
        'a.png has 30 of the 42 lines that a 7x6 board needs: write one for each inner corner ("-"'
        " if not seen), or correct --board.",
        (*BOARD, "--size", "640x480"),
    ),
    Refused(
        "tar missing", "ros", lambda folder: folder / "none.tar.gz", "none.tar.gz cannot be read"
    ),
    Refused(
        "tar is text",
        "ros",
        text("c.tar.gz", "not an archive"),
        "is not a tar archive, or a damaged one",
    ),
    Refused("tar is empty", "ros", text("c.tar.gz", ""), "is not a tar archive, or a damaged one"),
    Refused("tar cut", "ros", cut_tar, "is not a tar archive, or a damaged one"),
    Refused(
        "tar with other settings",
        "ros",
        tar("image_width: wide\n"),
        'c.tar.gz, ost.yaml: image_width is the text "wide"',
    ),
    Refused("tar with bad yaml", "ros", tar("image_width: [\n"), "c.tar.gz, ost.yaml, line"),
    Refused(
        "tar of another size", "ros", tar(OST.replace("640", "320")), "left-0000.png is 640x480 px"
    ),
    Refused(
        "tar of a pair",
        "ros",
        stereo(),
        "c.tar.gz holds the pictures of two cameras: choose one with --camera left or --camera"
        " right.",
    ),
    Refused(
        "tar of a pair without yaml",
        "ros",
        stereo("right.yaml"),
        "c.tar.gz lacks right.yaml: give",
        (*BOARD, "--camera", "right"),
    ),
    Refused(
        "tar of one camera",
        "ros",
        tar(),
        "c.tar.gz lacks right-*.png: give",
        (*BOARD, "--camera", "right"),
    ),
    Refused("kalibr missing", "kalibr", lambda folder: folder / "none", "none is not a folder", ()),
    Refused(
        "kalibr without chain",
        "kalibr",
        kalibr(chain="cam1: {}\n"),
        "has no camchain.yaml with a cam0",
        (),
    ),
    Refused(
        "kalibr without target", "kalibr", kalibr(target=""), "add --board and --square-mm", ()
    ),
    Refused(
        "kalibr half a board",
        "kalibr",
        kalibr(target=""),
        "belong together: add --square-mm MM",
        ("--board", "7x6"),
    ),
    Refused(
        "kalibr circlegrid",
        "kalibr",
        kalibr(
            target="target_type: 'circlegrid'\ntargetCols: 6\ntargetRows: 6\nspacingMeters: 0.02\n"
        ),
        "target_type is circlegrid, which calib cannot detect: take pictures of a checkerboard or"
        " an aprilgrid",
        (),
    ),
    Refused(
        "kalibr oblong",
        "kalibr",
        kalibr(target=TARGET.replace("colSpacingMeters: 0.025", "colSpacingMeters: 1")),
        "only square",
        (),
    ),
    Refused(
        "kalibr resolution",
        "kalibr",
        kalibr(chain=CAMCHAIN.replace("[640, 480]", "640")),
        "cam0.resolution is 640: write [width",
        (),
    ),
    Refused(
        "kalibr with two cameras",
        "kalibr",
        kalibr(chain=CAMCHAIN + SECOND),
        "camchain-bag.yaml describes cam0, cam1: choose one of them, such as --camera cam0.",
        (),
    ),
    Refused(
        "kalibr another camera",
        "kalibr",
        kalibr(),
        "describes cam0: choose one of them",
        ("--camera", "cam1"),
    ),
    Refused(
        "kalibr without the second's pictures",
        "kalibr",
        kalibr(chain=CAMCHAIN + SECOND),
        "has no pictures in cam1/: unpack Kalibr's bag there",
        ("--camera", "cam1"),
    ),
    Refused("kalibr without pictures", "kalibr", no_pictures, "has no pictures in cam0/", ()),
    Refused("images missing", "images", lambda folder: folder / "none", "none is not a folder"),
    Refused("images a file", "images", text("a.png", "x"), "a.png is not a folder"),
    Refused("images none", "images", lambda folder: folder, "has no pictures"),
    Refused("images damaged", "images", spoiled(cut_half), "/p/shot 3.png is truncated or damaged"),
    Refused(
        "images half of another size",
        "images",
        spoiled(
            lambda folder: [
                cv2.imwrite(str(folder / f"small {i}.png"), np.zeros((48, 64), np.uint8))
                for i in range(8)
            ]
        ),
        "pictures of 2 sizes, 640x480, 64x48 px",
    ),
    Refused(
        "images of two cameras",
        "images",
        lambda folder: recordings.write_pair(folder / "p"),
        "fall into left* and right*, as those of 2 cameras do: choose one with --camera left",
    ),
    Refused(
        "images of a camera that is not there",
        "images",
        lambda folder: recordings.write_pair(folder / "p"),
        "no picture is called as of a camera cam2: name one of left, right",
        (*BOARD, "--camera", "cam2"),
    ),
    Refused(
        "kalibr in millimetres",
        "kalibr",
        lambda folder: recordings.kalibr(
            folder / "k", target=TARGET.replace("0.025", "25").replace("0.025", "25")
        ),
        "colSpacingMeters is 25, and Kalibr's unit is the metre: write 0.025 if 25 mm is meant",
        (),
    ),
)


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case.name)
def test_a_refused_import_gets_one_sentence_and_leaves_no_file(
    case: Refused, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    source = case.make(tmp_path / "in")
    code = main(
        [
            "import",
            case.source,
            str(source),
            *case.arguments,
            "-o",
            str(tmp_path / "out" / "session"),
        ]
    )
    out, err = capsys.readouterr()
    assert code == 2, err
    assert case.says in err
    assert err.count("\n") == 1, "one sentence"
    assert out == ""
    assert list((tmp_path / "out").iterdir()) == []


def test_a_camera_without_corners_is_not_enough_data(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = recordings.cameramodel(
        tmp_path / "c.cameramodel", observations_board=-np.ones((16, 6, 7, 3))
    )
    assert main(["import", "mrcal", str(model), "-o", str(tmp_path / "s")]) == 3
    assert "has no corner of its camera 1 that counts" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["import"], "SOURCE"),
        (["import", "matlab", "x", "-o", "y"], "invalid choice"),
        (["import", "images", "x", "-o", "y"], "--board"),
        (
            ["import", "images", "x", "--board", "9", "--square-mm", "25", "-o", "y"],
            "write two whole numbers of 3 or more, such as 9x6",
        ),
        (
            ["import", "images", "x", "--board", "9x6", "--square-mm", "0", "-o", "y"],
            "write millimetres from 0.05 to 100000",
        ),
        (["import", "mrcal", "x"], "-o"),
    ],
)
def test_wrong_usage(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert says in capsys.readouterr().err
