"""The rule of calib.io.output_folder, over every command: a file that calib did not make keeps its
bytes, unless --overwrite names it.
"""

import shutil
from collections.abc import Iterable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import COMMANDS as COMMAND_MODULES
from calib.cli import main
from calib.corners.detect_all import DETECTIONS_FILE
from calib.errors import InputError
from calib.fleet.result import JobState, Result
from calib.io.output_folder import LEDGER
from calib.progress import Silent
from capture.cli import main as capture_main
from capture.tui.fitting import fit_session
from fixtures.known import known
from fixtures.synthetic import scene
from tests.test_calibration import write_session

BYSTANDERS = (
    *("notes.txt", "map_of_room.npz", "map_backup_2024m.npz", "map_m.npz", "ros/drive.bag"),
    *("diagnosed/calibration.yaml", "export/map_1m.npz", "cameras/notes.txt", ".hidden", "a b.tmp"),
)
"""Files that no command of these tests writes, with names near to those that some do."""
CALIBRATED = ("calibration.yaml", "calibration.npz", "report.html")
CAMERA = tuple(
    f"cameras/a/{name}"
    for name in (*CALIBRATED, "rays.npz", "map_1m.npz", ".fitted.json", "ros/camera_info_1m.yaml")
)
Contents = dict[str, bytes]


@dataclass(frozen=True)
class Command:
    """A command line, with OUT for its output folder, and what it does there."""

    words: tuple[str, ...]
    writes: tuple[str, ...] = ()
    """Names in OUT; none where the command writes no file."""
    repeatable: bool = True
    """A second run may replace what the first one wrote."""
    slow: bool = False
    """The command's own work takes seconds; a refusal never does."""


def words(line: str) -> tuple[str, ...]:
    return tuple(line.split())


COMMANDS = {
    "fit": Command(
        ("fit", "session", "--grid", "2x2", "--depth", "1", "-o", "OUT"),
        (*CALIBRATED, "rays.npz", "map_1m.npz"),
        slow=True,
    ),
    "demo": Command(
        ("demo", "-o", "OUT", "--no-open"),
        (
            "session.yaml",
            "wall.jpg",
            *(f"frames/{number:04d}.jpg" for number in range(12)),
            *(f"calibration/{name}" for name in (*CALIBRATED, "rays.npz", "map_0.8m.npz")),
            "straight/wall.jpg",
        ),
        slow=True,
    ),
    "evaluate": Command(("evaluate", "fitted", "session")),
    "check": Command(
        ("check", "fitted", "other", "--update", "-o", "OUT"), CALIBRATED[:2], slow=True
    ),
    "diagnose": Command(("diagnose", "fitted", "-o", "OUT"), CALIBRATED, slow=True),
    "batch": Command(
        words("batch fleet.csv -o OUT --grid 2x2 --folds 2 --depth 1 --format ros --workers 1"),
        ("fleet.html", "fleet.csv", "cameras/a.json", *CAMERA),
        slow=True,
    ),
    "rig": Command(
        words("rig fit rig.yaml --grid 2x2 -o OUT"),
        (
            *("rig_calibration.yaml", "rig_calibration.npz", "report.html"),
            *("a/calibration.yaml", "a/calibration.npz"),
        ),
        slow=True,
    ),
    "fleet-prior": Command(("fleet-prior", "fleet", "-o", "OUT/prior.yaml"), ("prior.yaml",)),
    "report": Command(("report", "OUT", "--no-open"), ("report.html",), slow=True),
    "undistort": Command(
        ("undistort", "small", "pictures", "--depth", "1", "-o", "OUT"), ("0.png", "1.png")
    ),
    "stream": Command(words("stream small --source pictures --depth 1 --to http:0")),
    "measure": Command(("measure", "fitted", "points.csv", "--depth", "0.5")),
    "pose": Command(
        words("pose tagged tag.png --tags DICT_4X4_50 --size-mm 50 -o OUT/poses.csv"),
        ("poses.csv",),
    ),
    "immerse": Command(
        ("immerse", "fitted", "--outside-index", "1.34", "--depth", "1", "-o", "OUT"),
        (*CALIBRATED[:2], "rays.npz", "map_1m.npz"),
        slow=True,
    ),
    "export": Command(
        ("export", "small", "--format", "opencv", "--depth", "1", "-o", "OUT"),
        ("camera_1m.yaml", "map_x_1m.tiff", "map_y_1m.tiff"),
    ),
    "import": Command(
        ("import", "images", "pictures", "--board", "9x6", "--square-mm", "20", "-o", "OUT"),
        ("session.yaml", "frames/0.png", "frames/1.png"),
        repeatable=False,
    ),
    "init": Command(("init", "OUT"), ("session.yaml",), repeatable=False),
    "board": Command(
        ("board", "-o", "OUT"), ("session.yaml", "board.pdf", "board.svg"), repeatable=False
    ),
}
WRITERS = [name for name, command in COMMANDS.items() if command.writes]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the inputs of the commands, under the names in their lines."""
    folder = tmp_path_factory.mktemp("inputs")
    for name, seed in (("session", 7), ("other", 8)):
        made = scene(seed, views=6, amplitude=1e-5, noise=0.05)
        write_session(folder / name, made)
    assert (
        main(["fit", str(folder / "session"), "--grid", "2x2", "-o", str(folder / "fitted")]) == 0
    )
    true = scene(1, views=1, grid=(4, 4), amplitude=3e-5)
    known(true, 64, 48).save(folder / "small")
    known(true, 3280, 2464).save(folder / "tagged")
    (folder / "pictures").mkdir()
    for number in range(2):
        picture = np.full((48, 64), 50 * number, np.uint8)
        cv2.imwrite(str(folder / "pictures" / f"{number}.png"), picture)
    (folder / "points.csv").write_text("x,y\n1600,1200\n1700,1300\n")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    marker = cv2.aruco.generateImageMarker(dictionary, 3, 600)
    sheet = np.full((2464, 3280), 225, np.uint8)
    sheet[1000:1600, 1400:2000] = np.where(marker, 225, 30)
    cv2.imwrite(str(folder / "tag.png"), sheet)
    (folder / "fleet.csv").write_text("id,session\na,session\n")
    rig = "format: 1\ncameras: {a: session}\nreference: a\ntogether: by_name\n"
    (folder / "rig.yaml").write_text(rig)
    calibration = Calibration.load(folder / "fitted")
    for number in range(4):
        name = f"c{number}"
        calibration.save(folder / "fleet" / "cameras" / name)
        written = (f"cameras/{name}/calibration.yaml",)
        verdict = {"word": "care"}
        Result(name, JobState.CALIBRATED, verdict=verdict, written=written).write(folder / "fleet")
    return folder


@pytest.fixture
def out(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The output folder of a command, whose other words are names in the folder of the inputs."""
    monkeypatch.chdir(inputs)
    return tmp_path / "out"


