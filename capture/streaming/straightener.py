"""Straight pictures by maps that can be replaced while the stream runs.

A change of the view takes a second at most. Until its maps are ready, the stream goes on with the
earlier ones.
"""

import threading
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.errors import InputError, RefracalError
from capture.streaming.view import StreamView


class Straightener:
    def __init__(
        self,
        calibration: Calibration,
        view: StreamView,
        *,
        fixed_size: bool = False,
        tell: Callable[[str], object] = lambda _: None,
    ) -> None:
        """Make the first maps; InputError if the view is impossible.

        Args:
            fixed_size: True if a reader of the stream cannot take pictures of another size.
            tell: gets a sentence if the maps of a later view cannot be made, in their own thread.
        """
        self._calibration = calibration
        self._fixed_size = fixed_size
        self._tell = tell
        self._maps: tuple[StreamView, Undistorter] = view, view.undistorter(calibration)
        self._straight: NDArray[np.uint8] = np.empty(0, np.uint8)
        self.problem = ""
        """The sentence that says why the maps of the last change could not be made."""
        self._lock = threading.Lock()
        self._next: StreamView | None = None
        self._maker: threading.Thread | None = None

    @property
    def view(self) -> StreamView:
        """The view of the present pictures."""
        return self._maps[0]

    @property
    def requested(self) -> StreamView:
        """The view that was asked for last, whose maps may not be ready."""
        return self._next or self.view

    @property
    def size(self) -> tuple[int, int]:
        """The width and height of the present pictures, px."""
        return self._maps[1].size

    def straighten(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the straight picture of a frame. The next call overwrites it.

        Args:
            pixels: (H, W) grey or (H, W, 3) BGR, of the calibrated size.
        """
        undistorter = self._maps[1]
        shape = *undistorter.size[::-1], *pixels.shape[2:]
        if self._straight.shape != shape:
            self._straight = np.empty(shape, np.uint8)
        undistorter.undistort(pixels, self._straight)
        return self._straight

    def change(self, values: Mapping[str, object]) -> None:
        """Replace some numbers of the view, as soon as the maps are ready.

        Changes add up: each is one of the view that was asked for last. InputError if a number is
        impossible, or the size would change and may not.
        """
        with self._lock:
            view = (self._next or self.view).changed(values)
            size = view.size(self._calibration)
            if self._fixed_size and size != self.size:
                raise InputError(
                    "the pictures of this stream keep their size: end it, and start it again with"
                    f" --scale {view.scale:g}."
                )
            if view == self._next or (self._next is None and view == self.view):
                return
            self._next = view
            if self._maker is None:
                self._maker = threading.Thread(target=self._make, name="maps", daemon=True)
                self._maker.start()

    def wait(self) -> None:
        """Wait until the maps of the last change are in use, or could not be made."""
        maker = self._maker
        if maker:
            maker.join()

    def _make(self) -> None:
        while True:
            with self._lock:
                view = self._next
            assert view
            try:
                self._maps = view, self._undistorter(view)
                self.problem = ""
            except RefracalError as error:
                self.problem = str(error)
                self._tell(self.problem)
            with self._lock:
                if view == self._next:
                    self._next = self._maker = None
                    return

    def _undistorter(self, view: StreamView) -> Undistorter:
        present, undistorter = self._maps
        if view.crop is None and view == present.changed({"depth": view.depth}):
            return undistorter.at(view.depth)
        return view.undistorter(self._calibration)
