"""NumPy's files, decoded from their bytes. Sizes are read from headers before memory is taken."""

import math
import tokenize
import warnings
import zipfile
import zlib
from io import BytesIO
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

MOST_DECODED = 1 << 30
"""Bytes of the pictures or arrays of one file, decoded."""
LONGEST_HEADER = 1 << 16
"""Bytes of an array's header: NumPy itself refuses one of more than 10,000."""
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""The ones that NumPy writes, which zipfile also unpacks piece by piece."""
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
    """Return the array of a .npy file; ValueError where it is none, not all of it, or too large."""
    return _read_npy(BytesIO(data), len(data))


def decode_npz(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file, by their names; ValueError where it is none, is damaged, or
    is too large when unpacked.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as file:
            members = file.infolist()
            if sum(member.file_size for member in members) > MOST_DECODED:
                raise ValueError(f"more than {MOST_DECODED >> 30} GB when unpacked")
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
    """Read the array of a .npy file of `size` bytes. NumPy makes room for the array that the header
    describes, so that is compared with the size first.
    """
    try:
        with warnings.catch_warnings(action="ignore"):  # of files by Python 2
            header = stream.read(min(size, LONGEST_HEADER))
            begin = BytesIO(header)
            version = np.lib.format.read_magic(begin)
            read = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, _, kind = read(begin)
            needed = math.prod(shape) * kind.itemsize
            if needed > size - begin.tell():
                raise ValueError(f"an array of shape {shape} is not all there")
            if needed > MOST_DECODED:
                raise ValueError(f"an array of shape {shape} is larger than 1 GB")
            stream.seek(0)
            return np.lib.format.read_array(stream, allow_pickle=False)
    except BAD_HEADER as error:
        raise ValueError(str(error)) from error
