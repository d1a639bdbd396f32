"""The next commands can be typed as they are printed."""

import ast
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from calib.calibration import Calibration
from calib.commands.verdict_lines import print_verdict
from calib.corners.view import RejectedPicture
from calib.fit_record.history import DiagnosisRecord, History
from calib.fit_record.request import CommandOptions, Provenance, Settings
from calib.importing.session_draft import COVER
from calib.io.output_folder import OutputFolder
from calib.undistortion.crop import has_black_border
from calib.verdict import picture_source as module
from calib.verdict.case import Case
from calib.verdict.judge import judge
from calib.verdict.next_commands import NextCommands
from calib.verdict.picture_source import PictureSource, picture_source
from calib.verdict.verdict import Reason, Verdict


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


def test_a_session_below_the_current_folder_is_written_as_the_calibration_is(
    good: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A report may be read in another folder: its calibration's path is absolute."""
    session = tmp_path.resolve() / "cam0"
    session.mkdir()
    monkeypatch.chdir(tmp_path)
    recorded = replace(good, request=replace(good.request, provenance=Provenance(str(session))))
    typed = NextCommands.of(recorded, Path("cam0/calibration"), None, ())
    assert typed.capture() == "capture cam0"
    reported = NextCommands.of(recorded, session / "calibration", None, ())
    assert reported.capture() == f"capture {session}"


def test_no_path_is_taken_for_an_option() -> None:
    commands = NextCommands(Path("-s"), Path("-s/calibration"), Settings(), pictures=Path("-s"))
    session = NextCommands(Path("-s"), Path("-out"), Settings(), pictures=Path("-s"))
    for line in (
        commands.fit(),
        session.fit(),
        commands.capture(),
        commands.diagnose("--holdout", "h"),
        commands.check("PICTURES"),
        commands.evaluate(),
        session.undistort(0.5),
        session.report(),
        session.export(0.5),
    ):
        options = {"--depth", "--format", "--holdout", "-o"}
        words = shlex.split(line)
        assert {word for word in words if word.startswith("-")} <= options, line
        assert any(word.startswith("./-") for word in words)


def test_a_straight_picture_comes_first_and_a_written_map_is_not_exported_again(
    tmp_path: Path,
) -> None:
    out = tmp_path / "calibration"
    corners = NextCommands(tmp_path, out, Settings())
    assert corners.uses(0.5, mapped=True) == ()
    assert corners.uses(0.5, mapped=False) == (corners.export(0.5),)
    pictures = NextCommands(tmp_path, out, Settings(), pictures=tmp_path)
    (tmp_path / "a.png").touch()
    assert f"undistort {out} {tmp_path} --depth 0.5" in pictures.uses(0.5, mapped=True)[0]
    (tmp_path / "frames").mkdir()
    recorded = NextCommands(tmp_path, out, Settings(), pictures=tmp_path / "frames")
    straight, export = recorded.uses(0.5, mapped=False)
    assert str(tmp_path / "frames") in straight
    assert export == pictures.export(0.5)


def test_pictures_beside_a_result_are_not_those_of_a_session_that_is_gone(
    good: Calibration, tmp_path: Path
) -> None:
    (tmp_path / "another.png").touch()
    gone = replace(good.request, provenance=Provenance(session=str(tmp_path / "gone")))
    calibration = replace(good, request=gone)
    commands = NextCommands.of(calibration, tmp_path / "diagnosed", None, ())
    assert commands.pictures is None
    (tmp_path / "session.yaml").touch()
    assert NextCommands.of(calibration, tmp_path / "diagnosed", None, ()).pictures == tmp_path


def test_the_black_border_of_a_straight_picture_is_cropped(
    good: Calibration, tmp_path: Path
) -> None:
    session, out = tmp_path / "s", tmp_path / "s" / "calibration"
    (session / "frames").mkdir(parents=True)
    (session / "session.yaml").touch()
    straight = judge(good, folder=out, session=session).next
    depth = float(straight.partition("--depth ")[2].partition(" ")[0])
    assert has_black_border(good.ray_field(), depth)
    assert " --crop 0 -o " in straight
    assert " --crop " not in NextCommands.of(good, out, session, ()).undistort(depth)


def test_views_that_the_session_keeps_back_are_evaluated(good: Calibration, tmp_path: Path) -> None:
    session, held_out = tmp_path / "s", tmp_path / "s" / "holdout"
    held_out.mkdir(parents=True)
    (session / "session.yaml").touch()
    out = session / "calibration"
    commands = NextCommands.of(good, out, session, ())
    assert commands.evaluate() == f"calib evaluate {out} {held_out}"
    assert commands.evaluate() in judge(good, folder=out, session=session).further
    again = judge(good, folder=out, session=session, holdout=held_out)
    assert f"calib evaluate {out} HOLDOUT" in again.further, "these have been evaluated"
    diagnosis = f"calib diagnose {out} --holdout {held_out}"
    assert diagnosis in again.further
    assert diagnosis in judge(good, folder=out, session=session).further
    assert commands.diagnose("--holdout", "a") == f"calib diagnose {out} --holdout a"


def test_views_of_another_program_are_not_recorded() -> None:
    source = PictureSource.DEVICE
    commands = NextCommands(Path("photos"), Path("photos/calibration"), Settings(), source=source)
    assert commands.capture() == "calib fit photos"


def test_a_film_is_filmed_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A camera of this computer does not record what a phone filmed."""

    def refuse(folder: Path) -> None:
        raise PermissionError(folder)

    session = tmp_path / "film"
    (session / "frames").mkdir(parents=True)
    (session / "frames" / "0.png").touch()
    assert picture_source(session) is PictureSource.CAPTURE
    OutputFolder(session / "frames").write("1.png", "a copy")
    assert picture_source(session) is PictureSource.DEVICE
    (tmp_path / "film.MOV").touch()
    assert picture_source(session) is PictureSource.FILM
    with monkeypatch.context() as patch:
        patch.setattr(module, "list_videos", refuse)
        assert picture_source(session) is PictureSource.DEVICE, "the folder above is not listed"
    commands = NextCommands(session, session / "out", Settings(), source=PictureSource.FILM)
    assert commands.capture() == "calib fit FILM"
    print_verdict(Verdict((Reason("few.", commands.capture()),), ""), ())
    printed = capsys.readouterr().out
    assert "Next, once that is done: calib fit FILM" in printed
    assert "FILM is a new video: film the board again with this camera" in printed


def test_the_frames_of_a_film_are_a_note(good: Calibration, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    assert not any("video" in note for note in judge(good, session=tmp_path).notes)
    (tmp_path / "session.yaml").write_text(COVER.format(source="film.mp4"))
    names = [f"{10 * number:03d}.png" for number in range(len(good.views))]
    views = tuple(map(lambda view, name: replace(view, name=name), good.views, names))
    rejected = (RejectedPicture("999.png", "no board was found"),)
    filmed = replace(good, views=views, rejected=rejected)
    note = judge(filmed, session=tmp_path).notes[-1]
    assert note == (
        "the pictures are 25 frames of a video, each the sharpest of its part of it, and are named"
        " by their numbers in it, from 000.png to 999.png. The fit uses 24 of them."
    )


@pytest.mark.parametrize(
    ("name", "source"), [("film 1.mp4", PictureSource.FILM), ("photos", PictureSource.DEVICE)]
)
def test_imported_pictures_are_not_of_capture(
    name: str, source: PictureSource, tmp_path: Path
) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / "session.yaml").write_text(COVER.format(source=name))
    assert picture_source(tmp_path) is source


def test_no_second_diagnosis_is_proposed(good: Calibration) -> None:
    diagnosed = replace(good, history=History(diagnosis=DiagnosisRecord()))
    for calibration, expected in ((good, True), (diagnosed, False)):
        further = judge(calibration).further
        assert any(command.startswith("calib diagnose") for command in further) == expected


def test_no_diagnosis_is_proposed_of_too_few_views(good: Calibration) -> None:
    commands = NextCommands(Path("s"), Path("s/calibration"), Settings(), diagnosable=False)
    assert commands.diagnose() == "capture s"
    assert NextCommands.of(good, None, None, ()).diagnosable
    nine = replace(good, views=good.views[:9])
    assert not NextCommands.of(nine, None, None, ()).diagnosable


def test_the_form_of_the_screen_is_changed_by_its_own_labels(tmp_path: Path) -> None:
    commands = NextCommands(tmp_path, tmp_path / "calibration", Settings(), in_form=True)
    assert commands.description == "the set-up"
    assert commands.name_medium(1.333) == "write 1.333 at outside_index in the set-up"
    assert commands.name_medium(1.34, 0.004) == (
        "write 1.34 ± 0.004 at outside_index in the set-up"
    )
    assert commands.unknown_cover == "unknown at cover shape in the set-up"
    assert commands.name_cover(["cone", "flat"]) == "choose it at cover shape in the set-up"


VERDICTS = sorted(Path(module.__file__).parent.glob("*.py"))
SPELT_FOR_EACH = {
    "next_commands.py": None,  # it spells them all
    "scale_evidence.py": {"session.yaml"},  # a source of intrinsics
    "picture_source.py": {"session.yaml"},  # a file's name
    "declared_numbers.py": {
        "leave --intrinsics out, and ",
        "write intrinsics: unknown in session.yaml",
    },
}
"""The texts that name the file or an option: where a form has none for it, and no sentences."""


@pytest.mark.parametrize("file", VERDICTS, ids=lambda file: file.name)
def test_sentences_name_the_file_and_options_only_where_there_is_no_form(file: Path) -> None:
    """So that the screen's verdict is in the words of its form."""
    allowed = SPELT_FOR_EACH.get(file.name, set())
    if allowed is None:
        return
    tree = ast.parse(file.read_text())
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in docstrings
    }
    mentions = {text for text in texts if "session.yaml" in text or re.search(r"\s--[a-z]", text)}
    assert mentions <= allowed


