"""A stream whose pixels have depths of their own, against rays that are traced by bisection, and a
depth image that another program replaces, damages and removes.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.cli import main
from calib.errors import InputError
from capture.sources.folder import FolderSource
from capture.streaming import depth_file as depth_file_module
from capture.streaming.depth_file import DepthFile
from capture.streaming.depth_maps import sample_depths
from capture.streaming.straightener import Straightener
from capture.streaming.stream import Stream
from capture.streaming.view import StreamView
from fixtures.synthetic import COVERS
from tests.capture.recordings import write_recording
from tests.capture.streaming.conftest import COUNT, SIZE
from tests.capture.streaming.listening import Remarks
from tests.capture.streaming.test_stream import Album
from tests.covers import oracle

W, H = SIZE
NEAR_M, FAR_M = 0.2, 0.8
"""m: two planes, the near one over the left half of the straight picture."""
EDGE_PX = 12
"""px beside the near plane's edge, where the two cameras see other parts of the far plane."""
WAVE = 0.2
"""The length of the waves that are drawn on both planes, as a tangent of the pinhole's rays."""
GREYS = 120.0
"""The amplitude of the waves, grey levels."""
VALID = StreamView(None, 0.0)
"""A view of valid pixels only."""


@pytest.fixture(scope="module")
def window(calibration: Calibration) -> Calibration:
    """A camera behind a flat window, in water."""
    cover = COVERS["wet-flat"][0]
    return replace(calibration, cover=cover, relief=None, amplitudes=np.zeros((0, 0)))


def pixel_grid() -> np.ndarray:
    """Return the (H * W, 2) px of a picture."""
    return np.stack(np.meshgrid(np.arange(W), np.arange(H)), -1).reshape(-1, 2).astype(float)


def drawn(tangents: np.ndarray) -> np.ndarray:
    """Return the grey levels of points of a plane, by the (N, 2) tangents at which the pinhole sees
    them.
    """
    return np.asarray(128 + GREYS * np.sin(2 * np.pi / WAVE * tangents).prod(-1))


def taken(calibration: Calibration) -> np.ndarray:
    """Return the (H, W) picture of both planes through the window, by the rays of the oracle."""
    k = calibration.camera.intrinsics
    assert k
    cover = calibration.cover.parameters
    inner = cover["distance"].value
    outer = inner + cover["thickness"].value
    glass = cover["refractive_index"].value
    surfaces = (
        (lambda points: points[:, 2] - inner, 1.0, glass),
        (lambda points: points[:, 2] - outer, glass, cover["outside_index"].value),
    )
    tangents = (pixel_grid() - [k.cx.value, k.cy.value]) / [k.fx.value, k.fy.value]
    origins, directions = oracle.trace(surfaces, tangents * oracle.FOCAL + oracle.CENTRE)

    def meet(depth: float) -> np.ndarray:
        reach = (depth - origins[:, 2:]) / directions[:, 2:]
        return np.asarray((origins + reach * directions)[:, :2])

    near, far = meet(NEAR_M), meet(FAR_M)
    levels = np.where(near[:, 0] < 0, drawn(near / NEAR_M), drawn(far / FAR_M))
    return np.rint(levels.reshape(H, W)).astype(np.uint8)


def straight_tangents(undistorter: Undistorter) -> np.ndarray:
    """Return the (H, W, 2) tangents of the rays of a straight picture."""
    matrix = undistorter.camera_matrix
    tangents = (pixel_grid() - matrix[:2, 2]) / matrix[[0, 1], [0, 1]]
    return np.asarray(tangents.reshape(H, W, 2))


def two_planes(calibration: Calibration) -> np.ndarray:
    """Return the (H, W) m depths of the picture of the view VALID."""
    undistorter = VALID.undistorter(calibration, np.zeros((H, W), np.float32))
    is_near = straight_tangents(undistorter)[..., 0] < 0
    return np.where(is_near, NEAR_M, FAR_M).astype(np.float32)


def write_depths(path: Path, depths: np.ndarray) -> Path:
    """Replace a depth image in one step, as float metres or in millimetres by the suffix."""
    temporary = path.with_name(f"temporary{path.suffix}")
    if path.suffix == ".npy":
        np.save(temporary, depths)
    else:
        cv2.imwrite(str(temporary), np.rint(1000 * depths).astype(np.uint16))
    temporary.replace(path)
    return path


def follow(
    calibration: Calibration,
    path: Path,
    view: StreamView = VALID,
    remarks: Remarks | None = None,
) -> Straightener:
    tell = (remarks or Remarks()).tell
    return Straightener(calibration, view, depth_file=DepthFile(path, 0.1, tell), tell=tell)


