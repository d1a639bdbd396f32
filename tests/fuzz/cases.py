"""The fuzzed inputs: for each kind a strategy, and the calls that read it.

None of these may raise anything but RefracalError.
"""

import io
import os
import re
import tarfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cached_property, partial
from hashlib import sha256
from pathlib import Path
from shutil import rmtree
from typing import Any

import cv2
import numpy as np
import yaml
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from calib.apply.measure_files import read_points, read_poses
from calib.calibration import Calibration
from calib.cli import main
from calib.corners.corners_file import read_corners, write_corners
from calib.corners.detect_all import DETECTIONS_FILE, detect
from calib.corners.view import View
from calib.errors import MAX_MESSAGE, RefracalError
from calib.fleet.manifest import read_manifest
from calib.importing.from_kalibr import from_kalibr
from calib.importing.from_mrcal import from_cameramodel
from calib.importing.from_ros import from_ros_archive
from calib.io.depth_image import read_depth_image
from calib.io.frames_table import last_view, read_frame_records, read_table
from calib.io.images import list_images, read_image
from calib.session.board import Board
from calib.session.session import check_images, read_session
from calib.verdict.judge import judge
from capture.cli import main as capture_main
from fixtures.known import known
from fixtures.synthetic import scene
from tests.fuzz.command_lines import good_lines
from tests.fuzz.strategies import arrays, corner_views, lines, mappings, npys, texts
from tests.importing.recordings import cameramodel
from tests.session.malformed import (
    CONE,
    FLAT,
    SESSION,
    WITH_CORNERS,
    checkerboard,
    write_good_session,
)
from tests.test_calibration import write_session

FLEET_CSV = (
    b"id,session,serial,prior,fixture,date,held_out_px.max,error_px.min\n"
    b"A17,sessions/A17,123,old/A17,bench 1,2026-05-17,0.3,0.01\n"
    b"A18,sessions/A18,124,,bench 2,2026-05-18,,\n"
)
FLEET: Mapping[str, Any] = {
    "limits": {"held_out_px": {"max": 0.3}},
    "cameras": [
        {"id": "A17", "session": "sessions/A17", "date": "2026-05-17", "serial": "123"},
        {"id": "A18", "session": "sessions/A18", "limits": {"error_px": {"min": 0.01}}},
    ],
}
SMALL_SESSION = """\
format: 1
board: {columns: 6, rows: 5, square_mm: 20.0}
corners: corners.vnl
camera:
  width: 320
  height: 240
"""
COVERS = (
    "cover: {shape: none}\n",
    "  intrinsics: {fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5, distortion: [0, 0, 0, 0, 0]}\n"
    f"cover:\n{CONE}",
    "  intrinsics: {fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5, distortion: [0, 0, 0, 0, 0]}\n"
    f"cover:\n{FLAT}",
)
"""The ends of session.yaml for degenerate corners: a camera alone, behind a cone, behind a window.
"""
Run = Callable[[Any], object]
Reader = Callable[[Any], bool]
"""True where the input was refused by a sentence, which was looked at, and did not come as an
exception.
"""
BOARD = Board(6, 5, 0.02)
SPECIAL = ("fifo", "zero", "full", "folder", "loop", "nothing")
"""The things that may stand in the place of a file."""
SPEAKER = re.compile(r"^\w+[\w -]*: (error: )?")
"""Who speaks, before the sentence."""


@dataclass(frozen=True)
class Kind:
    """A kind of input."""

    name: str
    inputs: st.SearchStrategy[Any]
    run: Run | Reader
    cost: int = 1
    """The number of usual cases that take the time of one of these; so many fewer are tried."""


