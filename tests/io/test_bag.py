"""Pictures of ROS messages: each encoding gives the pixels that were recorded, and gets them back;
a recording that cannot be read is refused in one sentence.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `bags` is not installed")

from calib.errors import InputError
from calib.io.bag import open_bag
from calib.io.bag_names import is_bag
from calib.io.bag_picture import ENCODINGS, message_image, with_image
from tests.io.bags import KINDS, TOPIC, RawPicture, jpeg, png, raw, read_bag, write_bag

RNG = np.random.default_rng(3)
GREY = RNG.integers(0, 256, (10, 14), dtype=np.uint8)
COLOUR = RNG.integers(0, 256, (10, 14, 3), dtype=np.uint8)
SMOOTH = np.full((10, 14, 3), (40, 120, 200), np.uint8)
DEEP = RNG.integers(0, 65536, (10, 14), dtype=np.uint16)
ALPHA = np.full((10, 14, 1), 9, np.uint8)


def mosaic(picture: np.ndarray, pattern: str) -> np.ndarray:
    """Return what a sensor with this pattern of colours, rggb or so, sees of a BGR picture."""
    mosaic = np.empty(picture.shape[:2], np.uint8)
    for place, letter in enumerate(pattern):
        row = place // 2
        column = place % 2
        mosaic[row::2, column::2] = picture[row::2, column::2, "bgr".index(letter)]
    return mosaic


def packed(picture: np.ndarray, order: str) -> np.ndarray:
    """Return (H, W, 2) of one BGR colour in the order yuyv or uyvy, BT.601 from 16 to 235."""
    blue, green, red = picture[0, 0].astype(float)
    y = 16 + (65.738 * red + 129.057 * green + 25.064 * blue) / 256
    u = 128 + (-37.945 * red - 74.494 * green + 112.439 * blue) / 256
    v = 128 + (112.439 * red - 94.154 * green - 18.285 * blue) / 256
    values = {"yuyv": (y, u, y, v), "uyvy": (u, y, v, y)}[order]
    pair = np.round(values).astype(np.uint8).reshape(1, 2, 2)
    return np.tile(pair, (picture.shape[0], picture.shape[1] // 2, 1))


CASES: dict[str, tuple[RawPicture, np.ndarray, int]] = {
    "mono8": (raw("mono8", GREY), GREY, 0),
    "8UC1": (raw("8UC1", GREY, 6), GREY, 0),
    "mono16": (raw("mono16", DEEP), DEEP, 0),
    "16UC1": (raw("16UC1", DEEP, 4, big_endian=True), DEEP, 0),
    "bgr8": (raw("bgr8", COLOUR, 2), COLOUR, 0),
    "8UC3": (raw("8UC3", COLOUR), COLOUR, 0),
    "rgb8": (raw("rgb8", COLOUR[..., ::-1]), COLOUR, 0),
    "bgra8": (raw("bgra8", np.dstack([COLOUR, ALPHA])), COLOUR, 0),
    "rgba8": (raw("rgba8", np.dstack([COLOUR[..., ::-1], ALPHA])), COLOUR, 0),
    **{
        f"bayer_{pattern}8": (raw(f"bayer_{pattern}8", mosaic(SMOOTH, pattern)), SMOOTH, 0)
        for pattern in ("rggb", "bggr", "gbrg", "grbg")
    },
    **{
        name: (raw(name, packed(SMOOTH, order)), SMOOTH, 2)  # of rounding to 219 levels
        for name, order in (
            ("yuyv", "yuyv"),
            ("yuv422_yuy2", "yuyv"),
            ("uyvy", "uyvy"),
            ("yuv422", "uyvy"),
        )
    },
}
"""For each encoding the recorded picture, its pixels, and by how much these may differ."""


def test_every_encoding_has_a_case() -> None:
    assert CASES.keys() == ENCODINGS.keys()


@pytest.mark.parametrize("encoding", CASES)
def test_an_encoding_gives_its_pixels_and_gets_them_back(tmp_path: Path, encoding: str) -> None:
    picture, pixels, tolerance = CASES[encoding]
    bag = write_bag(tmp_path / "b", "mcap", [picture])
    message = read_bag(bag)[TOPIC][0][2]
    image = message_image(message)
    assert image.dtype == pixels.dtype
    np.testing.assert_allclose(image.astype(int), pixels.astype(int), atol=tolerance)
    reread = with_image(message, image)
    np.testing.assert_array_equal(message_image(reread), image)
    assert reread.encoding == ("bgr8" if encoding[:3] in ("bay", "yuy", "yuv", "uyv") else encoding)


@pytest.mark.parametrize("compress", [jpeg, png])
def test_a_compressed_picture_stays_compressed(tmp_path: Path, compress: object) -> None:
    assert callable(compress)
    bag = write_bag(tmp_path / "b", "mcap", [compress(SMOOTH)])
    message = read_bag(bag)[TOPIC][0][2]
    image = message_image(message)
    np.testing.assert_allclose(image.astype(int), SMOOTH.astype(int), atol=3)
    reread = with_image(message, image)
    assert reread.format == message.format
    assert bytes(reread.data[:2]) == bytes(message.data[:2]), "of the same kind"
    np.testing.assert_allclose(message_image(reread).astype(int), SMOOTH.astype(int), atol=4)


def test_a_short_picture_and_a_strange_encoding_are_refused(tmp_path: Path) -> None:
    short = RawPicture("mono8", 14, 10, 14, bytes(100))
    strange = RawPicture("32FC1", 14, 10, 56, bytes(560))
    messages = read_bag(write_bag(tmp_path / "b", "mcap", [short, strange]))[TOPIC]
    with pytest.raises(InputError, match="has only 100 bytes"):
        message_image(messages[0][2])
    with pytest.raises(InputError, match="encoding '32FC1': convert them to one of mono8"):
        message_image(messages[1][2])


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_recording_is_known_by_its_name(tmp_path: Path, kind: str) -> None:
    bag = write_bag(tmp_path / "b", kind, [raw("mono8", GREY)])
    assert is_bag(bag)
    with open_bag(bag) as opened:
        assert opened.is_ros1 == (kind == "bag")
        assert opened.picture_topic(None).topic == TOPIC
        assert opened.picture_topic(TOPIC).topic == TOPIC
        with pytest.raises(InputError, match=f"no pictures on /other: choose one.*{TOPIC}"):
            opened.picture_topic("/other")
    assert not is_bag(tmp_path)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_damaged_recording_is_one_sentence(tmp_path: Path, kind: str) -> None:
    bag = write_bag(tmp_path / "b", kind, [raw("mono8", GREY)] * 20)
    complete = bag.read_bytes()
    for length in (0, 3, len(complete) // 2):
        bag.write_bytes(complete[:length])
        with (
            pytest.raises(InputError, match="is no recording of ROS, or a damaged one"),
            open_bag(bag) as opened,
        ):
            list(opened.messages([opened.picture_topic(None)]))


def test_a_missing_recording_and_a_missing_package_say_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="is not there"), open_bag(tmp_path / "none.mcap"):
        pass
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with (
        pytest.raises(InputError, match=r"one more package: .* pip install 'rosbags"),
        open_bag(tmp_path / "none.mcap"),
    ):
        pass


def test_the_bayer_patterns_differ() -> None:
    """The negative control of the mosaics: another pattern gives other colours."""
    image = cv2.cvtColor(mosaic(SMOOTH, "rggb"), cv2.COLOR_BayerRG2BGR)
    assert np.abs(image.astype(int) - SMOOTH).max() > 50