def halves_rms(straightener: Straightener, picture: np.ndarray) -> tuple[float, float]:
    """Return the RMS errors of a straight picture left and right of the near plane's edge, px."""
    undistorter = straightener._maps[1]
    tangents = straight_tangents(undistorter)
    error = straightener.straighten(picture) - drawn(tangents)
    edge = int(np.count_nonzero(tangents[0, :, 0] < 0))
    slope = GREYS * np.pi / WAVE / undistorter.camera_matrix[0, 0]  # grey levels per px, RMS
    near = error[4:-4, 4 : edge - EDGE_PX] / slope
    far = error[4:-4, edge + EDGE_PX : -4] / slope
    return float(np.sqrt((near**2).mean())), float(np.sqrt((far**2).mean()))


@pytest.fixture(scope="module")
def picture(window: Calibration) -> np.ndarray:
    return taken(window)


@pytest.mark.parametrize("suffix", [".npy", ".png"])
def test_two_planes_are_straight_at_once(
    window: Calibration, picture: np.ndarray, tmp_path: Path, suffix: str
) -> None:
    path = write_depths(tmp_path / f"depth{suffix}", two_planes(window))
    near, far = halves_rms(follow(window, path), picture)
    assert max(near, far) < 0.1
    near, far = halves_rms(Straightener(window, StreamView(NEAR_M, 0.0)), picture)
    assert near < 0.1
    assert far > 2
    near, far = halves_rms(Straightener(window, StreamView(FAR_M, 0.0)), picture)
    assert near > 2
    assert far < 0.1


