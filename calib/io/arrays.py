"""Decode NumPy's files from their bytes. Headers are read first, so that no memory is allocated for
an array that is too large.
"""

import math
import tokenize
import warnings
import zipfile
import zlib
from io import BytesIO
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

MAX_DECODED_BYTES = 1 << 30
"""The largest size of the decoded pictures or arrays of one file, bytes."""
MAX_HEADER_BYTES = 1 << 16
"""The largest size of an array's header, bytes: NumPy itself refuses more than 10,000."""
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""The compressions that NumPy writes. zipfile can unpack these piece by piece."""
BAD_HEADER = (
    ValueError,
    EOFError,
    MemoryError,
    OverflowError,
    SyntaxError,
    TypeError,
    RecursionError,
    tokenize.TokenError,
)
BAD_ZIP = (
    *BAD_HEADER,
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    LookupError,
    RuntimeError,
    NotImplementedError,
)


def decode_npy(data: bytes) -> NDArray[Any]:
    """Return the array of a .npy file; ValueError if it is none, is incomplete, or is too large."""
    return _read_npy(BytesIO(data), len(data))


def decode_npz(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file by their names; ValueError if it is none, is damaged, or is
    too large when unpacked.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as file:
            members = file.infolist()
            if sum(member.file_size for member in members) > MAX_DECODED_BYTES:
                raise ValueError(f"more than {MAX_DECODED_BYTES >> 30} GB when unpacked")
            if any(member.compress_type not in COMPRESSIONS for member in members):
                raise ValueError("packed as NumPy packs nothing")
            arrays = {}
            for member in members:
                with file.open(member) as stream:
                    name = member.filename.removesuffix(".npy")
                    arrays[name] = _read_npy(stream, member.file_size)
            return arrays
    except BAD_ZIP as error:
        raise ValueError(str(error)) from error


def _read_npy(stream: IO[bytes], size: int) -> NDArray[Any]:
    """Return the array of a .npy file of `size` bytes. NumPy allocates memory for the array that
    the header describes, so the array's size is compared with the file's size first.
    """
    try:
        with warnings.catch_warnings(action="ignore"):  # for files by Python 2
            header = stream.read(min(size, MAX_HEADER_BYTES))
            stream_start = BytesIO(header)
            version = np.lib.format.read_magic(stream_start)
            read = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, _, dtype = read(stream_start)
            needed = math.prod(shape) * dtype.itemsize
            if needed > size - stream_start.tell():
                raise ValueError(f"an array of shape {shape} is not all there")
            if needed > MAX_DECODED_BYTES:
                raise ValueError(f"an array of shape {shape} is larger than 1 GB")
            stream.seek(0)
            return np.lib.format.read_array(stream, allow_pickle=False)
    except BAD_HEADER as error:
        raise ValueError(str(error)) from error