class Bench:
    """Good files in a folder, which the cases spoil one at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.session = write_good_session(folder / "session")
        self.calibration = folder / "calibration"
        fitted = write_session(folder / "scene", scene(7, views=5, amplitude=1e-5, noise=0.05))
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            if main(["fit", str(fitted), "--grid", "4x4", "-o", str(self.calibration)]) != 0:
                raise AssertionError("the good session cannot be fitted")
        self.plain = folder / "plain"
        self.checkerboard = cv2.imencode(".png", checkerboard(50, 30))[1].tobytes()
        session = self._write_corners(seen_boards(), COVERS[0])
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            if main(["fit", str(session), "-o", str(self.plain)]) != 0:
                raise AssertionError("the good corners cannot be fitted")
        known(scene(1, views=1, grid=(4, 4), amplitude=3e-5), 64, 48).save(folder / "small")
        self.said: dict[str, Any] = yaml.safe_load(
            (self.calibration / "calibration.yaml").read_text()
        )
        with np.load(self.calibration / "calibration.npz") as file:
            self.arrays = dict(file)

    @cached_property
    def kinds(self) -> tuple[Kind, ...]:
        session = yaml.safe_load(SESSION)
        pictures = [
            cv2.imencode(suffix, np.full((24, 32), 99, np.uint8))[1].tobytes()
            for suffix in (".png", ".jpg", ".bmp", ".tiff")
        ]
        boards = [
            cv2.imencode(suffix, checkerboard(80, 40))[1].tobytes()
            for suffix in (".png", ".jpg", ".bmp", ".tiff")
        ]
        detections = self._detections()
        model = cameramodel(self.folder / "a.cameramodel").read_bytes()
        chain = {
            "cam0": {"camera_model": "pinhole", "resolution": [32, 24], "intrinsics": [1, 2, 3, 4]},
            "target_type": "checkerboard",
        }
        target = {
            "targetCols": 6,
            "targetRows": 5,
            "colSpacingMeters": 0.02,
            "rowSpacingMeters": 0.02,
        }
        points = (
            b"name,image,x,y\na,0000.png,10,20\nb,0000.png,30.5,40\n",
            b"image,rx,ry,rz,tx,ty,tz\n0000.png,0,0,0,0,0,0.5\n",
        )
        table = b"file,time_s,sequence,view,gain\n0000.png,1.5,0,0,1\n0001.jpg,2.5,1,0,1\n0002.png,3.5,2,1,1\n"  # noqa: E501
        corners = (self.session / "corners.vnl").read_bytes()
        depths = st.lists(
            st.sampled_from(
                ("1", "0.5", "inf", "1e308", "1e-300", "nan", "-1", "\x1b[2J", "x" * 5000)
            ),
            min_size=1,
            max_size=2,
        )
        return (
            # First those with few different values: what they leave of their share goes to the
            # others.
            Kind(
                "something else than a file",
                st.tuples(st.sampled_from(SPECIAL), st.integers(0, 9)),
                self._special,
            ),
            Kind(
                "--depth",
                st.tuples(depths, st.sampled_from(("npz", "ros", "opencv", "stmap"))),
                self._depth,
            ),
            Kind(
                "degenerate corners, fitted",
                st.tuples(corner_views(seen_boards()), st.sampled_from(COVERS)),
                self._fit,
                cost=20,
            ),
            Kind(
                "degenerate corners, checked",
                corner_views(seen_boards()),
                self._check_views,
                cost=10,
            ),
            Kind("pictures, checked", texts(boards), self._check_picture, cost=5),
            Kind("a calibration, judged", self._spoilt(), self._judge, cost=10),
            Kind(
                "fleet.csv",
                texts([FLEET_CSV]),
                partial(self._fleet, "fleet.csv"),
            ),
            Kind(
                "fleet.yaml",
                st.one_of(texts([_yaml(FLEET)]), mappings(FLEET).map(_yaml)),
                partial(self._fleet, "fleet.yaml"),
            ),
            Kind("a command line", lines(good_lines(self.folder, points)), self._line),
            Kind(
                "session.yaml, as text",
                texts([SESSION.encode(), WITH_CORNERS.encode()]),
                self._session,
            ),
            Kind("session.yaml, by value", mappings(session).map(_yaml), self._session),
            Kind("frames.csv", texts([table]), self._frames),
            Kind("corners.vnl", texts([corners]), self._corners),
            Kind(
                "detections",
                st.one_of(texts([_yaml(detections)]), mappings(detections).map(_yaml)),
                self._kept,
            ),
            Kind(
                "a picture",
                st.one_of(texts(pictures), texts([p + b"\xff" * 60_000 for p in pictures]), npys()),
                self._picture,
            ),
            Kind(
                "calibration.yaml, as text",
                texts([(self.calibration / "calibration.yaml").read_bytes()]),
                self._text,
            ),
            Kind("calibration.yaml, by value", mappings(self.said), self._value),
            Kind("calibration.npz", arrays(self.arrays), self._arrays),
            Kind(
                "calibration.npz, as bytes",
                texts([(self.calibration / "calibration.npz").read_bytes()]),
                self._bytes,
            ),
            Kind("points", texts(points), self._points),
            Kind(".cameramodel", texts([model]), self._mrcal),
            Kind("calibrationdata.tar", texts(tars(pictures[0])), self._ros),
            Kind("camchain.yaml", mappings(chain | target).map(_yaml), self._kalibr),
        )

    def deep(self, value: object) -> None:
        """Do what a person does next with a calibration that could be read; it takes seconds."""
        for words in (
            ["report", "--no-open"],
            ["export", "--format", "npz", "--depth", "1", "-o", str(self.folder / "out")],
        ):
            self._command([*words, str(self.calibration)])
        judge(Calibration.load(self.calibration))
        del value

    def _detections(self) -> dict[str, Any]:
        detect(list_images(self.session / "frames")[:1], BOARD)
        document: dict[str, Any] = yaml.safe_load(
            (self.session / "frames" / DETECTIONS_FILE).read_text()
        )
        return document

    def _put(self, name: str, data: bytes) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        return path

    def _session(self, data: bytes) -> None:
        self._put("session/session.yaml", data)
        session = read_session(self.session)
        check_images(session)
        if session.corners:
            read_corners(session.corners, session.board)

    def _frames(self, data: bytes) -> None:
        path = self._put("frames.csv", data)
        read_frame_records(path)
        last_view(read_table(path))

    def _corners(self, data: bytes) -> None:
        read_corners(self._put("corners.vnl", data), BOARD)

    def _kept(self, data: bytes) -> None:
        self._put(f"session/frames/{DETECTIONS_FILE}", data)
        detect(list_images(self.session / "frames")[:1], BOARD)

    def _picture(self, data: bytes) -> bool:
        suffixes = (".npy",) if data.startswith(b"\x93NUMPY") else (".png", ".npy")
        paths = [self._put(f"picture{suffix}", data) for suffix in suffixes]
        return _refused(
            [partial(read, path) for path in paths for read in (read_image, read_depth_image)]
        )

    def _text(self, data: bytes) -> None:
        self._put("calibration/calibration.yaml", data)
        self._load()

    def _value(self, document: dict[str, Any]) -> None:
        self._put("calibration/calibration.yaml", _yaml(document))
        self._load()

    def _arrays(self, held: dict[str, np.ndarray]) -> None:
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **held)
        self._bytes(buffer.getvalue())

    def _bytes(self, data: bytes) -> None:
        self._put("calibration/calibration.npz", data)
        self._put(
            "calibration/calibration.yaml",
            _yaml(self.said | {"arrays_sha256": sha256(data).hexdigest()}),
        )
        self._load()

    def _load(self) -> None:
        try:
            calibration = Calibration.load(self.calibration)
            if os.environ.get("FUZZ_DEEP"):
                self.deep(calibration)
        finally:
            self._put("calibration/calibration.yaml", _yaml(self.said))
            np.savez(self.calibration / "calibration.npz", allow_pickle=False, **self.arrays)

    def _write_corners(self, corners: np.ndarray, cover: str) -> Path:
        """A session of a small camera, with these corners of BOARD."""
        folder = self.folder / "degenerate"
        self._put("degenerate/session.yaml", (SMALL_SESSION + cover).encode())
        visible = np.isfinite(corners[..., 0])
        views = [
            View(f"{number:04d}.png", view, weight.astype(np.float64))
            for number, (view, weight) in enumerate(zip(corners, visible, strict=True))
        ]
        write_corners(folder / "corners.vnl", views)
        return folder

    def _fit(self, case: tuple[np.ndarray, str]) -> bool:
        folder, out = self._write_corners(*case), str(self.folder / "degenerate-out")
        words = ["fit", str(folder), "--grid", "2x2", "--steps", "20", "-o", out]
        if self._command(words):
            return True
        self._command(["evaluate", out, str(folder)])
        return self._command(["check", out, str(folder)])

    def _check_views(self, corners: np.ndarray) -> bool:
        folder = self._write_corners(corners, COVERS[0])
        return self._command(["check", str(self.plain), str(folder)])

    def _check_picture(self, data: bytes) -> bool:
        self._put("checked/0.png", self.checkerboard)
        path = self._put("checked/1.png", data)
        return self._command(["check", str(self.plain), str(path.parent)])

    def _spoilt(self) -> st.SearchStrategy[tuple[dict[str, Any], dict[str, np.ndarray]]]:
        """calibration.yaml and the arrays of a calibration, one of both spoilt."""
        document: dict[str, Any] = yaml.safe_load((self.plain / "calibration.yaml").read_text())
        with np.load(self.plain / "calibration.npz") as file:
            held = dict(file)
        return st.one_of(
            st.tuples(mappings(document), st.just(held)), st.tuples(st.just(document), arrays(held))
        )

    def _judge(self, case: tuple[dict[str, Any], dict[str, np.ndarray]]) -> bool:
        verdict, held = case
        folder = self.folder / "judged"
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **held)
        self._put("judged/calibration.npz", buffer.getvalue())
        digest = sha256(buffer.getvalue()).hexdigest()
        self._put("judged/calibration.yaml", _yaml(verdict | {"arrays_sha256": digest}))
        judge(Calibration.load(folder))
        session = self._write_corners(seen_boards(), COVERS[0])
        refused = [
            self._command([word, str(folder), str(session)]) for word in ("evaluate", "check")
        ]
        return all(refused)

    def _fleet(self, name: str, data: bytes) -> None:
        read_manifest([str(self._put(name, data))])

    def _points(self, data: bytes) -> bool:
        path = self._put("points.csv", data)
        return _refused([partial(read, path) for read in (read_points, read_poses)])

    def _mrcal(self, data: bytes) -> None:
        from_cameramodel(self._put("a.cameramodel", data))

    def _ros(self, data: bytes) -> None:
        for _, picture in from_ros_archive(self._put("a.tar", data), BOARD, None).frames:
            assert len(picture) < 1 << 29

    def _kalibr(self, data: bytes) -> None:
        self._put("kalibr/chain.yaml", data)
        self._put("kalibr/cam0/0.png", b"")
        from_kalibr(self.folder / "kalibr", None, None)

    def _special(self, case: tuple[str, int]) -> None:
        what, which = case
        path = self.folder / "special" / "session.yaml"
        rmtree(path.parent, ignore_errors=True)
        path.parent.mkdir()
        match what:
            case "fifo":
                os.mkfifo(path)
            case "folder":
                path.mkdir()
            case "loop":
                path.symlink_to(path)
            case "zero" | "full":
                path.symlink_to(f"/dev/{what}")
        readers: Sequence[Run] = (
            lambda _: read_session(path.parent),
            lambda _: read_points(path),
            read_image,
            read_depth_image,
            read_frame_records,
            lambda _: read_corners(path, BOARD),
            from_cameramodel,
            lambda _: from_ros_archive(path, BOARD, None),
            Calibration.load,
            lambda _: self._command(
                [
                    "undistort",
                    str(self.folder / "small"),
                    str(path),
                    "--depth",
                    "1",
                    "-o",
                    str(self.folder / "out"),
                ]
            ),
        )
        readers[which](path)

    def _depth(self, case: tuple[list[str], str]) -> bool:
        depths, form = case
        return self._command(
            [
                "export",
                str(self.folder / "small"),
                "--format",
                form,
                "--depth",
                *depths,
                "-o",
                str(self.folder / "out"),
            ]
        )

    def _line(self, words: list[str]) -> bool:
        """In a folder of its own, as a word may name where files go."""
        place = self.folder / "line"
        rmtree(place, ignore_errors=True)
        place.mkdir()
        with chdir(place):
            return self._command(words[1:], main if words[0] == "calib" else capture_main)

    def _command(self, words: list[str], command: Callable[[list[str]], int] = main) -> bool:
        """Whether it refuses. What it says is a sentence a line, and nothing is a bug."""
        with redirect_stdout(io.StringIO()) as shown, redirect_stderr(io.StringIO()) as errors:
            try:
                code = command(words)
            except SystemExit as ended:
                code = int(str(ended.code))
        last = errors.getvalue().strip().splitlines()[-1:] or [""]
        assert code in (0, 2, 3, 4, 5), f"{code}: {last[0]}"
        assert code in (0, 5) or last[0], (
            "nothing is said"
        )  # 5 is the answer of a check, which stands on stdout
        for line in errors.getvalue().splitlines():
            assert len(SPEAKER.sub("", line)) <= MAX_MESSAGE, f"{len(line)} characters: {line}"
        assert "\x1b[2J" not in errors.getvalue() + shown.getvalue()
        return code != 0


def seen_boards() -> np.ndarray:
    """(8, 30, 2) px: the corners of BOARD as a pinhole camera sees them."""
    draw = np.random.default_rng(4)
    matrix = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
    views = []
    for _ in range(8):
        turn = draw.uniform(-0.5, 0.5, 3)
        shift = np.array([*draw.uniform(-0.02, 0.02, 2), draw.uniform(0.25, 0.35)])
        points = np.column_stack([BOARD.points(), np.zeros(BOARD.count)])
        projected, _ = cv2.projectPoints(points, turn, shift, matrix, None)
        views.append(projected[:, 0] + draw.normal(0, 0.05, (BOARD.count, 2)))
    return np.array(views)


def each_of(kind: Kind, cases: int, act: Run, number: int = 0) -> None:
    """Call it with so many inputs of a kind, the same ones for the same seed `number`; fewer where
    there are no more.
    """

    @seed(number)
    @settings(
        max_examples=max(1, cases // kind.cost),
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(kind.inputs)
    def each(value: Any) -> None:
        act(value)

    each()


def spoil(kind: Kind, value: Any) -> bool:
    """Run one case, and say whether it was refused; AssertionError where a message is not a short
    line, and whatever else a bug raises.
    """
    try:
        return kind.run(value) is True
    except RefracalError as error:
        return _check(error)


def _refused(reads: Sequence[Callable[[], object]]) -> bool:
    """Whether every one of several readers refuses; each has its turn."""
    refusals = 0
    for read in reads:
        try:
            read()
        except RefracalError as error:
            refusals += _check(error)
    return refusals == len(reads)


def _check(error: RefracalError) -> bool:
    sentence = str(error)
    assert sentence, "nothing is said"
    assert len(sentence) <= MAX_MESSAGE, f"{len(sentence)} characters: {sentence}"
    assert sentence.isprintable(), repr(sentence)
    return True


def _yaml(document: object) -> bytes:
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True).encode(
        "utf-8", "backslashreplace"
    )


def tars(picture: bytes) -> list[bytes]:
    """One as ROS writes it, and one with a member that says it has 1 TiB."""
    made = []
    for claimed in (len(picture), 1 << 40):
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w") as tar:
            described = _yaml({"image_width": 32, "image_height": 24, "camera_name": "x"})
            for name, data, size in (
                ("ost.yaml", described, len(described)),
                ("left-0000.png", picture, claimed),
            ):
                member = tarfile.TarInfo(name)
                member.size = size
                if size == len(data):
                    tar.addfile(member, io.BytesIO(data))
                else:
                    buffer.write(member.tobuf())
        made.append(buffer.getvalue())
    return made