@pytest.mark.parametrize("shape", [(H, W), (H // 2, W // 2), (2 * H, 2 * W)])
@pytest.mark.parametrize("view", [VALID, StreamView(None), StreamView(None, 0.5, 0.4)])
def test_every_view_takes_the_nearest_depth(
    window: Calibration, shape: tuple[int, int], view: StreamView
) -> None:
    """The depth image codes its own rows and columns, so that each sampled pixel names its ray."""
    size = np.array([W, H])
    first = VALID.undistorter(window, np.zeros((H, W), np.float32))
    width, height = view.size(window)
    present = view.undistorter(window, np.zeros((height, width), np.float32))
    rows, columns = np.indices(shape)
    sampled = sample_depths((1 + columns + 10_000 * rows).astype(np.float32), first, present)
    assert sampled.shape == (height, width)
    has_depth = sampled > 0
    column, row = np.divmod(sampled[has_depth] - 1, 10_000)[::-1]
    scale = size / shape[::-1]
    at_first = (np.column_stack([column, row]) + 0.5) * scale - 0.5
    pixels = np.argwhere(has_depth)[:, ::-1]
    ours = np.linalg.inv(present.camera_matrix) @ np.column_stack([pixels, np.ones(len(pixels))]).T
    expected = (first.camera_matrix @ ours)[:2].T
    assert (np.abs(at_first - expected) <= scale / 2 + 1e-6).all()
    assert has_depth.all() == (view == VALID)


def wait_for_maps(straightener: Straightener, picture: np.ndarray) -> np.ndarray:
    """Return the straight picture of the file as it is now."""
    straightener.straighten(picture)
    straightener.wait()
    return straightener.straighten(picture).copy()


def test_a_replaced_file_is_followed(
    window: Calibration, picture: np.ndarray, tmp_path: Path
) -> None:
    path = write_depths(tmp_path / "depth.npy", np.full((H, W), NEAR_M, np.float32))
    straightener = follow(window, path)
    for depth in (FAR_M, NEAR_M):
        write_depths(path, np.full((H, W), depth, np.float32))
        straight = wait_for_maps(straightener, picture)
        depths = np.full((H, W), depth, np.float32)
        expected = VALID.undistorter(window, depths).undistort(picture)
        np.testing.assert_array_equal(straight, expected)
    assert straightener.depth_images == 3
    wait_for_maps(straightener, picture)
    assert straightener.depth_images == 3


def test_unknown_depths_are_black_or_get_the_depth_of_the_view(
    window: Calibration, picture: np.ndarray, tmp_path: Path
) -> None:
    depths = two_planes(window)
    depths[:60] = 0
    depths[60:80] = np.nan
    depths[80:100] = 0.05  # nearer than the smallest depth that counts
    path = write_depths(tmp_path / "depth.npy", depths)
    straightener = follow(window, path)
    assert not straightener.straighten(picture)[:100].any()
    straightener.change({"depth": FAR_M})
    straightener.wait()
    depths[:100] = FAR_M
    expected = VALID.undistorter(window, depths).undistort(picture)
    np.testing.assert_array_equal(straightener.straighten(picture), expected)
    assert straightener.describe_depth() == "straight by the depth image, where unknown at 0.8 m"
    straightener.change({"depth": 0.05})
    straightener.wait()
    assert straightener.problem.startswith("depth is 0.05, nearer than the smallest depth")
    straightener.change({"depth": None})
    straightener.wait()
    assert not straightener.straighten(picture)[:100].any()


def test_a_depth_image_without_any_depth_is_told_once(
    window: Calibration, picture: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "depth.npy"
    remarks = Remarks()
    known = two_planes(window)
    straightener = follow(window, write_depths(path, known), remarks=remarks)
    assert straightener.describe_black() == ""
    for depths in (np.zeros_like(known), np.full_like(known, np.nan), known, 0.01 * known):
        write_depths(path, depths)
        wait_for_maps(straightener, picture)
    black = f"{path} has no depth of 0.1 m or more, so the pictures are black: "
    assert [sentence.startswith(black) for sentence in remarks.sentences] == [True, True]
    assert straightener.describe_black().startswith(black)


def test_a_damaged_or_missing_file_is_reported_once_and_the_last_depths_stay(
    window: Calibration,
    picture: np.ndarray,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(depth_file_module, "PATIENCE_S", 0.0)
    depths = two_planes(window)
    path = write_depths(tmp_path / "depth.png", depths)
    content = path.read_bytes()
    remarks = Remarks()
    straightener = follow(window, path, remarks=remarks)
    straight = straightener.straighten(picture).copy()
    for damage in (lambda: path.write_bytes(content[: len(content) // 2]), path.unlink):
        damage()
        for _ in range(3):
            np.testing.assert_array_equal(wait_for_maps(straightener, picture), straight)
        write_depths(path, depths)
        np.testing.assert_array_equal(wait_for_maps(straightener, picture), straight)
    damaged, back, missing, back_again = remarks.sentences
    assert damaged.startswith(f"{path} is not a depth image: write (height, width)")
    assert damaged.endswith("The stream goes on with the depths that it read last.")
    assert missing.startswith(f"{path} is not there. The stream goes on")
    assert back == back_again == f"{path} is read again."


def test_half_a_file_that_is_soon_complete_is_no_news(window: Calibration, tmp_path: Path) -> None:
    path = write_depths(tmp_path / "depth.npy", two_planes(window))
    picture = np.zeros((H, W), np.uint8)
    remarks = Remarks()
    straightener = follow(window, path, remarks=remarks)
    data = path.read_bytes()
    path.write_bytes(data[:1000])
    wait_for_maps(straightener, picture)
    path.write_bytes(data)
    wait_for_maps(straightener, picture)
    assert straightener.depth_images == 2
    assert not remarks.sentences


def test_a_stream_at_one_depth_has_no_unknown_pixels(calibration: Calibration) -> None:
    straightener = Straightener(calibration, StreamView(0.5))
    with pytest.raises(InputError, match="no depth image: write depth in metres"):
        straightener.change({"depth": None})


def test_the_stream_counts_depth_images(
    window: Calibration, picture: np.ndarray, tmp_path: Path
) -> None:
    """A program replaces the depths after each frame."""
    folder = write_recording(tmp_path, COUNT * [picture])
    path = write_depths(tmp_path / "depth.npy", two_planes(window))
    straightener = follow(window, path)
    album = Album()

    def replace_depths() -> None:
        straightener.wait()
        write_depths(path, np.full((H, W), 0.3 + 0.01 * len(album.pictures), np.float32))

    album.before = replace_depths
    stream = Stream(partial(FolderSource, folder, None), straightener, [album], Remarks())
    assert stream.run() == "source"
    straightener.wait()
    assert straightener.depth_images == COUNT
    assert "depth images" in stream.statistics.line()
    assert stream.statistics.as_json()["depth_images"] in (COUNT - 1, COUNT)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ((), "No depth is given: write --depth 0.8 for one distance in metres, or"),
        (("--depth-image", "none.npy"), "none.npy"),
        (("--depth-image", "wide.npy"), "wide.npy has 200x100 px, and the straight pictures"),
        (("--depth-image", "."), ". is a folder: name one depth image. calib undistort takes"),
        (("--depth-image", "d.npy", "--depth", "0.01"), "start the stream with --near 0.01"),
    ],
)
def test_wrong_depths_are_one_sentence(
    saved: Path,
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("wide.npy", np.ones((100, 200), np.float32))
    np.save("d.npy", np.ones((H, W), np.float32))
    command = ["stream", str(saved), "--source", str(recording), "--to", "http:0"]
    assert main([*command, *options]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("calib: error: ") == 1
