"""Pictures: as stored when whole, refused when not."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.encoded_picture import tiff_pages
from calib.io.images import SUFFIXES, image_size, list_images, read_grey, read_image, stated_size

LOSSLESS = (".png", ".tif", ".tiff", ".bmp", ".npy", ".pnm")


def noise(*shape: int, dtype: type = np.uint8) -> NDArray:
    return np.random.default_rng(3).integers(0, np.iinfo(dtype).max, shape, dtype)


def save(path: Path, pixels: NDArray) -> Path:
    if path.suffix == ".npy":
        np.save(path, pixels)
    else:
        assert cv2.imwrite(str(path), pixels)
    return path


@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)], ids=["grey", "colour"])
@pytest.mark.parametrize("suffix", LOSSLESS)
def test_pixels_come_as_stored(suffix: str, shape: tuple[int, ...], tmp_path: Path) -> None:
    path = save(tmp_path / f"a{suffix}", noise(*shape))
    np.testing.assert_array_equal(read_image(path), noise(*shape))
    assert image_size(path) == (64, 48)
    assert read_grey(path).shape == (48, 64)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".npy", ".pgm"])
def test_sixteen_bits_are_kept(suffix: str, tmp_path: Path) -> None:
    pixels = noise(48, 64, dtype=np.uint16)
    grey = read_grey(save(tmp_path / f"a{suffix}", pixels))
    assert grey.dtype == np.uint16
    np.testing.assert_array_equal(grey, pixels)


def test_foreign_byte_order_and_column_order_become_native(tmp_path: Path) -> None:
    pixels = noise(48, 64, dtype=np.uint16)
    read = read_image(save(tmp_path / "a.npy", np.asfortranarray(pixels.astype(">u2"))))
    assert read.dtype == np.uint16
    assert read.flags.c_contiguous
    np.testing.assert_array_equal(read, pixels)


@pytest.mark.parametrize("pages", [1, 3])
def test_a_tiff_of_several_pages_is_refused(pages: int, tmp_path: Path) -> None:
    path = tmp_path / "a.tiff"
    page = noise(48, 64)
    cv2.imwritemulti(str(path), [page] * pages)
    if pages == 1:
        assert np.array_equal(read_image(path), page)
        return
    for read in (read_image, image_size):
        with pytest.raises(InputError, match=r"a\.tiff has 3 pages: save each page as a picture"):
            read(path)


@pytest.mark.parametrize(
    ("kind", "height", "pages"), [(0, 48, 2), (2, 48, 2), (1, 48, 1), (4, 48, 1), (0, 24, 1)]
)
def test_a_thumbnail_is_no_page(kind: int, height: int, pages: int) -> None:
    """Two directories that point to each other; the second one states its kind, 1 for a picture of
    reduced size, and 4 for a mask.
    """
    size = struct.pack("<HHIIHHII", 256, 4, 1, 64, 257, 4, 1, 48)
    other_size = struct.pack("<HHIIHHII", 256, 4, 1, 64, 257, 4, 1, height)
    first = struct.pack("<H", 2) + size + struct.pack("<I", 8 + 30)
    second = struct.pack("<HHHII", 3, 254, 4, 1, kind) + other_size + struct.pack("<I", 8)
    assert tiff_pages(b"II*\0" + struct.pack("<I", 8) + first + second) == pages


def test_alpha_is_dropped(tmp_path: Path) -> None:
    pixels = noise(48, 64, 4)
    np.testing.assert_array_equal(read_image(save(tmp_path / "a.png", pixels)), pixels[..., :3])


def test_grey_of_colour_weighs_green_most(tmp_path: Path) -> None:
    channels = [
        read_grey(
            save(tmp_path / f"{i}.png", np.full((4, 4, 3), np.eye(3, dtype=np.uint8)[i] * 200))
        )[0, 0]
        for i in range(3)
    ]
    assert channels == [23, 117, 60]  # BT.601: 0.114, 0.587, 0.299


def test_the_header_states_the_size(tmp_path: Path) -> None:
    for suffix in (*SUFFIXES, ".exr"):
        shape = (48, 65) if suffix == ".pgm" else (48, 65, 3)
        pixels = noise(*shape).astype(np.float32) if suffix == ".exr" else noise(*shape)
        if suffix == ".exr" and not cv2.haveImageWriter("a.exr"):
            continue
        path = save(tmp_path / f"a{suffix}", pixels)
        assert stated_size(path, path.read_bytes()) == (65, 48), suffix
    for quality in (50, 101):  # the two kinds of WebP
        data = cv2.imencode(".webp", noise(48, 65, 3), [cv2.IMWRITE_WEBP_QUALITY, quality])[1]
        assert stated_size(tmp_path / "a.webp", data.tobytes()) == (65, 48)


def test_an_anymap_in_numbers_and_with_a_comment(tmp_path: Path) -> None:
    path = tmp_path / "a.pgm"
    path.write_text("P2 # by hand\n3 2\n255\n1 2 3\n4 5 6\n")
    assert read_image(path).tolist() == [[1, 2, 3], [4, 5, 6]]
    path.write_text("P2\n3 2\n255\n1 2 3\n4")
    with pytest.raises(InputError, match="not an image"):
        read_image(path)


@pytest.mark.parametrize("keep", [0.02, 0.5, 0.99])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_truncated_picture_is_refused_in_silence(
    suffix: str, keep: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = save(tmp_path / f"a{suffix}", noise(48, 64, *(() if suffix == ".pgm" else (3,))))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    says = (
        "not a whole .npy array"
        if suffix == ".npy"
        else "not an image"
        if suffix in (".tif", ".tiff")
        else "truncated"
    )
    with pytest.raises(InputError, match=f"a{suffix} is {says}"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_thumbnail_does_not_hide_a_truncated_jpeg(tmp_path: Path) -> None:
    """A thumbnail inside has an end marker of its own; one that counted it would take the half
    picture for a whole one.
    """
    path = save(tmp_path / "a.jpg", noise(48, 64))
    content = path.read_bytes()
    thumbnail = b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content
    path.write_bytes(content[:2] + thumbnail + content[2:])
    assert image_size(path) == (64, 48)
    path.write_bytes(content[:2] + thumbnail + content[2 : len(content) // 2])
    with pytest.raises(InputError, match="truncated"):
        read_image(path)


@pytest.mark.parametrize(
    "trailer", [b"\0" * 100, b"BRCMo\xff\xd8raw data"], ids=["padding", "raw data"]
)
def test_bytes_after_the_end_do_no_harm(trailer: bytes, tmp_path: Path) -> None:
    """Drivers pad their buffers, and a Pi appends its raw data."""
    path = save(tmp_path / "a.jpg", noise(48, 64))
    path.write_bytes(path.read_bytes() + trailer)
    assert image_size(path) == (64, 48)


def test_progressive_jpeg_with_restart_markers_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    assert cv2.imwrite(
        str(path),
        noise(48, 64, 3),
        [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 2],
    )
    assert path.read_bytes().count(b"\xff\xda") > 1, "not progressive"
    assert b"\xff\xd3" in path.read_bytes(), "no restart markers"
    assert image_size(path) == (64, 48)


def test_flipped_bit_in_a_png_is_noticed(tmp_path: Path) -> None:
    path = save(tmp_path / "a.png", noise(48, 64))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        read_image(path)


def test_missing_picture_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.png cannot be read \(No such file"):
        read_image(tmp_path / "a.png")


def test_pictures_are_listed_as_people_count(tmp_path: Path) -> None:
    for name in (
        "f10.png",
        "f2.PNG",
        "f1.jpeg",
        ".f3.png",
        "notes.txt",
        "F3.Tif",
        "f4.npy",
        "f05.bmp",
    ):
        (tmp_path / name).touch()
    (tmp_path / "f6.png").mkdir()
    assert [path.name for path in list_images(tmp_path)] == [
        "f1.jpeg",
        "f2.PNG",
        "F3.Tif",
        "f4.npy",
        "f05.bmp",
        "f10.png",
    ]


def test_listing_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be listed"):
        list_images(tmp_path / "gone")
