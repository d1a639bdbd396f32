"""The interface of what takes a stream's pictures."""

from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from capture.errors import CaptureError


class TargetError(CaptureError):
    """A target failed, and the stream cannot go on."""


class ReaderGoneError(Exception):
    """The reader of a target has closed it, which is how it ends the stream."""


class StreamTarget(Protocol):
    """A place where the pictures go: opened by `with`, given each picture in turn."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Take a picture, which stays valid until this returns.

        Args:
            picture: (h, w) grey or (h, w, 3) BGR.

        Raises:
            ReaderGoneError: the reader has ended the stream.
            TargetError: the place itself failed.
        """
        ...
