"""A whole session's corners: threads, what is kept, and the advice when the board is another
one.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.corners import detect as detector
from calib.corners import detect_all
from calib.corners.detect_all import DETECTIONS_FILE, FILE_START, Detections, detect
from calib.corners.detection import NotFound
from calib.errors import InputError, NotEnoughDataError
from calib.session.board import Board
from calib.session.coding import Charuco
from tests.corners.test_detect import BOARD, Scene, rms

MEASURED = Path(__file__).parents[3] / "shared" / "data"


def write(folder: Path, scenes: list[Scene | None]) -> list[Path]:
    """Pictures of these scenes; of an empty wall for None."""
    folder.mkdir(exist_ok=True)
    paths = []
    for number, scene in enumerate(scenes):
        picture = np.full((120, 160), 120, np.uint8) if scene is None else scene.draw()[0]
        paths.append(folder / f"{number:04}.png")
        assert cv2.imwrite(str(paths[-1]), picture)
    return paths


def views(count: int, board: Board = BOARD) -> list[Scene | None]:
    return [
        Scene(board=board, roll=0.1 * k, tilt=(0.4 - 0.1 * k, 0.3), seed=k) for k in range(count)
    ]


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Grows by one with every picture in which corners are really looked for."""
    made: list[int] = []
    real: Callable = detector.find_corners

    def counted(grey: np.ndarray, board: Board) -> object:
        made.append(1)
        return real(grey, board)

    monkeypatch.setattr(detector, "find_corners", counted)
    return made


def same(item: Detections, second: Detections) -> bool:
    return item.rejected == second.rejected and all(
        a.name == b.name
        and np.array_equal(a.corners, b.corners, equal_nan=True)
        and np.array_equal(a.weight, b.weight)
        and np.array_equal(np.asarray(a.covariance), np.asarray(b.covariance), equal_nan=True)
        and a.blur is not None
        and b.blur is not None
        and np.array_equal(a.blur, b.blur, equal_nan=True)
        for a, b in zip(item.views, second.views, strict=True)
    )


def test_every_picture_is_found_or_rejected_in_order(tmp_path: Path) -> None:
    scenes = views(4)
    scenes.insert(1, None)
    reported: list[tuple[int, int]] = []
    result = detect(
        write(tmp_path, scenes), BOARD, lambda done, hits: reported.append((done, hits))
    )
    assert [view.name for view in result.views] == ["0000.png", "0002.png", "0003.png", "0004.png"]
    assert [(r.name, r.reason.split(":")[0]) for r in result.rejected] == [
        ("0001.png", "no 9x6 board found")
    ]
    assert [done for done, _ in reported] == [1, 2, 3, 4, 5]
    assert reported[-1] == (5, 4)
    for view, scene in zip(result.views, (s for s in scenes if s is not None), strict=True):
        assert rms(view.corners, scene.draw()[1]) < 0.08
        assert view.covariance is not None
        assert np.linalg.eigvalsh(view.covariance).min() > 0
        assert view.weight.min() > 0.5


def test_a_second_run_reads_no_picture_and_gives_the_same_result(
    tmp_path: Path, looks: list[int]
) -> None:
    paths = write(tmp_path, [*views(3), None])
    first = detect(paths, BOARD)
    assert len(looks) == 4
    assert same(detect(paths, BOARD), first)
    assert len(looks) == 4


def test_the_order_of_the_pictures_and_the_number_of_threads_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = write(tmp_path, views(4))
    first = detect(paths, BOARD)
    (tmp_path / DETECTIONS_FILE).unlink()
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    repeat = detect(paths[::-1], BOARD)
    assert same(Detections(repeat.views[::-1], repeat.rejected), first)


def test_a_corner_that_cannot_be_measured_is_kept_as_such(tmp_path: Path, looks: list[int]) -> None:
    """A pen lies beside the corner: the board is found, this corner's edges are not."""
    paths = write(tmp_path, views(3))
    picture, truth = Scene(roll=0.1, tilt=(0.3, 0.3), seed=1).draw()
    spot = tuple(np.rint(truth[30] + 3).astype(int).tolist())
    cv2.circle(picture, spot, 4, 130, -1)
    assert cv2.imwrite(str(paths[1]), picture)
    first = detect(paths, BOARD)
    assert first.views[1].seen.sum() == BOARD.count - 1
    assert not first.views[1].seen[30]
    assert np.isnan(first.views[1].corners[30]).all()
    assert np.array_equal(np.isnan(np.asarray(first.views[1].blur)).all(1), ~first.views[1].seen)
    assert same(detect(paths, BOARD), first)
    assert len(looks) == 3


