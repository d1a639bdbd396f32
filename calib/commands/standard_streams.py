"""The three streams of a process: a closed one, or one that cannot be written, must not end work
that goes on without it.
"""

import io
import os
import sys

STDERR = 2


class _ForgivingFile(io.FileIO):
    """A file that drops what it cannot write: stderr of a terminal that was closed, of a pipe that
    nobody reads, or of a full disk. Progress and remarks are lost, the work goes on.
    """

    def write(self, data: object) -> int:
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError:
            return memoryview(data).nbytes  # type: ignore[arg-type]


def prepare_streams() -> None:
    """Open closed streams to nowhere, and let no failing write to stderr end the program. Streams
    that another program has put in their place stay as they are.
    """
    _fill_closed_streams()
    if sys.stderr is sys.__stderr__ and isinstance(sys.stderr, io.TextIOWrapper):
        original = sys.stderr
        sys.stderr = io.TextIOWrapper(
            io.BufferedWriter(_ForgivingFile(original.fileno(), "wb", closefd=False)),
            encoding=original.encoding,
            errors=original.errors,
            line_buffering=True,
        )


def _fill_closed_streams() -> None:
    """Open the null device in the place of each closed stream: else the next file that is opened
    gets its number, and messages of libraries are written into that file.
    """
    streams = (sys.stdin, sys.stdout, sys.stderr)
    if all(stream is not None for stream in streams):
        return
    while (handle := os.open(os.devnull, os.O_RDWR)) <= STDERR:
        os.set_inheritable(handle, True)
    os.close(handle)
    if sys.stdin is None:
        sys.stdin = open(0, closefd=False)  # noqa: SIM115
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(STDERR, "w", closefd=False)  # noqa: SIM115
