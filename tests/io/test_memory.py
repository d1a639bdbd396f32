"""Small files that would become large in memory: each is refused in a sentence, before memory is
taken for it.
"""

import gzip
import io
import struct
import subprocess
import sys
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.io.arrays import MAX_DECODED_BYTES

MOST_TAKEN = 300 << 20
"""bytes that a process may take in all that refuses such a file; imports alone take 60 MB."""
LOOKING = r"""
import re, sys
from pathlib import Path
from calib.errors import RefracalError
from calib.importing.from_ros import from_ros_archive
from calib.io.arrays import decode_npz
from calib.io.depth_image import read_depth_image
from calib.io.files import read_file
from calib.io.images import read_image
from calib.session.board import Board
for path in map(Path, sys.argv[1:]):
    try:
        match path.suffix:
            case ".npz":
                decode_npz(read_file(path))
            case ".gz":
                list(from_ros_archive(path, Board(6, 5, 0.02), None).frames)
            case ".exr":
                read_depth_image(path)
            case _:
                read_image(path)
        said = "nothing"
    except (RefracalError, ValueError) as error:
        said = error
    # getrusage would count what the process that started this one had taken by then
    status = Path("/proc/self/status").read_text()
    print(1024 * int(re.search(r"VmHWM:\s*(\d+) kB", status)[1]), said)
"""


def look(*paths: Path) -> list[tuple[int, str]]:
    """Return the most memory that a process has taken by the end of each file, bytes, and what it
    says of the file.
    """
    done = subprocess.run(
        [sys.executable, "-c", LOOKING, *map(str, paths)],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [line.partition(" ") for line in done.stdout.splitlines()]
    return [(int(peak), sentence) for peak, _, sentence in lines]


def zeros(size: int) -> bytes:
    """A raw deflate stream of `size` zeros, made from one piece that repeats."""
    piece = 64 << 20
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    repeated = packer.compress(bytes(piece)) + packer.flush(zlib.Z_FULL_FLUSH)
    end = zlib.compressobj(9, zlib.DEFLATED, -15)
    return repeated * (size // piece) + end.compress(bytes(size % piece)) + end.flush()


def zipped(head: bytes, size: int, claimed: int) -> bytes:
    """A .npz with one array, of a header and then zeros, that claims another length."""
    packer = zlib.compressobj(0, zlib.DEFLATED, -15)
    packed = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH) + zeros(size)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as file:
        file.writestr("a.npy", packed)
    data = bytearray(buffer.getvalue())
    start = data.rfind(b"PK\x01\x02")
    for place, value in ((start + 10, 8), (8, 8)):
        struct.pack_into("<H", data, place, value)  # deflated, not stored
    for place in (start + 24, 22):
        struct.pack_into("<I", data, place, claimed)
    return bytes(data)


def npy_header(*shape: int) -> bytes:
    buffer = io.BytesIO()
    described = {"descr": "|u1", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(buffer, described)
    return buffer.getvalue()


def tiff(width: int, height: int, tile: int, data: bytes) -> bytes:
    """Deflated, in one strip or one tile."""
    numbers = {256: width, 257: height, 258: 8, 259: 8, 262: 1, 277: 1}
    place = {322: tile, 323: tile, 324: 8, 325: len(data)} if tile else {273: 8, 279: len(data)}
    entries = b"".join(
        struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted((numbers | place).items())
    )
    count = struct.pack("<H", len(numbers | place))
    return struct.pack("<2sHI", b"II", 42, 8 + len(data)) + data + count + entries + bytes(4)


def png(side: int, data: bytes) -> bytes:
    def chunk(name: bytes, content: bytes) -> bytes:
        crc = struct.pack(">I", zlib.crc32(name + content))
        return struct.pack(">I", len(content)) + name + content + crc

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 16, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", b"x\x9c" + data) + chunk(b"IEND", b"")


def jpeg(side: int) -> bytes:
    """One of another size, whose frame says that it has this one."""
    data = bytearray(cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    struct.pack_into(">HH", data, data.index(b"\xff\xc0") + 5, side, side)
    return bytes(data)


def bmp(side: int) -> bytes:
    data = bytearray(cv2.imencode(".bmp", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    struct.pack_into("<ii", data, 18, side, side)
    return bytes(data)


def exr(side: int) -> bytes:
    channel = b"Z\0" + struct.pack("<iIii", 2, 0, 1, 1) + b"\0"
    box = struct.pack("<iiii", 0, 0, side - 1, side - 1)
    attributes = b"".join(
        name + b"\0" + kind + b"\0" + struct.pack("<I", len(content)) + content
        for name, kind, content in (
            (b"channels", b"chlist", channel),
            (b"dataWindow", b"box2i", box),
        )
    )
    return b"v/1\x01" + struct.pack("<I", 2) + attributes + b"\0"


def header_in_tar() -> bytes:
    """A gzipped tar whose extended header has 4 GB."""
    member = tarfile.TarInfo("x")
    member.type, member.size = tarfile.XHDTYPE, 4 << 30
    packer = zlib.compressobj(0, zlib.DEFLATED, -15)
    head = packer.compress(member.tobuf()) + packer.flush(zlib.Z_FULL_FLUSH)
    start = gzip.compress(b"")[:10]
    return start + head + zeros(4 << 30) + bytes(8)


BOMBS: Mapping[str, tuple[Callable[[], bytes], str]] = {
    "a.npz": (
        lambda: zipped(npy_header(2 << 30), 2 << 30, (2 << 30) + 128),
        "more than 1 GB when unpacked",
    ),
    "liar.npz": (lambda: zipped(npy_header(2 << 30), 2 << 30, 1000), "Bad CRC"),
    "tail.npz": (lambda: zipped(npy_header(10), 2 << 30, 1000), "Bad CRC"),
    "a.npy": (lambda: npy_header(1 << 40), "is not a whole .npy array"),
    "a.png": (lambda: png(30_000, zeros(1 << 30)), "more than 1 GB when decoded"),
    "a.tif": (lambda: tiff(60_000, 60_000, 0, zlib.compress(b"")), "more than 1 GB when decoded"),
    "b.tif": (lambda: tiff(100, 100, 60_000, zlib.compress(b"")), "more than 1 GB when decoded"),
    "a.jpg": (lambda: jpeg(60_000), "more than 1 GB when decoded"),
    "a.bmp": (lambda: bmp(30_000), "more than 1 GB when decoded"),
    "a.exr": (lambda: exr(60_000), "is not a depth image"),
    "a.tar.gz": (header_in_tar, "is not a tar archive"),
}


def test_files_that_would_fill_the_memory_are_refused_early(tmp_path: Path) -> None:
    for name, (made, _) in BOMBS.items():
        (tmp_path / name).write_bytes(made())
        assert (tmp_path / name).stat().st_size < 5 << 20
    answers = look(*(tmp_path / name for name in BOMBS))
    for (name, (_, says)), (peak, sentence) in zip(BOMBS.items(), answers, strict=True):
        assert peak < MOST_TAKEN, f"{name}: {peak >> 20} MB"
        assert says in sentence, f"{name}: {sentence}"


@pytest.mark.slow
def test_the_largest_accepted_file_takes_only_its_own_memory(tmp_path: Path) -> None:
    """Half of the limit: what is read is not held twice."""
    size = MAX_DECODED_BYTES // 2
    head = npy_header(size)
    path = tmp_path / "a.npz"
    path.write_bytes(zipped(head, size, len(head) + size))
    [(peak, sentence)] = look(path)
    assert "CRC" in sentence, "the last check, after all of it was read"
    assert size < peak < size + MOST_TAKEN, f"{peak >> 20} MB"