def test_only_a_changed_picture_is_looked_at_again(tmp_path: Path, looks: list[int]) -> None:
    paths = write(tmp_path, views(4))
    detect(paths, BOARD)
    shutil.copyfile(paths[0], paths[2])
    result = detect(paths, BOARD)
    assert len(looks) == 5
    assert np.array_equal(result.views[0].corners, result.views[2].corners)


@pytest.mark.parametrize("change", ["board", "detector", "opencv"])
def test_changed_settings_look_again(
    tmp_path: Path, looks: list[int], monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    paths = write(tmp_path, views(3))
    detect(paths, BOARD)
    board = Board(6, 9, BOARD.square) if change == "board" else BOARD
    if change == "detector":
        monkeypatch.setattr(detector, "VERSION", detector.VERSION + 1)
    if change == "opencv":
        monkeypatch.setattr(cv2, "__version__", "99.0.0")
    detect(paths, board)
    assert len(looks) == 6


def test_saved_detections_are_valid_for_any_size_of_the_squares(
    tmp_path: Path, looks: list[int]
) -> None:
    paths = write(tmp_path, views(3))
    detect(paths, BOARD)
    detect(paths, Board(BOARD.columns, BOARD.rows, 0.1))
    assert len(looks) == 3


CORRUPTIONS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _: b"",
    "half": lambda data: data[: len(data) // 2],
    "not text": lambda _: b"\xff\xfe\x00\x01",
    "a list": lambda _: b"[]",
    "deep": lambda _: b"[" * 100_000,
    "no files": lambda data: data.replace(b'"files"', b'"flies"'),
    "entries of another kind": (
        lambda data: json.dumps(
            {**json.loads(data), "files": {f"{k:04}.png": 7 for k in range(3)}}
        ).encode()
    ),
    "short corners": lambda data: data.replace(
        b'"corners": [', b'"corners": [[1.0, 2.0]], "rest": ['
    ),
    "undefined corners": lambda data: data.replace(b'"corners": [[', b'"corners": [[NaN, 1.0], ['),
    "an endless number": lambda data: data.replace(
        b'"corners": [[', b'"corners": [[1' + b"0" * 400 + b", 1.0], ["
    ),
    "no covariances": lambda data: data.replace(b'"covariances"', b'"variances"'),
    "undefined covariances": lambda data: data.replace(
        b'"covariances": [[', b'"covariances": [[NaN, '
    ),
    "no blurs, as in earlier versions": lambda data: data.replace(b'"blurs"', b'"before"'),
    "a negative blur": lambda data: data.replace(b'"blurs": [[', b'"blurs": [[-'),
    "no detector": lambda data: data.replace(b'"saddles"', b'"guess"'),
}


@pytest.mark.parametrize("corrupt", CORRUPTIONS.values(), ids=CORRUPTIONS.keys())
def test_a_corrupt_store_is_ignored_and_written_anew_if_it_is_ours(
    tmp_path: Path, looks: list[int], corrupt: Callable[[bytes], bytes]
) -> None:
    paths = write(tmp_path, views(3))
    first = detect(paths, BOARD)
    stored = tmp_path / DETECTIONS_FILE
    content = stored.read_bytes()
    changed = corrupt(content)
    stored.write_bytes(changed)
    assert changed != content
    assert same(detect(paths, BOARD), first)
    assert len(looks) == 6
    is_ours = FILE_START.startswith(changed[: len(FILE_START)])
    assert stored.read_bytes() == (content if is_ours else changed)


def test_a_folder_that_cannot_be_written_gets_no_saved_detections(
    tmp_path: Path, looks: list[int]
) -> None:
    paths = write(tmp_path, views(3))
    (tmp_path / DETECTIONS_FILE).mkdir()  # even root cannot write a file there
    for _ in range(2):
        assert len(detect(paths, BOARD).views) == 3
    assert len(looks) == 6
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        DETECTIONS_FILE,
        "0000.png",
        "0001.png",
        "0002.png",
    ]