@pytest.mark.parametrize(
    ("is_owned", "plain", "with_sigma"),
    [
        (
            False,
            "write outside_index: 1.333 under cover in session.yaml",
            "write outside_index: {value: 1.34, sigma: 0.004} under cover in session.yaml",
        ),
        (True, "add --outside-index 1.333", "add --outside-index 1.34+-0.004"),
    ],
)
def test_the_medium_is_named_for_options_and_for_a_file(
    is_owned: bool, plain: str, with_sigma: str, tmp_path: Path
) -> None:
    commands = NextCommands(tmp_path, tmp_path / "calibration", Settings())
    if is_owned:
        OutputFolder(tmp_path).write("session.yaml", "format: 1\n")
    assert commands.name_medium(1.333) == plain
    assert commands.name_medium(1.34, 0.004) == with_sigma


def test_options_change_the_medium_of_a_session_that_calib_described(tmp_path: Path) -> None:
    commands = NextCommands(tmp_path, tmp_path / "calibration", Settings())
    assert commands.fit_in(1.333) == commands.fit(), "nothing is there"
    (tmp_path / "session.yaml").write_text("format: 1\n")
    assert commands.fit_in(1.333) == commands.fit(), "it is the user's own"
    assert commands.unknown_cover == "cover: {shape: unknown} in session.yaml"
    assert commands.name_cover(["cone", "flat"]) == "write cover.shape in session.yaml"
    (tmp_path / "session.yaml").unlink()
    OutputFolder(tmp_path).write("session.yaml", "format: 1\n")
    assert commands.fit_in(1.333) == commands.fit("--outside-index", "1.333")
    assert commands.unknown_cover == f"`calib fit {tmp_path} --cover unknown`"
    named = f"type `calib fit {tmp_path} --cover cone` or `--cover flat`"
    assert commands.name_cover(["cone", "flat"]) == named


