"""Manifests: what they may say, and one sentence for everything that is wrong with them."""

import math
from pathlib import Path

import fsspec
import pytest

from calib.errors import InputError
from calib.fleet.limits import Limit
from calib.fleet.manifest import Entry, read_manifest


def table(tmp_path: Path, text: str, name: str = "fleet.csv") -> tuple[Entry, ...]:
    (tmp_path / name).write_text(text)
    return read_manifest([str(tmp_path / name)])


def test_paths_of_a_csv_are_relative_to_it(tmp_path: Path) -> None:
    entries = table(
        tmp_path,
        "\ufeffid,session,serial,prior,fixture,date,held_out_px.max,camera.fx.min,camera.fx.max\n"
        "A1,sessions/A1,0012,old/A1,left,2026-05-17,0.3,1270,1290\n\n"
        "A2,/data/A2,,,,,,,1300\n",
    )
    first, second = entries
    assert first == Entry(
        "A1",
        str(tmp_path / "sessions/A1"),
        "0012",
        str(tmp_path / "old/A1"),
        "left",
        "2026-05-17",
        (Limit("held_out_px", high=0.3), Limit("camera.fx", 1270, 1290)),
    )
    assert second == Entry("A2", "/data/A2", limits=(Limit("camera.fx", -math.inf, 1300),))


def test_a_camera_s_limits_override_those_of_the_yaml(tmp_path: Path) -> None:
    first_entry, second_entry = table(
        tmp_path,
        "limits: {noise_px: {max: 0.2}, cover.thickness: {min: 2.9, max: 3.1}}\ncameras:\n- {id: a,"
        " session: s3://bucket/a}\n- {id: b, session: b, limits: {noise_px: {max: 0.5}}}\n",
        "fleet.yaml",
    )
    assert first_entry.session == "s3://bucket/a"
    assert first_entry.limits == (Limit("noise_px", high=0.2), Limit("cover.thickness", 2.9, 3.1))
    assert second_entry.limits == (Limit("noise_px", high=0.5), Limit("cover.thickness", 2.9, 3.1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("id,session\n", "has no camera"),
        ("id,session\na,x\nA,y\n", "the id a and A comes twice: give each camera an id of its own"),
        ("id,session\na,x\nb,x/\n", "a and b have one session"),
        ("id,session\na,\n", "line 2: session is missing"),
        ("id,session\n../a,x\n", "id is '../a': write letters"),
        ("id,session\na.json,x\n", "id is 'a.json'"),
        ("id,sesion\na,x\n", "'sesion' is not a column of a fleet: did you mean session"),
        ("id\na\n", "has no column session"),
        ("id,session,id\na,x,b\n", "the column 'id' comes twice"),
        ("id;session\na;x\n", "has semicolons between its columns: write commas"),
        ("id,session\na,x,y\n", "line 2 has 3 cells and the first line 2"),
        ("id,session,date\na,x,17.5.26\n", "date is '17.5.26': write a day as 2026-05-17"),
        (
            "id,session,held_out.max\na,x,1\n",
            "'held_out' is not a number of a camera: did you mean held_out_px",
        ),
        ("id,session,noise_px.max\na,x,much\n", "noise_px.max is 'much': write a number"),
        ("id,session,noise_px.max\na,x,nan\n", "noise_px.max is 'nan': write a number"),
        (
            "id,session,noise_px.min,noise_px.max\na,x,2,1\n",
            "noise_px has 2 as its min and 1 as its max: exchange them",
        ),
        ('id,session\n"a,x\n', "is not a CSV table"),
        ("", "has no column id"),
    ],
)
def test_errors_of_a_csv_get_a_sentence(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=r"^[^\n]*$") as caught:
        table(tmp_path, text)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cameras: []\n", "has no camera"),
        ("cameras: {a: x}\n", "cameras is a mapping: write a list"),
        ("cameras: [a]\n", "cameras[0]"),
        (
            "cameras: [{id: 12, session: x}]\n",
            "cameras[0].id is 12: write a text, in quotes if need be",
        ),
        ("cameras: [{id: a, session: x, serail: b}]\n", "did you mean serial?"),
        (
            "cameras: [{id: a, session: x, limits: {noise_px: {top: 1}}}]\n",
            "top is not a end of a limit",
        ),
        ("camera: []\n", "did you mean cameras?"),
    ],
)
def test_errors_of_a_yaml_get_a_sentence(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        table(tmp_path, text, "fleet.yaml")
    assert message in str(caught.value)


def sessions(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).mkdir(parents=True)
        (folder / name / "session.yaml").write_text("")


def test_a_glob_and_folders_are_named_by_their_sessions(tmp_path: Path) -> None:
    sessions(tmp_path, "one", "two words", "three")
    (tmp_path / "notes.txt").write_text("")
    results = {entry.id: entry.session for entry in read_manifest([str(tmp_path / "*")])}
    assert results == {
        "one": str(tmp_path / "one"),
        "two-words": str(tmp_path / "two words"),
        "three": str(tmp_path / "three"),
    }
    assert [
        entry.id for entry in read_manifest([str(tmp_path / "one"), str(tmp_path / "three")])
    ] == ["one", "three"]


@pytest.mark.parametrize(
    ("place", "message"),
    [
        (".", "is no session, for it has no session.yaml: give a CSV, a YAML, or a glob such as"),
        ("notes.txt", "is neither a CSV nor a YAML"),
        (
            "none*",
            "none*: give session folders, or a table such as fleet.csv",
        ),
        ("missing.csv", "cannot be read"),
    ],
)
def test_a_file_that_is_no_manifest_gets_a_sentence(
    tmp_path: Path, place: str, message: str
) -> None:
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(InputError) as caught:
        read_manifest([str(tmp_path / place)])
    assert message in str(caught.value)


def test_sessions_of_one_name_need_a_table(tmp_path: Path) -> None:
    sessions(tmp_path, "monday/A1", "tuesday/A1")
    with pytest.raises(
        InputError, match="the id A1 comes twice: list them in a CSV with ids of your own"
    ):
        read_manifest([str(tmp_path / "*" / "A1")])


def test_a_table_and_a_glob_at_an_address() -> None:
    files = fsspec.filesystem("memory")
    files.pipe("/line/fleet.csv", b"id,session\na,sessions/a\n")
    files.pipe("/line/sessions/b/session.yaml", b"format: 1\n")
    assert read_manifest(["memory://line/fleet.csv"]) == (Entry("a", "memory://line/sessions/a"),)
    (entry,) = read_manifest(["memory://line/sessions/*"])
    assert (entry.id, entry.session) == ("b", "memory:///line/sessions/b")
    with pytest.raises(InputError, match=r"nowhere://a/fleet.csv cannot be read"):
        read_manifest(["nowhere://a/fleet.csv"])