def run(command: Command, out: Path, *extra: str) -> tuple[int, str]:
    """Return the exit code, and what stderr says."""
    words = [word.replace("OUT", str(out)) for word in (*command.words, *extra)]
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as errors:
        code = main(words)
    return code, errors.getvalue()


def contents(folder: Path) -> Contents:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def visible(folder: Path) -> set[str]:
    return {name for name in contents(folder) if Path(name).name not in (LEDGER, DETECTIONS_FILE)}


def fill(folder: Path, names: Iterable[str]) -> Contents:
    for name in names:
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(f"somebody's {name}\n")
    return contents(folder)


def with_calibration(command: Command, inputs: Path, out: Path) -> Command:
    """The report goes beside a calibration: that lies in the output folder then."""
    if command.words[0] == "report":
        Calibration.load(inputs / "fitted").save(out)
    return command


def test_every_command_of_the_help_is_tested() -> None:
    modules = [module.__name__.rpartition(".")[2] for module in COMMAND_MODULES]
    assert {name.removesuffix("_command").replace("_", "-") for name in modules} == {*COMMANDS}


@pytest.mark.parametrize("name", WRITERS)
def test_a_writing_command_has_the_flag(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([name, *(["fit"] if name == "rig" else []), "--help"])
    assert ("--overwrite" in capsys.readouterr().out) is (name != "import"), (
        "a new session is a new folder"
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_a_folder_full_of_foreign_files_has_the_same_bytes_after(
    name: str, inputs: Path, out: Path
) -> None:
    command = with_calibration(COMMANDS[name], inputs, out)
    input_files = contents(inputs)
    initial = fill(out, [*command.writes, *BYSTANDERS])
    code, message = run(command, out)
    assert contents(out) == initial
    assert contents(inputs) == input_files
    assert code == (2 if command.writes else 0), message
    if command.writes:
        names = {str(out), *(Path(name).name for name in command.writes)}
        assert any(word in message for word in names), message


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "import"])
def test_each_foreign_file_is_refused_by_its_name(name: str, inputs: Path, out: Path) -> None:
    for number, file in enumerate(COMMANDS[name].writes):
        place = out / str(number)
        command = with_calibration(COMMANDS[name], inputs, place)
        initial = fill(place, [file])
        code, message = run(command, place)
        assert code == 2
        assert Path(file).name in message
        assert contents(place) == initial


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "import"])
def test_a_symbolic_link_in_the_way_is_refused_even_with_the_flag(
    name: str, inputs: Path, out: Path, tmp_path: Path
) -> None:
    file = COMMANDS[name].writes[-1]
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("mine")
    command = with_calibration(COMMANDS[name], inputs, out)
    (out / file).parent.mkdir(parents=True, exist_ok=True)
    (out / file).symlink_to(elsewhere)
    code, message = run(command, out, "--overwrite")
    assert code == 2
    assert f"{Path(file).name} is a symbolic link" in message
    assert elsewhere.read_text() == "mine"
    assert (out / file).is_symlink()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if COMMANDS[name].slow else ())
        for name in WRITERS
        if name != "import"
    ],
)
def test_unchanged_outputs_may_be_replaced_and_changed_ones_may_not(
    name: str, inputs: Path, out: Path
) -> None:
    command = with_calibration(COMMANDS[name], inputs, out)
    saved = visible(out)
    bystanders = fill(out, BYSTANDERS)
    done = (0, 5)
    assert run(command, out)[0] in done
    assert visible(out) - saved - {*BYSTANDERS} == {*command.writes}
    assert run(command, out)[0] in (done if command.repeatable else (2,))
    edited = out / command.writes[0]
    edited.write_text("edited by hand")
    code, message = run(command, out)
    assert code == 2
    assert edited.name in message
    assert edited.read_text() == "edited by hand"
    assert run(command, out, "--overwrite")[0] in done
    assert edited.read_bytes() != b"edited by hand"
    final = contents(out)
    assert {name: final[name] for name in BYSTANDERS} == {
        name: bystanders[name] for name in BYSTANDERS
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("diagnose", "OUT", "-o", "OUT"), "calibration.yaml would be overwritten"),
        (("check", "OUT", "other", "--update", "-o", "OUT"), "calibration.yaml would be"),
        (("immerse", "OUT", "--outside-index", "1.34", "-o", "OUT"), "calibration.yaml would be"),
        (("undistort", "small", "OUT/0.png", "--depth", "1", "-o", "OUT"), "0.png would be"),
        (
            ("undistort", "small", "pictures", "--depth-image", "OUT/0.png", "-o", "OUT"),
            "has the depth images",
        ),
        (
            words("pose OUT OUT/0.png --tags DICT_4X4_50 --size-mm 50 -o OUT/0.png"),
            "0.png would be overwritten",
        ),
        (("batch", "OUT/fleet.csv", "-o", "OUT"), "fleet.csv would be overwritten"),
        (("batch", "OUT/cameras/a", "-o", "OUT"), "cameras/a is where the results of a go"),
        (("batch", "OUT/cameras/a/session", "-o", "OUT"), ""),
    ],
)
def test_no_output_lies_on_or_above_an_input(
    words: tuple[str, ...], message: str, inputs: Path, out: Path
) -> None:
    Calibration.load(inputs / "fitted").save(out)
    shutil.copytree(inputs / "session", out / "cameras" / "a")
    shutil.copy(inputs / "fleet.csv", out)
    shutil.copy(inputs / "pictures" / "0.png", out)
    initial = contents(out)
    code, sentence = run(Command(words), out, "--overwrite")
    assert code == 2
    assert message in sentence
    assert contents(out) == initial


