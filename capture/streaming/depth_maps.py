"""Maps of a stream whose pixels have depths of their own, for every view of one depth image."""

import numpy as np
from numpy.typing import NDArray

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.errors import InputError
from capture.streaming.depth_file import DepthFile, DepthImage
from capture.streaming.view import StreamView


class DepthMaps:
    """The depth image belongs to the first view. Other views sample it."""

    def __init__(self, calibration: Calibration, view: StreamView, file: DepthFile) -> None:
        """Read the depth image; InputError if it is not there, or the view is impossible."""
        self._calibration = calibration
        self._file = file
        self._image = file.read(view.size(calibration))
        self._first = self._blank_undistorter(view)
        self._present = view, self._first

    def undistorter(self, view: StreamView) -> Undistorter:
        """Return the undistorter of a view, with the depth image that the file has now: with the
        last one if the file is damaged. InputError if the view is impossible.
        """
        self._read_replaced()
        present, undistorter = self._present
        if (view.crop, view.scale) != (present.crop, present.scale):
            undistorter = self._blank_undistorter(view)
        self._present = view, undistorter
        return undistorter.at(self._depths(view, undistorter))

    def _read_replaced(self) -> None:
        if not self._file.is_replaced():
            return
        try:
            self._image = self._file.read(self._first.size)
        except InputError as error:
            self._file.note_failure(str(error))
        else:
            self._file.note_success()

    def _blank_undistorter(self, view: StreamView) -> Undistorter:
        """Return an undistorter of the view for which every depth is unknown."""
        width, height = view.size(self._calibration)
        unknown = np.zeros((height, width), np.float32)
        return view.undistorter(self._calibration, unknown, self._file.near)

    def _depths(self, view: StreamView, undistorter: Undistorter) -> DepthImage:
        """Return the (height, width) m depths of the view's pixels, 0 where unknown."""
        sampled = sample_depths(self._image, self._first, undistorter)
        if view.depth is None:
            return sampled
        if view.depth < self._file.near:
            raise InputError(
                f"depth is {view.depth:g}, nearer than the smallest depth that counts: start the"
                f" stream with --near {view.depth:g}."
            )
        return np.where(sampled >= self._file.near, sampled, np.float32(view.depth))


def sample_depths(image: DepthImage, first: Undistorter, present: Undistorter) -> DepthImage:
    """Return the depth of each pixel of a straight picture, (height, width) m; 0 where the depth
    image has none.

    Both straight cameras have one centre and one direction, so they share depths. Each pixel takes
    the nearest one: a blend of two depths at an edge is the depth of neither.

    Args:
        image: (h, w) m, in the geometry of the first straight picture.
        first: the undistorter of the first straight picture.
        present: the undistorter of the pictures that need depths.
    """
    rows, has_row = _nearest(1, image.shape[0], first, present)
    columns, has_column = _nearest(0, image.shape[1], first, present)
    if image.shape == (len(rows), len(columns)) and _counts_up(rows) and _counts_up(columns):
        return image
    sampled = image[rows][:, columns]
    sampled[~has_row] = 0
    sampled[:, ~has_column] = 0
    return sampled


def _nearest(
    axis: int, length: int, first: Undistorter, present: Undistorter
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return, for each pixel along an axis (0: x, 1: y) of the present picture, the nearest pixel
    of a depth image of this length, and true where the depth image reaches it.
    """
    pixels = np.arange(present.size[axis])
    slopes = (pixels - present.camera_matrix[axis, 2]) / present.camera_matrix[axis, axis]
    at_first = slopes * first.camera_matrix[axis, axis] + first.camera_matrix[axis, 2]
    nearest = np.rint((at_first + 0.5) * length / first.size[axis] - 0.5).astype(np.intp)
    reached = (nearest >= 0) & (nearest < length)
    return np.clip(nearest, 0, length - 1), reached


def _counts_up(indices: NDArray[np.intp]) -> bool:
    return bool(np.array_equal(indices, np.arange(len(indices))))
