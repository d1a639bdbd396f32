"""Pictures and videos without a session.yaml go into a calibration by one command."""

import argparse
import os
import re
import shlex
import shutil
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from calib import cli
from calib.cli import main
from calib.commands.command_line import _parser
from calib.commands.described_board import describe_search
from calib.commands.described_session import session_of
from calib.corners.board_search import FoundBoard
from calib.errors import InputError
from calib.importing.from_video import MAX_FRAMES
from calib.importing.named_pictures import find_pictures
from calib.io.images import list_images
from calib.progress import Silent
from calib.session.board import Board
from calib.session.schema import Number
from calib.session.session import Session, read_session
from tests.corners import test_other_makers
from tests.importing import recordings

BOARD = ["--board", "7x6", "--square-mm", "25"]


def parsed(*words: str) -> argparse.Namespace:
    args = _parser("calib", "", cli.COMMANDS, cli.GROUPS).parse_args(["fit", *words])
    args.words = ["fit", *words]
    return args


def described(*words: str) -> Session:
    return session_of(parsed(*words), Silent()).session


@pytest.fixture(scope="module")
def recorded_film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video in which each of eight pictures is sharp once, between blurred ones."""
    path = tmp_path_factory.mktemp("film") / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, recordings.SIZE)
    for picture in recordings.pictures():
        for step in range(-7, 8):
            blurred = cv2.GaussianBlur(picture, (0, 0), 1 + abs(step)) if step else picture
            writer.write(cv2.cvtColor(blurred, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


@pytest.fixture
def film(recorded_film: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the video, seen from the folder around it."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copy(recorded_film, "film.avi"))


@pytest.mark.usefixtures("without_figures")
def test_a_folder_is_calibrated_and_is_a_session_afterwards(
    photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(photos), *BOARD]) == 0
    output = capsys.readouterr()
    assert "Error (root mean square)" in output.out
    assert f"Wrote {photos / 'session.yaml'}\n" in output.out
    assert "Behind glass or plastic add --cover" in output.err
    assert "--index" not in output.err
    session = read_session(photos)
    assert session.board == Board(7, 6, 0.025)
    assert session.frames == list_images(photos)
    assert main(["fit", "--depth", "0.5", "1", str(photos), "--quiet"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert "Error (root" not in output.out
    assert "session.yaml" not in output.out
    assert {path.name for path in (photos / "calibration").glob("map_*.npz")} == {
        "map_0.5m.npz",
        "map_1m.npz",
    }
    last_line = output.out.splitlines()[-2]  # the last one says what HOLDOUT is
    undistort = shlex.split(last_line.rpartition("; ")[2])
    assert main(undistort[1:]) == 0
    assert len(list_images(photos / "calibration" / "undistorted")) == 8


def test_a_calibration_is_no_folder_of_pictures(photos: Path) -> None:
    """But a session that holds its own calibration, its pictures in frames/, is."""
    made = photos / "made"
    made.mkdir()
    (made / "calibration.yaml").touch()
    (made / "undistorted").mkdir()
    for picture in list_images(photos):
        shutil.copy(picture, made / "undistorted")
    for paths in ([made], [made, photos]):
        with pytest.raises(InputError, match="is a calibration: give the folder of pictures"):
            find_pictures(paths)
    (made / "undistorted").rename(made / "frames")
    assert len(find_pictures([made]).pictures) == len(list_images(photos))


def test_pictures_without_a_session_are_evaluated(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(photos), *BOARD, "--quiet"]) == 0
    held_out = tmp_path / "held out"
    held_out.mkdir()
    pictures = list_images(photos)[:5]
    shutil.copy(pictures[0], held_out)
    assert main(["evaluate", str(photos / "calibration"), str(held_out)]) == 0
    assert "1 view: only the pose was fitted to it." in capsys.readouterr().out
    for path in pictures[1:]:
        shutil.copy(path, held_out)
    assert main(["evaluate", str(photos / "calibration"), str(held_out)]) == 0
    assert "5 views: only the poses of the board were fitted to them." in capsys.readouterr().out
    assert not (held_out / "session.yaml").exists()
    swapped = [str(held_out), str(photos / "calibration")]
    for command in ("evaluate", "check", "undistort"):
        options = ["--depth", "1", "-o", str(tmp_path / "no")] if command == "undistort" else []
        assert main([command, *swapped, *options]) == 2
        assert "calibration is the calibration, not" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["undistort", str(held_out)])
    assert "A whole command is: calib undistort cam0" in capsys.readouterr().err
    for path in list_images(held_out):
        path.unlink()
    cv2.imwrite(str(held_out / "small.png"), np.zeros((10, 20, 3), np.uint8))
    assert main(["evaluate", str(photos / "calibration"), str(held_out)]) == 2
    assert "held out is of 20x10 px and the calibration for" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["new\nline", "\u2028", "a\x85b", "tab\tand \x1b[1m"])
def test_a_folder_may_have_any_name(name: str, photos: Path) -> None:
    """It stands in a comment of session.yaml, which ends at the end of the line."""
    folder = photos.rename(name)
    session = described(str(folder), *BOARD)
    assert len(session.frames) == 8
    imported = Path("imported")
    assert main(["import", "images", str(folder), *BOARD, "-o", str(imported)]) == 0
    for file in (folder / "session.yaml", imported / "session.yaml"):
        line, *_ = file.read_text().splitlines()
        assert line.startswith("#")
        assert line.isprintable()


def test_a_pattern_stands_for_its_pictures(photos: Path) -> None:
    assert described(f"{photos}/*.png", *BOARD).path == photos
    several = described(f"{photos}/shot [1-5].png", *BOARD)
    assert several.path == photos / "session"
    assert [path.name for path in several.frames] == [
        f"shot {number}.png" for number in range(1, 6)
    ]
    pair = described(f"{photos}/shot 4.png", f"{photos}/shot 5.png", *BOARD)
    assert [path.name for path in pair.frames] == ["shot 4.png", "shot 5.png"]


def test_pictures_of_several_folders_keep_apart(photos: Path) -> None:
    shutil.copytree(photos, "others")
    session = described(str(photos), "others", *BOARD)
    assert len(session.frames) == 16
    assert session.path == Path("session")


def test_a_board_of_a_few_centimetres_is_questioned(
    photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = described(str(photos), "--board", "7x6", "--square-mm", "2.5")
    assert "7x6 board is 15 mm wide. If its sides are in centimetres" in capsys.readouterr().err
    assert session.board.square == 0.0025
    described(str(photos), *BOARD)
    assert "wide" not in capsys.readouterr().err


def write_stray(folder: Path, size: tuple[int, int] = (641, 480)) -> None:
    cv2.imwrite(str(folder / "a first.png"), np.zeros(size[::-1], np.uint8))


def test_the_size_of_most_pictures_is_taken_and_strays_are_left_out(
    photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stray(photos)
    folder = recordings.write_pictures(Path("others"))
    write_stray(folder, (480, 640))
    session = described(str(photos), str(folder), *BOARD)
    assert len(session.frames) == 16
    assert (session.camera.width, session.camera.height) == recordings.SIZE
    notice = (
        "left out, pictures of another size than 640x480 px: my photos/a first.png (641x480),"
        " others/a first.png (480x640)."
    )
    assert notice in capsys.readouterr().err


@pytest.mark.usefixtures("without_figures")
def test_strays_and_copies_of_a_folder_are_named_by_the_fit(
    photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stray(photos)
    shutil.copy(photos / "shot 3.png", photos / "shot 3 copy.png")
    (photos / "IMG_1.HEIC").write_bytes(b"\0")
    assert main(["fit", str(photos), *BOARD]) == 0
    assert read_session(photos).camera.width == 640
    printed = capsys.readouterr().out
    assert "8 views with" in printed
    copy = "shot 3 copy.png: a copy of shot 3.png"
    for words in ("a first.png: 641x480 px", copy, "IMG_1.HEIC: its type"):
        assert words in printed


def test_a_camera_of_a_pair_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = recordings.write_pair(Path("pair"))
    with pytest.raises(InputError, match="choose one with --camera left, or --camera all"):
        described("pair", *BOARD)
    right = described("pair", *BOARD, "--camera", "right")
    assert right.path == folder / "right"
    assert [path.name for path in right.frames] == [f"right-{k:02d}.png" for k in range(8)]
    with pytest.raises(InputError, match="calib fit pair --camera left --board 7x6 --square-mm MM"):
        described("pair", "--camera", "left")
    assert described("pair", *BOARD, "--camera", "left").path == folder / "left"
    assert described("pair", *BOARD, "--camera", "all").frames == list_images(folder)


def test_a_camera_is_chosen_by_its_exif(photos: Path) -> None:
    for number, path in enumerate(list_images(photos)):
        exif = Image.Exif()
        exif[271] = "Samsung" if number < 5 else "Sony"
        exif[272] = "SM-S911B" if number < 5 else "RX0/M2"
        Image.open(path).save(path, exif=exif)
    with pytest.raises(InputError, match=r"by their EXIF, Samsung SM-S911B \(5\)") as caught:
        described(str(photos), *BOARD)
    assert "--camera 'Samsung SM-S911B', or --camera all" in str(caught.value)
    assert len(described(str(photos), *BOARD, "--camera", "Samsung SM-S911B").frames) == 5
    session = described(str(photos), *BOARD, "--camera", "rx0/m2")
    assert session.path == photos / "rx0-m2"
    assert len(session.frames) == 3
    assert len(described(str(photos), *BOARD, "--camera", "all").frames) == 8


CODED = ["--board", "6x4", "--square-mm", "30", "--type", "charuco"]


def write_coded(name: str) -> Board:
    """Write pictures of a board of another maker into the folder `coded`."""
    Path("coded").mkdir(exist_ok=True)
    board = test_other_makers.BOARDS[name]
    for number, (picture, _) in enumerate(test_other_makers.views(board)):
        cv2.imwrite(f"coded/{number}.png", picture)
    return board


@pytest.mark.slow
def test_the_pictures_say_how_a_board_is_numbered_and_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    board = write_coded("charuco from 100, inverted")
    markers = ["--marker-mm", "22.5", "--dictionary", "DICT_4X4_250"]
    assert described("coded", *CODED, *markers).board == board
    notice = "session.yaml has board.first_marker: 100, board.inverted: true."
    assert notice in capsys.readouterr().err
    other_sheet = described("coded", *CODED, *markers, "--first-marker", "0").board
    assert other_sheet == test_other_makers.CHARUCO, "what a person states is not replaced"
    # what is left out is looked for
    with pytest.raises(
        InputError, match="--board says 7x5: type `calib fit coded --board 6x4 --type"
    ) as e:
        described("coded", *CODED, "--board", "7x5")
    layout = "--dictionary DICT_4X4_250 --first-marker 100 --inverted"
    assert str(e.value).endswith(f"--square-mm 30 --marker-mm 22.5 {layout}`.")


def test_an_aprilgrid_of_another_maker_is_described_by_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    board = write_coded("as OpenCV draws tags")
    grid = ["--board", "4x3", "--tag-mm", "40", "--type", "aprilgrid", "--spacing", "0.25"]
    assert described("coded", *grid).board == board
    layout = ["--border-cells", "1", "--numbered-from", "upper_left", "--tag-rotation-deg", "0"]
    assert described("coded", *grid, *layout).board == board


@pytest.mark.slow
def test_the_side_of_a_tag_is_not_that_of_a_square(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, photos: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    write_coded("as OpenCV draws tags")
    says = r"The side of a tag is --tag-mm: type `calib fit coded .* --tag-mm 33 --spacing 0\.25"
    with pytest.raises(InputError, match=says):
        described("coded", "--square-mm", "33")
    with pytest.raises(InputError, match="how large its tags are: measure one"):
        described("coded")
    with pytest.raises(InputError, match=r"The side of a square is --square-mm: .* --square-mm 33"):
        described(str(photos), "--tag-mm", "33")


def test_turned_pictures_of_one_mode_are_told(photos: Path) -> None:
    for path in list_images(photos)[:4]:
        picture = cv2.imread(str(path))
        assert picture is not None
        cv2.imwrite(str(path), np.rot90(picture))
    with pytest.raises(InputError, match=r"of 480x640 and of 640x480 px, .* turn all of them the"):
        described(str(photos), *BOARD)


def test_pictures_of_no_common_size_are_refused(photos: Path) -> None:
    for path in list_images(photos)[:4]:
        cv2.imwrite(str(path), np.zeros((100, 200), np.uint8))
    with pytest.raises(InputError, match="pictures of 2 sizes, 200x100, 640x480 px"):
        described(str(photos), *BOARD)
    assert not (photos / "session.yaml").exists()


def test_the_sharpest_frames_of_a_video_are_a_session(film: Path) -> None:
    session = described(str(film), *BOARD)
    assert session.path == film.with_suffix("")
    assert len(session.frames) == MAX_FRAMES
    numbers = {int(path.stem) for path in session.frames}
    assert {15 * number + 7 for number in range(8)} <= numbers


@pytest.mark.parametrize(("kept", "says"), [(1.0, ""), (0.6, "film.avi breaks off near frame ")])
def test_a_video_that_breaks_off_is_said_to(
    film: Path, capsys: pytest.CaptureFixture[str], kept: float, says: str
) -> None:
    data = film.read_bytes()
    film.write_bytes(data[: int(kept * len(data))])
    described(str(film), *BOARD)
    err = capsys.readouterr().err
    assert ("breaks off" in err) == bool(says)
    assert says in err
    imported = film.parent / "imported"
    assert main(["import", "video", str(film), *BOARD, "-o", str(imported)]) == 0
    err = capsys.readouterr().err
    assert ("breaks off" in err) == bool(says)
    assert says in err


@pytest.mark.parametrize("source", ["photos", pytest.param("film", marks=pytest.mark.slow)])
def test_a_board_that_is_not_described_is_looked_for(
    source: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    path = request.getfixturevalue(source)
    with pytest.raises(InputError, match="Found a checkerboard of 7x6 inner corners") as caught:
        described(str(path))
    assert not path.with_suffix("").joinpath("session.yaml").exists()
    command = re.search(r"`(calib fit .*--square-mm) MM`\.$", str(caught.value))
    assert command
    assert described(str(path), "--square-mm", "30").board == Board(7, 6, 0.03)
    assert "Found a checkerboard of 7x6 inner corners" in capsys.readouterr().err
    assert described(*shlex.split(command[1])[2:], "25").board == Board(7, 6, 0.025)


@pytest.mark.parametrize(
    ("pictures", "searched", "count", "words"),
    [
        (3, 3, 12, "all 3 pictures that were searched (there are 12)"),
        (2, 3, 12, "2 of the 3 pictures that were searched (there are 12)"),
        (3, 5, None, "3 of 5 frames"),
        (2, 3, 3, "2 of 3 pictures"),
    ],
)
def test_the_pictures_with_the_board_are_counted(
    pictures: int, searched: int, count: int | None, words: str
) -> None:
    finding = FoundBoard(Board(7, 6, 1.0), pictures, searched)
    assert describe_search(finding, count) == words


def test_a_number_of_the_cover_that_is_not_given_is_unknown(photos: Path) -> None:
    options = ["--cover", "flat", "--thickness", "unknown"]
    assert main(["init", "my photos", *BOARD, *options, "--intrinsics", "520,525,322,238"]) == 0
    written = yaml.safe_load((photos / "session.yaml").read_text())["cover"]
    assert written["distance_mm"] == written["thickness_mm"] == "unknown"
    numbers = read_session(photos).cover.parameters
    assert numbers["distance"].sigma > 0.02
    assert numbers["thickness"].sigma > 0.002


def test_a_cover_is_described_by_options(photos: Path) -> None:
    dome = ["--cover", "dome", "--radius", "40+-30", "--centre", "-1,0,3±2", "--thickness", "3"]
    session = described(str(photos), *BOARD, *dome)
    numbers = session.cover.parameters
    assert (numbers["inner_radius"].value, numbers["inner_radius"].sigma) == (0.04, 0.03)
    assert numbers["centre.x"].value == -0.001
    assert numbers["centre.z"].sigma == 0.002
    assert numbers["refractive_index"].value == 1.5
    lens = session.camera.intrinsics
    assert lens
    assert lens.fx.sigma > 0.3 * lens.fx.value, "nobody knows the lens"
    shutil.copytree(photos, photos / "bare", ignore=shutil.ignore_patterns("session.yaml", "bare"))
    assert described(str(photos), *BOARD, *dome).camera.intrinsics is None, "bare/ tells the lens"
    known = described(str(photos), *BOARD, *dome, "--intrinsics", "520,525,322+-3,238")
    assert known.camera.intrinsics
    assert known.camera.intrinsics.cx.sigma == 3


def test_pictures_in_a_folder_that_cannot_be_written_become_a_session_of_the_output(
    photos: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def access(path: Path, mode: int) -> bool:
        return not (mode == os.W_OK and Path(path).resolve() == photos.resolve())

    monkeypatch.setattr(os, "access", access)
    with pytest.raises(InputError, match="cannot be written: name a folder for the session"):
        described(str(photos), *BOARD)
    session = described(str(photos), *BOARD, "-o", "out")
    assert session.path == Path("out")
    assert len(session.frames) == 8
    assert not (photos / "session.yaml").exists()
    assert described(str(photos), *BOARD, "-o", "out").path == Path("out")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere"], "nowhere is not a folder, a picture or a video that exists"),
        (["data"], "(cam0/data), such as `calib fit data/cam0/data --board 9x6"),
        (["/dev/video0"], "record some by `capture SESSION --source v4l2:/dev/video0`"),
        (["made/session.yaml"], "describes a session: `calib fit made` calibrates it"),
        (["empty"], "has no session.yaml and no pictures: record some by `capture empty`"),
        (["phone"], "IMG_1.HEIC: convert them, such as by `mogrify -format png phone/*.HEIC`"),
        (["phone/IMG_1.HEIC"], "not read: convert them, such as by `mogrify -format png phone/"),
        (["phone/*"], "No picture matches phone/*, only files that are not read as pictures, such"),
        (["my photos/*.PNG"], "but 8 files end in .png: give 'my photos/*.png'."),
        (["card"], "(100, 101), such as `calib fit card/100 --board 9x6 --square-mm 25"),
        (["card"], "If one camera took all of them, give 'card/**/*'."),
        (["several"], "(a/frames, b/0, c/0 and 1 more), such as `calib fit several/a"),
        (["none/*.jpg"], "No picture matches none/*.jpg"),
        (
            ["https://a.org/film.mp4"],
            "film.mp4 is an address: download the file",
        ),
        (["pair"], "it is a rig, which `calib rig fit pair` calibrates"),
        (["pair/rig.yaml"], "describes a rig: `calib rig fit pair/rig.yaml` calibrates"),
        (["other name", *BOARD], "other name/Session.yml is not read under that name"),
        (["my photos", "--board", "7x6", "--square-mm", "2.5cm"], "write 25, in millimetres"),
        (["my photos", "--square-mm", "unknown"], "show it: measure ten squares, and divide"),
        (
            ["my photos", "--square-mm", "25+-1"],
            "such as 25. An uncertainty stands in session.yaml",
        ),
        (["my photos", *BOARD, "--depth", "50cm"], "'50cm' is not a depth: write 0.5, in metres"),
        (["my photos", *BOARD, "--grid", "8x8", "9"], "9 is too much: the option in front"),
        (["text.txt", *BOARD], "text.txt is neither a picture nor a video"),
        (["dive.mcap", *BOARD], "dive.mcap is a recording of ROS: `calib import bag`"),
        (["text.avi", *BOARD], "text.avi is not a video that can be read"),
        (["text.avi", "my photos"], "calib fit text.avi --board 9x6 --square-mm 25"),
        (["films"], "`calib fit films/a.mp4 --board 9x6 --square-mm 25` makes a session of it"),
        (
            ["my photos", "--board", "7x6"],
            "belong together: add --square-mm MM, the side of a square",
        ),
        (["my photos", *BOARD, "--radius", "3"], "add --cover, one of none, cone"),
        (
            ["my photos", *BOARD, "--cover", "flat", "--radius", "3"],
            "--radius does not belong to --cover flat: leave it out, or write some of --distance",
        ),
        (
            ["my photos", *BOARD, "--cover", "dome", "--radius", "0.05+-0.01"],
            "0.05 m, if metres were meant, is 50",
        ),
        (["my photos", *BOARD, "--type", "charuco"], "--type says charuco: type `calib fit"),
        (["my photos", *BOARD, "--intrinsics", "1,2"], "such as 1200,1200,640,360"),
        (["taken.avi", *BOARD], "calib import video taken.avi --board 9x6 --square-mm 25 -o NEW"),
    ],
)
def test_a_refusal_names_what_would_do(
    words: list[str], says: str, photos: Path, film: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert photos.is_dir()
    Path("empty").mkdir()
    Path("made").mkdir()
    Path("made/session.yaml").touch()
    Path("dive.mcap").touch()
    Path("phone").mkdir()
    Path("phone/IMG_1.HEIC").touch()
    for folder in ("card/100", "card/101", "data/cam0/data", "data/.trash/data"):
        shutil.copytree(photos, folder)
    for folder in ("several/a/frames", *(f"several/{name}/0" for name in "bcd")):
        shutil.copytree(photos, folder)
    Path("several/a/session.yaml").touch()
    Path("films").mkdir()
    Path("films/a.mp4").touch()
    for name in ("text.txt", "text.avi"):
        Path(name).write_text("text")
    shutil.copytree(photos, "other name")
    Path("other name/Session.yml").touch()
    Path("pair").mkdir()
    Path("pair/rig.yaml").touch()
    shutil.copy(film, "taken.avi")
    Path("taken").mkdir()
    Path("taken/thesis.tex").write_text("mine")
    with suppress(SystemExit):  # argparse has printed the sentence
        assert main(["fit", *words]) == 2
    assert says in " ".join(capsys.readouterr().err.split())
    assert Path("taken/thesis.tex").read_text() == "mine"


def test_the_frames_of_a_session_are_known_from_within(
    photos: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(photos, "s/frames")
    Path("s/session.yaml").touch()
    monkeypatch.chdir("s/frames")
    with pytest.raises(
        InputError, match=r"^\. belongs to the session \.\.: type `calib fit \.\.`,"
    ):
        described(".", *BOARD)


def test_other_commands_name_the_one_that_makes_a_session(photos: Path, film: Path) -> None:
    for path in (photos, film):
        with pytest.raises(InputError) as caught:
            read_session(path)
        assert f"calib fit {shlex.quote(str(path))} --board 9x6 --square-mm 25" in str(caught.value)


def test_pictures_without_a_board_are_said_to_have_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((240, 320), 90 + number, np.uint8))
    assert main(["fit", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert "no board was found in 3 pictures of it: describe it by `calib fit" in message


def test_a_number_that_is_none_is_refused_as_it_is_read(capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("wide", "40+-", "40+-3+-2", "1,,2"):
        with pytest.raises(SystemExit):
            parsed("x", "--cover", "dome", f"--centre={text}")
        assert "is not a number: write one such as 40, or 40+-5" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        parsed("x", "--cover", "dome", "--radius", "4 cm")
    assert "'4 cm' is not a number: write 40, in millimetres" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [("init", "x", "--cover", "dome"), ("immerse", "x")], ids=lambda words: words[0]
)
def test_a_material_in_place_of_its_index_is_said_to_have_a_number(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*words, "--outside-index", "water"])
    assert "'water' is not a number: write 1.333, its refractive index" in capsys.readouterr().err


def test_the_suggested_command_keeps_what_was_typed(photos: Path) -> None:
    typed = ("--cover", "dome", "--radius", "50+-0.3", "--centre", "0,0,?", "--folds", "3")
    with pytest.raises(InputError) as refused:
        described(str(photos), *typed)
    _, _, command = str(refused.value).partition("and type ")
    words = [*shlex.split(command.strip("`.").removesuffix(" MM")), "25"]
    assert words[:3] == ["calib", "fit", str(photos)]
    assert words[3 : 3 + len(typed)] == list(typed)
    session = described(*words[2:])
    assert session.cover.parameters["centre.z"].unknown
    assert session.cover.parameters["inner_radius"].sigma == pytest.approx(0.0003)


def test_a_wrong_board_is_not_in_the_suggested_command(photos: Path) -> None:
    with pytest.raises(InputError, match="--board") as refused:
        described(str(photos), "--type", "charuco", "--board", "5x5", "--cover", "flat")
    assert "--type" not in str(refused.value).partition("calib fit")[2].partition("--board")[0]


def test_the_index_of_water_is_not_that_of_glass(photos: Path) -> None:
    with pytest.raises(InputError, match="--index is that of the glass"):
        described(str(photos), *BOARD, "--cover", "dome", "--index", "1.333")
    surface = ["--cover", "flat", "--index", "1.333", "--outside-index", "1.333"]
    assert described(str(photos), *BOARD, *surface).cover.medium == Number(1.333, 0.004)
