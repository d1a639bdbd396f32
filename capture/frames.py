"""What every camera gives, and every recording that is played back as one: frames, each a picture
with its time and what the camera said.

`Frame` is one of them. `FrameSource` is what the drivers in `capture.sources` look like to all that
reads frames.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from calib.session.shutter import Shutter

# between two frames: from here on, the one says nothing about how fast the board moves in the other
PAUSE_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One exposure, owned by the receiver: no source reuses its buffer."""

    pixels: NDArray[np.uint8]
    """(height, width) grey or (height, width, 3) BGR."""
    sequence: int
    """The driver's counter. A gap means that frames were dropped."""
    time_s: float
    """Monotonic clock, at the start of the exposure or as near to it as the driver says."""
    metadata: Mapping[str, float | str] = field(default_factory=dict)
    """What the camera said of it: exposure_us, gain, lens_position and the like."""
    name: str = ""
    """What the source calls it, if it has names: a recorded picture's file."""
    alone: bool = False
    """A photograph by itself: none of the same stream is known to be less than PAUSE_S away, so
    none shows whether the board moved.
    """

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.pixels.shape[1], self.pixels.shape[0]


class FrameSource(Protocol):
    """Opened by `with`, read by `for`. Entering raises CaptureError if the camera cannot deliver;
    iteration ends when the source is exhausted or `close` is called from any thread; it never
    yields None.
    """

    @property
    def live(self) -> bool:
        """Whether frames come in their own time, and are lost if nobody takes them.

        Otherwise they wait to be read.
        """
        ...

    @property
    def remarks(self) -> Sequence[str]:
        """What a person should know of this camera before trusting its pictures, a sentence each.

        Known once entered.
        """
        ...

    @property
    def shutter(self) -> Shutter | None:
        """Of the sensor that the driver names.

        None: it names none that is known. Known once entered.
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
        """End the iteration, from any thread. What was opened is released on leaving the `with`."""
        ...
