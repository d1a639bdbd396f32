"""A calibrated rig, which projects and measures points: the result of a rig's fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path as FilePath
from pkgutil import resolve_name
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from calib.errors import InputError, wrong_type
from calib.io.array_arguments import FARTHEST_PX, numbers, pixel_rows, point_rows
from calib.io.numerals import real_number
from calib.rig.rig_content import Baseline, Mounting, RigContent
from calib.rig.rig_geometry import rig_geometry
from calib.rig.rig_storage import RigFiles, read_rig_content
from calib.rig.triangulation import solve_points
from calib.threads import single_thread

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict

JUDGE = "calib.rig.judge:judge_rig"
CHUNK = 4096
"""The number of points that are triangulated together: their derivatives by all numbers of two
cameras take 0.06 GB.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Rig(RigContent):
    """Several calibrated cameras behind covers, and where they are mounted."""

    @property
    def verdict(self) -> Verdict:
        """Return whether to trust the rig, and why not."""
        verdict: Verdict = resolve_name(JUDGE)(self)
        return verdict

    def mounting(self, name: str) -> Mounting:
        """Return the pose of a camera in the rig, with its standard deviations.

        Raises:
            InputError: the rig has no camera of this name.
        """
        return rig_geometry(self).mounting(self.index(name))

    @property
    def baselines(self) -> tuple[Baseline, ...]:
        """The distances between all pairs of cameras."""
        return rig_geometry(self).baselines

    def project(self, points: ArrayLike) -> dict[str, Array]:
        """Return, for each camera, the (N, 2) px that see (N, 3) m points in the reference's frame;
        NaN for a point that the camera does not see.
        """
        rows = torch.from_numpy(point_rows(points))
        with single_thread():
            return {
                name: camera.project(rows).numpy()
                for name, camera in zip(self.names, rig_geometry(self).cameras, strict=True)
            }

    def triangulate(
        self, pixels: Mapping[str, ArrayLike], noise_px: float = 0.1
    ) -> tuple[Array, Array]:
        """Return the points that some pixels show: those whose projections through lens and glass
        are nearest to the pixels.

        Args:
            pixels: by the names of cameras, (N, 2) px each; NaN where a camera does not see a
                point. At least two must.
            noise_px: the standard deviation of a pixel's coordinate.

        Returns:
            (N, 3) m points in the reference's frame, and their (N, 3, 3) m^2 covariance, from the
            pixels and the calibration. NaN where fewer than two cameras see a point, or their rays
            do not meet. The covariance counts no common motion of all rays (`calib.rig.gauge`), nor
            the tolerance of the board's size. Points share the calibration's part: for lengths, ask
            `distances`.

        Raises:
            InputError: a name or an array is wrong.
        """
        noise = _check_noise(noise_px)
        rows = self._pixel_rows(pixels)
        geometry = rig_geometry(self)
        points, covariances = [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
        with single_thread():
            for part in _chunks(rows):
                result = geometry.triangulate(part)
                errors = geometry.errors_without_gauge(result)
                points.append(result.points)
                covariances.append(noise**2 * result.noise + errors @ errors.swapaxes(1, 2))
        return np.concatenate(points), np.concatenate(covariances)

    def points(self, pixels: Mapping[str, ArrayLike]) -> Array:
        """Return the (N, 3) m points of `triangulate` alone, in a fraction of the time."""
        rows = self._pixel_rows(pixels)
        cameras = rig_geometry(self).cameras
        with single_thread():
            parts = [solve_points(cameras, part) for part in _chunks(rows)]
        return np.concatenate([np.zeros((0, 3)), *parts])

    def distances(
        self, pixels: Mapping[str, ArrayLike], pairs: ArrayLike, noise_px: float = 0.1
    ) -> tuple[Array, Array]:
        """Return the distances between pairs of points that pixels show.

        Args:
            pixels: as in `triangulate`.
            pairs: (M, 2) the indices of two points each.
            noise_px: as in `triangulate`.

        Returns:
            (M,) m, and their (M,) m standard deviations, with the errors that both points share
            through the calibration. NaN where one of the points is not measured.

        Raises:
            InputError: a name or an array is wrong.
        """
        noise = _check_noise(noise_px)
        rows = self._pixel_rows(pixels)
        count = len(rows[0])
        couples = numbers(pairs, (None, 2), "pairs")
        if not ((couples >= 0) & (couples < count) & (couples == np.floor(couples))).all():
            raise InputError(
                f"pairs must hold whole numbers, each from 0 on and less than {count}."
            )
        geometry = rig_geometry(self)
        lengths, sigmas = [np.zeros(0)], [np.zeros(0)]
        with single_thread():
            for first in range(0, len(couples), CHUNK // 2):
                part = couples[first : first + CHUNK // 2].astype(np.intp)
                chosen, places = np.unique(part, return_inverse=True)
                result = geometry.triangulate([camera[chosen] for camera in rows])
                length, sigma = geometry.distances(result, places.reshape(part.shape), noise)
                lengths.append(length)
                sigmas.append(sigma)
        return np.concatenate(lengths), np.concatenate(sigmas)

    def save(self, folder: str | FilePath, *, overwrite: bool = False) -> FilePath:
        """Write rig_calibration.yaml and rig_calibration.npz into a folder, and the calibration of
        each camera into a folder of its name within; return the first one's path.

        Args:
            folder: the folder, which is created if it does not exist.
            overwrite: replace files of these names that Refracal did not write, or that were
                changed since.

        Raises:
            InputError: such a file exists and `overwrite` is false; nothing is written.
        """
        folder = FilePath(folder)
        with RigFiles(folder, self.names, overwrite=overwrite, flag="overwrite=True") as files:
            files.reserve()
            (path, *_) = files.write(self)
            files.commit()
        return path

    @staticmethod
    def of(source: RigCalibrationSource) -> Rig:
        """Return a rig as it is, or read it from its file or its folder.

        Raises:
            WrongTypeError: the source is neither.
        """
        if isinstance(source, Rig):
            return source
        if isinstance(source, str | PathLike):
            return Rig.load(source)
        raise wrong_type("rig", source, "a calib.Rig, or the path of its folder")

    @staticmethod
    def load(path: str | FilePath) -> Rig:
        """Read a rig_calibration.yaml, or the one in a folder, with the calibrations beside it.

        Raises:
            WrongTypeError: the argument is no path.
            InputError: a file is missing or damaged, or they do not belong together.
        """
        content = read_rig_content(path)
        return Rig(**{part.name: getattr(content, part.name) for part in fields(content)})

    def _pixel_rows(self, pixels: Mapping[str, ArrayLike]) -> list[Array]:
        """Return (N, 2) px for each camera of the rig; NaN for one that is not given, and for
        pixels outside of the picture.
        """
        if not isinstance(pixels, Mapping):
            raise wrong_type("pixels", pixels, "a mapping from the names of cameras to (N, 2) px")
        for name in pixels:
            self.index(name)
        rows = {name: pixel_rows(values, f"pixels[{name!r}]") for name, values in pixels.items()}
        sizes = {len(values) for values in rows.values()}
        if len(sizes) != 1:
            raise InputError(
                "pixels has arrays of different lengths: give each camera a row for each point,"
                " NaN where it does not see the point."
            )
        empty = np.full((sizes.pop(), 2), np.nan)
        inside = []
        for name, calibration in self.calibrations.items():
            camera = calibration.camera
            values = rows.get(name, empty)
            last = np.array([camera.width, camera.height]) - 0.5
            with np.errstate(invalid="ignore"):
                is_inside = ((values >= -0.5) & (values <= last)).all(-1, keepdims=True)
            inside.append(np.where(is_inside, values, np.nan))
        return inside


RigCalibrationSource = Rig | str | FilePath
"""A calibrated rig, or the path of its file or folder."""


def _check_noise(noise_px: float) -> float:
    noise = real_number(noise_px, "noise_px")
    if not 0 <= noise < FARTHEST_PX:
        raise InputError(
            f"noise_px is {noise:g}: give the standard deviation of a pixel's coordinate, 0 or"
            " more."
        )
    return noise


def _chunks(rows: Sequence[Array]) -> list[list[Array]]:
    starts = range(0, len(rows[0]), CHUNK)
    return [[camera[start : start + CHUNK] for camera in rows] for start in starts]
