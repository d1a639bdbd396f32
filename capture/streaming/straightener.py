"""Straight pictures by maps that can be replaced while the stream runs.

A change of the view takes a second at most, and a new depth image some milliseconds. Until its maps
are ready, the stream goes on with the earlier ones.
"""

import threading
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.errors import InputError, RefracalError
from capture.streaming.depth_file import DepthFile
from capture.streaming.depth_maps import DepthMaps
from capture.streaming.view import StreamView


class Straightener:
    def __init__(
        self,
        calibration: Calibration,
        view: StreamView,
        *,
        fixed_size: bool = False,
        depth_file: DepthFile | None = None,
        tell: Callable[[str], object] = lambda _: None,
    ) -> None:
        """Make the first maps; InputError if the view is impossible.

        Args:
            fixed_size: True if a reader of the stream cannot take pictures of another size.
            depth_file: the depths of the pixels; None: all have the depth of the view.
            tell: gets a sentence if the maps of a later view cannot be made, in their own thread.
        """
        self._calibration = calibration
        self._fixed_size = fixed_size
        self._tell = tell
        self.depth_file = depth_file
        self._depth_maps = DepthMaps(calibration, view, depth_file) if depth_file else None
        first = self._depth_maps.undistorter(view) if self._depth_maps else None
        self._maps: tuple[StreamView, Undistorter] = view, first or view.undistorter(calibration)
        self._black = self._is_black()
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

    @property
    def depth_images(self) -> int | None:
        """The number of depth images that were read; None for a stream at one depth."""
        return self.depth_file.images if self.depth_file else None

    def describe_depth(self) -> str:
        """Return words for where the present pictures are straight."""
        depth = self.view.depth
        if not self.depth_file:
            return f"straight at {depth:.3g} m"
        return "straight by the depth image" + (
            "" if depth is None else f", where unknown at {depth:.3g} m"
        )

    def describe_black(self) -> str:
        """Return a sentence if the depth image has no depth, so that all pictures are black; ""
        otherwise.
        """
        if not (self._black and self.depth_file):
            return ""
        return (
            f"{self.depth_file.path} has no depth of {self.depth_file.near:g} m or more, so the"
            " pictures are black: --depth gives unknown pixels a distance."
        )

    def straighten(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the straight picture of a frame. The next call overwrites it.

        Args:
            pixels: (H, W) grey or (H, W, 3) BGR, of the calibrated size.
        """
        self._follow_depths()
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
            if view.depth is None and not self.depth_file:
                raise InputError("this stream has no depth image: write depth in metres.")
            size = view.size(self._calibration)
            if self._fixed_size and size != self.size:
                raise InputError(
                    "the pictures of this stream keep their size: end it, and start it again with"
                    f" --scale {view.scale:g}."
                )
            if view == self._next or (self._next is None and view == self.view):
                return
            self._start_making(view)

    def wait(self) -> None:
        """Wait until the maps of the last change are in use, or could not be made."""
        maker = self._maker
        if maker:
            maker.join()

    def _follow_depths(self) -> None:
        """Begin to make the maps of a depth image that has been replaced."""
        if self._maker is None and self.depth_file and self.depth_file.is_replaced():
            with self._lock:
                self._start_making(self._next or self.view)

    def _start_making(self, view: StreamView) -> None:
        """Make the maps of a view in a thread of their own; the caller has the lock."""
        self._next = view
        if self._maker is None:
            self._maker = threading.Thread(target=self._make, name="maps", daemon=True)
            self._maker.start()

    def _make(self) -> None:
        while True:
            with self._lock:
                view = self._next
            assert view
            try:
                self._maps = view, self._undistorter(view)
                self.problem = ""
                self._note_black()
            except RefracalError as error:
                self.problem = str(error)
                self._tell(self.problem)
            with self._lock:
                if view == self._next:
                    self._next = self._maker = None
                    return

    def _is_black(self) -> bool:
        return self._depth_maps is not None and not self._maps[1].valid.any()

    def _note_black(self) -> None:
        """Say once that pictures have become black."""
        was_black, self._black = self._black, self._is_black()
        if self._black and not was_black:
            self._tell(self.describe_black())

    def _undistorter(self, view: StreamView) -> Undistorter:
        if self._depth_maps:
            return self._depth_maps.undistorter(view)
        present, undistorter = self._maps
        if view.crop is None and view == present.changed({"depth": view.depth}):
            assert view.depth is not None, "a stream at one depth has it"
            return undistorter.at(view.depth)
        return view.undistorter(self._calibration)
