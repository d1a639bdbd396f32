"""NumPy's files, decoded from their bytes: a header that says more than is there gets no memory."""

import math
import tokenize
import warnings
import zipfile
import zlib
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_UNPACKED = 4 << 30
"""bytes of a .npz, unpacked."""
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
    """The array of a .npy file; ValueError where it is none, or not all of it."""
    stream = BytesIO(data)
    try:
        with warnings.catch_warnings(action="ignore"):  # of files by Python 2
            version = np.lib.format.read_magic(stream)
            read = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, _, kind = read(stream)
            if math.prod(shape) * kind.itemsize > len(data) - stream.tell():
                raise ValueError(f"an array of shape {shape} is not all there")
            stream.seek(0)
            return np.lib.format.read_array(stream, allow_pickle=False)
    except BAD_HEADER as error:
        raise ValueError(str(error)) from error


def decode_npz(data: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of a .npz file, by their names; ValueError where it is none, or damaged."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as file:
            if sum(member.file_size for member in file.infolist()) > MOST_UNPACKED:
                raise ValueError(f"more than {MOST_UNPACKED >> 30} GB when unpacked")
            return {
                member.filename.removesuffix(".npy"): decode_npy(file.read(member))
                for member in file.infolist()
            }
    except BAD_ZIP as error:
        raise ValueError(str(error)) from error
