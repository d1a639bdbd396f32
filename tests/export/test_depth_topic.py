"""A recording whose pictures are straightened by a topic of depth images."""

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `bags` is not installed")

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.cli import main
from calib.io.bag_picture import message_image
from fixtures.known import known
from fixtures.synthetic import scene
from tests.io.bags import DEPTHS, INFO, INTERVAL_NS, TOPIC, RawPicture, raw, read_bag, write_bag

WIDTH, HEIGHT = 328, 246
SPOTS = np.random.default_rng(0).integers(0, 256, (3, 12, 16, 3), dtype=np.uint8)
PICTURES = [np.asarray(cv2.resize(spots, (WIDTH, HEIGHT)), np.uint8) for spots in SPOTS]
SLOPE = np.linspace(0.3, 0.9, WIDTH, dtype=np.float32)[None]
NEAR_PLANE, FAR_PLANE, RAMP = (
    np.full((HEIGHT, WIDTH), 0.25, np.float32),
    np.full((HEIGHT, WIDTH), 0.8, np.float32),
    np.repeat(SLOPE, HEIGHT, axis=0),
)
Stored = RawPicture | Mapping[str, object]


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return known(scene(3, views=1, grid=(4, 4), amplitude=1e-5), WIDTH, HEIGHT)


@pytest.fixture(scope="module")
def saved(calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(calibration.save(tmp_path_factory.mktemp("calibration")))


def metres(depths: np.ndarray) -> RawPicture:
    return RawPicture(
        "32FC1", depths.shape[1], depths.shape[0], 4 * depths.shape[1], depths.tobytes()
    )


def millimetres(depths: np.ndarray) -> RawPicture:
    return raw("16UC1", np.rint(1000 * depths).astype(np.uint16))


def png_of_millimetres(depths: np.ndarray) -> Mapping[str, object]:
    stored = np.rint(1000 * depths).astype(np.uint16)
    return {"format": "16UC1; png compressed", "data": cv2.imencode(".png", stored)[1].ravel()}


def inverse_depths(depths: np.ndarray) -> Mapping[str, object]:
    """compressedDepth of 32FC1, as compressed_depth_image_transport writes it: a quantised inverse
    depth, factor / depth + offset.
    """
    factor, offset = 6000.0, -1000.0
    stored = np.rint(factor / depths + offset).astype(np.uint16)
    png = cv2.imencode(".png", stored)[1].tobytes()
    data = struct.pack("<iff", 0, factor, offset) + png
    return {"format": "32FC1; compressedDepth png", "data": np.frombuffer(data, np.uint8)}


@pytest.mark.parametrize(
    ("store", "largest_m"),
    [(metres, 0), (millimetres, 5.1e-4), (png_of_millimetres, 5.1e-4), (inverse_depths, 1e-4)],
)
@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_each_picture_is_straight_at_the_depths_nearest_in_time(
    calibration: Calibration,
    saved: Path,
    tmp_path: Path,
    kind: str,
    store: Callable[[np.ndarray], Stored],
    largest_m: float,
) -> None:
    """The depths belong to the pictures' times, though all are recorded later."""
    images = [NEAR_PLANE, RAMP, FAR_PLANE]
    stored = {i * INTERVAL_NS + 1_000_000: store(depths) for i, depths in enumerate(images)}
    source = write_bag(tmp_path / "source", kind, [raw("bgr8", p) for p in PICTURES], depths=stored)
    output = tmp_path / "out" / ("s.bag" if kind == "bag" else "s.mcap")
    command = ["undistort", str(saved), str(source), "--depth-topic", DEPTHS]
    assert main([*command, "-o", str(output)]) == 0
    topics = read_bag(output)
    assert [entry[1] for entry in topics[DEPTHS]] == [e[1] for e in read_bag(source)[DEPTHS]]
    undistorter = Undistorter(calibration, RAMP)
    for picture, depths, (_, _, message) in zip(PICTURES, images, topics[TOPIC], strict=True):
        exact = undistorter.at(depths).undistort(picture).astype(int)
        difference = np.abs(message_image(message).astype(int) - exact)
        assert difference.max() <= (0 if not largest_m else 3), "grey levels"
    for _, _, info in topics[INFO]:
        matrix = info.K if kind == "bag" else info.k
        np.testing.assert_array_equal(matrix.reshape(3, 3), undistorter.camera_matrix)
    ((_, _, static),) = topics["/tf_static"]
    moved = static.transforms[0].transform.translation
    assert (moved.x, moved.y, moved.z) == (0, 0, 0), "depths of all pixels leave no shift"


def test_a_plane_is_as_straight_as_with_one_depth(
    calibration: Calibration, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A depth image that is late for the last picture is named."""
    source = write_bag(
        tmp_path / "s",
        "mcap",
        [raw("bgr8", p) for p in PICTURES],
        depths={-INTERVAL_NS: metres(NEAR_PLANE)},
    )
    command = ["undistort", str(saved), str(source), "--topic", TOPIC]
    assert main([*command, "--depth-topic", DEPTHS, "-o", str(tmp_path / "o.mcap")]) == 0
    assert f"0.3 s from its nearest depth image on {DEPTHS}" in capsys.readouterr().err
    undistorter = Undistorter(calibration, 0.25)
    for picture, (_, _, message) in zip(
        PICTURES, read_bag(tmp_path / "o.mcap")[TOPIC], strict=True
    ):
        exact = undistorter.undistort(picture)
        difference = message_image(message).astype(int) - exact.astype(int)
        assert np.sqrt((difference[5:-5, 5:-5] ** 2).mean()) < 1, "grey levels"


def test_pictures_without_any_depth_are_counted(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unknown = np.full_like(RAMP, np.nan)
    stored = {0: metres(RAMP), INTERVAL_NS: metres(unknown), 2 * INTERVAL_NS: metres(0.1 * RAMP)}
    source = write_bag(tmp_path / "s", "mcap", [raw("bgr8", p) for p in PICTURES], depths=stored)
    command = ["undistort", str(saved), str(source), "--depth-topic", DEPTHS]
    assert main([*command, "-o", str(tmp_path / "o.mcap")]) == 0
    error = capsys.readouterr().err
    assert f"without a depth of 0.1 m or more on {DEPTHS}, the result has 2 black pictures" in error
    levels = [message_image(m).any() for _, _, m in read_bag(tmp_path / "o.mcap")[TOPIC]]
    assert levels == [True, False, False]


@pytest.mark.parametrize(
    ("depths", "sentence"),
    [
        (metres(NEAR_PLANE[::2, ::2]), "depth images of 164x123 px, and the straight pictures"),
        (raw("mono8", PICTURES[0][..., 0]), "the depths have the encoding 'mono8'"),
        ({"format": "jpeg", "data": cv2.imencode(".jpg", PICTURES[0])[1].ravel()}, "PNG of 16"),
    ],
)
def test_depths_that_fit_no_picture_are_one_sentence(
    saved: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    depths: Stored,
    sentence: str,
) -> None:
    source = write_bag(tmp_path / "source", "mcap", [raw("bgr8", PICTURES[0])], depths={0: depths})
    command = ["undistort", str(saved), str(source), "--topic", TOPIC, "--depth-topic", DEPTHS]
    assert main([*command, "-o", str(tmp_path / "out" / "s.mcap")]) == 2
    assert sentence in capsys.readouterr().err
    assert not any((tmp_path / "out").glob("*.mcap"))