def test_a_calibration_is_used_at_the_depth_of_its_fit(good: Calibration) -> None:
    commands = NextCommands(Path("s"), Path("s/calibration"), Settings())
    median = Case(good, (), commands, None, "HOLDOUT").main_depth
    assert 0.35 < median < 1.2
    fitted = replace(commands, depths=(0.6, 2.0))
    assert Case(good, (), fitted, None, "HOLDOUT").main_depth == 0.6


def test_a_depth_that_gets_a_warning_is_not_proposed(good: Calibration) -> None:
    out = Path("s/calibration")
    commands = NextCommands(Path("s"), out, Settings(), depths=(60.0, 0.05, 0.6))
    assert Case(good, (), commands, None, "HOLDOUT").main_depth == 0.6
    in_cm = replace(commands, depths=(60.0,))
    median = Case(good, (60.0,), in_cm, None, "HOLDOUT").main_depth
    assert 0.35 < median < 1.2
    verdict = judge(good, depths=(60.0,), folder=out)
    assert any("calib export" in command for command in verdict.further), "its map is not written"
    assert not any("--depth 60" in command for command in (verdict.use, *verdict.further))


def test_a_fit_makes_its_maps_again() -> None:
    commands = NextCommands(Path("s"), Path("s/calibration"), Settings(), depths=(0.525, 1.0))
    assert commands.fit("--free", "all") == "calib fit s --depth 0.525 1 --free all"
    assert "--depth 0.525 " in commands.undistort(0.525)
    assert "--depth 0.525 " in commands.export(0.525)


def test_a_session_that_was_moved_with_its_calibration_is_found(
    good: Calibration, tmp_path: Path
) -> None:
    session = tmp_path / "s"
    (session / "frames").mkdir(parents=True)
    (session / "session.yaml").touch()
    (session / "frames" / "a.png").touch()
    command = CommandOptions(depths=(0.5,))
    provenance = Provenance(session=str(tmp_path / "gone"))
    moved = replace(good, request=replace(good.request, command=command, provenance=provenance))
    out = session / "calibration"
    commands = NextCommands.of(moved, out, None, ())
    assert commands.fit().startswith(f"calib fit {session} ")
    assert commands.fit().endswith("--depth 0.5")
    assert commands.capture() == f"capture {session}"
    assert f"undistort {out} {session}/frames --depth 0.5" in commands.undistort(0.5)


def test_a_fit_is_asked_for_again_as_it_was() -> None:
    settings = Settings(method="paper", grid=(8, 6), free=("thickness", "index"))
    commands = NextCommands(Path("s"), Path("out"), settings)
    assert commands.fit() == "calib fit s --method paper --grid 8x6 --free thickness,index -o out"
    assert (
        commands.fit("--free", "all") == "calib fit s --method paper --grid 8x6 -o out --free all"
    )
    assert "8x6" not in commands.fit("--grid", "auto")
