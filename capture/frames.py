"""The frames that every camera gives, and every recording that is played back as one.

A `Frame` is a picture with its time and the camera's metadata. `FrameSource` is the interface of
the drivers in `capture.sources` for all code that reads frames.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from calib.session.shutter import Shutter

# s between two frames: from here on, one frame says nothing about the board's speed in the other
PAUSE_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One exposure, owned by the receiver: no source reuses its buffer."""

    pixels: NDArray[np.uint8]
    """(height, width) grey or (height, width, 3) BGR."""
    sequence: int
    """The driver's counter. A gap means that frames were dropped."""
    time_s: float
    """Monotonic clock, at the start of the exposure or as near to it as the driver reports."""
    metadata: Mapping[str, float | str] = field(default_factory=dict)
    """The camera's metadata: exposure_us, gain, lens_position and the like."""
    name: str = ""
    """The source's name of the frame, such as a recorded picture's file; empty if it has none."""
    isolated: bool = False
    """True for a single photograph: no frame of the same stream is known to be less than PAUSE_S
    away, so none shows whether the board moved.
    """

    @property
    def size(self) -> tuple[int, int]:
        """The width and height, px."""
        return self.pixels.shape[1], self.pixels.shape[0]


class FrameSource(Protocol):
    """A source of frames: open it by `with`, read it by `for`.

    Entering raises CaptureError if the camera cannot deliver. The iteration ends when the source is
    exhausted or any thread calls `close`. It never yields None.
    """

    @property
    def live(self) -> bool:
        """True if frames come in their own time and are lost if nobody takes them.

        False: they wait to be read.
        """
        ...

    @property
    def remarks(self) -> Sequence[str]:
        """Sentences that a person should know before trusting this camera's pictures.

        Known once the source is entered.
        """
        ...

    @property
    def shutter(self) -> Shutter | None:
        """The shutter of the sensor that the driver names.

        None: the driver names no known sensor. Known once the source is entered.
        """
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def __iter__(self) -> Iterator[Frame]: ...

    def close(self) -> None:
        """End the iteration, from any thread. Leaving the `with` releases the device."""
        ...