def test_a_damaged_picture_is_named_and_the_others_are_kept(
    tmp_path: Path, looks: list[int]
) -> None:
    paths = write(tmp_path, views(4))
    paths[3].write_bytes(paths[3].read_bytes()[:2000])
    detections = detect(paths, BOARD)
    assert [view.name for view in detections.views] == ["0000.png", "0001.png", "0002.png"]
    assert [(r.name, r.reason) for r in detections.rejected] == [
        ("0003.png", "is truncated or damaged")
    ]
    (gone,) = detect([*paths[:3], tmp_path / "gone.png"], BOARD).rejected
    assert (gone.name, gone.reason) == ("gone.png", "cannot be read")
    assert len(looks) == 3


def test_pictures_of_which_half_are_damaged_are_refused(tmp_path: Path) -> None:
    paths = write(tmp_path, views(4))
    for path in paths[2:]:
        path.write_bytes(b"")
    with pytest.raises(InputError, match=r"0002\.png is an empty file: copy it again"):
        detect(paths, BOARD)


def test_the_advice_is_on_the_board_and_not_on_damaged_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = write(tmp_path, [None] * 5)
    for path in paths[3:]:
        path.write_bytes(b"")
    numbers = iter(range(3))
    monkeypatch.setattr(detect_all, "find_board", lambda *_: NotFound(f"reason {next(numbers)}"))
    coded = Board(9, 6, 0.03, coding=Charuco(0.02, "DICT_4X4_50"))
    with pytest.raises(NotEnoughDataError, match=r"in 0 of 5 pictures: reason \d, and check that"):
        detect(paths, coded)


@pytest.mark.parametrize(
    ("declared", "keys"),
    [
        pytest.param(Board(8, 5, 1.0), "columns: 9, board.rows: 6", marks=pytest.mark.slow),
        (Board(9, 7, 1.0), "rows: 6"),
    ],
    ids=str,
)
def test_a_wrongly_declared_board_is_named(tmp_path: Path, declared: Board, keys: str) -> None:
    with pytest.raises(
        NotEnoughDataError,
        match=(
            rf"^3 pictures show a board of 9x6 .* the declared .*: write board.{keys} in"
            r" session.yaml"
        ),
    ):
        detect(write(tmp_path, views(4)), declared)


def test_pictures_without_a_board_say_what_to_check(tmp_path: Path) -> None:
    with pytest.raises(
        NotEnoughDataError,
        match=(
            "9x6 board was found in 0 of 3 pictures: show the whole board with its white margin,"
            r" .* and check that it has 9x6 inner corners \(board.columns, board.rows\)"
        ),
    ):
        detect(write(tmp_path, [None] * 3), BOARD)


def test_a_few_views_of_many_are_not_enough(tmp_path: Path) -> None:
    with pytest.raises(NotEnoughDataError, match="found in 2 of 4"):
        detect(write(tmp_path / "two", [*views(2), None, None]), BOARD)
    with pytest.raises(NotEnoughDataError, match="found in 3 of 16"):
        detect(write(tmp_path / "fifth", [*views(3), *[None] * 13]), BOARD)


def test_one_good_picture_alone_is_enough_where_one_was_asked_for(tmp_path: Path) -> None:
    assert len(detect(write(tmp_path, views(1)), BOARD).views) == 1


def test_a_session_without_pictures_is_reported() -> None:
    with pytest.raises(NotEnoughDataError, match="there is no picture"):
        detect([], BOARD)


@pytest.mark.parametrize(
    ("session", "board", "minimum"), [("pi-wide", BOARD, 47), ("blind-c", Board(9, 9, 0.02), 20)]
)
def test_recorded_boards_are_found(
    tmp_path: Path, session: str, board: Board, minimum: int
) -> None:
    source = MEASURED / session / "frames"
    if not source.is_dir():
        pytest.skip(f"{source} is not here: the recorded pictures are no part of the project.")
    frames = Path(
        shutil.copytree(source, tmp_path / "frames", ignore=shutil.ignore_patterns(DETECTIONS_FILE))
    )
    assert (
        len(
            detect(sorted(p for p in frames.iterdir() if p.suffix in (".png", ".jpg")), board).views
        )
        >= minimum
    )