def test_a_default_folder_that_is_a_symbolic_link_is_refused(inputs: Path, out: Path) -> None:
    elsewhere = out / "elsewhere"
    elsewhere.mkdir(parents=True)
    shutil.copytree(inputs / "session", out / "session")
    (out / "session" / "calibration").symlink_to(elsewhere)
    code, message = run(Command(("fit", "OUT/session", "--grid", "2x2")), out)
    assert code == 2
    assert "calibration is a symbolic link" in message
    assert not list(elsewhere.iterdir())
    assert run(Command(("board", "-o", "OUT/session/calibration")), out)[0] == 0, "it was named"


def test_a_recording_keeps_every_file_that_it_did_not_make(inputs: Path, out: Path) -> None:
    pictures = [f"frames/{number:04d}.png" for number in (0, 7)]
    taken = ("frames/0001.txt", "frames-by-hand.csv", "frames/dropped/0000.png", ".detections.json")
    initial = fill(out, [*BYSTANDERS, *CALIBRATED, *taken])
    (out / "frames.csv").write_text("file,time_s\n0000.png,1.5\n0007.png,2.5")
    initial["frames-by-hand-1.csv"] = (out / "frames.csv").read_bytes()
    for picture in pictures:
        shutil.copy(inputs / "pictures" / "0.png", out / picture)
        initial[picture] = (out / picture).read_bytes()
    options = ["--board", "9x6", "--square-mm", "20", "--all"]
    source = f"folder:{inputs / 'pictures'}"
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as errors:
        code = capture_main(["record", str(out), "--source", source, *options])
    assert code == 0, errors.getvalue()
    final = contents(out)
    assert {name: final[name] for name in initial} == initial
    assert final.keys() - initial.keys() == {
        *("frames.csv", "session.yaml", LEDGER, ".recording", "frames/0.png", "frames/1.png")
    }


@pytest.mark.slow
def test_the_screen_s_fit_names_the_file_in_its_way(inputs: Path, out: Path) -> None:
    shutil.copytree(inputs / "session", out)
    initial = fill(out / "calibration", ["calibration.yaml", "map_1m.npz"])
    with pytest.raises(InputError, match="not calib's own: move it to another folder, and try"):
        fit_session(Silent(), out, out / "calibration")
    assert contents(out / "calibration") == initial
    (out / "calibration" / "calibration.yaml").unlink()
    for _ in range(2):
        fit_session(Silent(), out, out / "calibration")
    assert visible(out / "calibration") == {*CALIBRATED[:2], "map_1m.npz"}
