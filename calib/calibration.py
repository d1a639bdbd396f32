"""The result of a fit: the rays of a camera behind a cover, and all inputs of the fit."""

from dataclasses import dataclass, fields
from functools import lru_cache
from hashlib import sha256
from os import PathLike
from pathlib import Path as FilePath
from pkgutil import resolve_name
from typing import TYPE_CHECKING

import numpy as np
import torch
import yaml
from numpy.typing import NDArray

from calib.calibration_content import CalibrationContent
from calib.calibration_file import (
    DERIVED,
    array_bytes,
    calibration_mapping,
    check_readable,
    read_content,
)
from calib.errors import InputError, harmless, wrong_type
from calib.io.array_arguments import on_finite_rows, pixel_rows, point_rows
from calib.io.file_set import FileSet
from calib.io.numerals import real_number
from calib.io.result_names import CALIBRATION_ARRAYS, CALIBRATION_FILE
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.threads import single_thread
from calib.undistortion.point_field import PointField
from calib.undistortion.ray_field import RayField, ray_field

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict

DESCRIBE = "calib.fitting.description:describe"
JUDGE = "calib.verdict.judge:judge"
"""Functions of rooms above this one, which are loaded when a notebook or a program asks for them.
"""
MIN_FIELD_POINTS = 20_000
"""Number of rays or points from which a field of rays is faster than tracing each."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Calibration(CalibrationContent):
    """A camera, its cover, and the evidence for both."""

    @staticmethod
    def of(source: "CalibrationSource") -> "Calibration":
        """Return a calibration as it is, or read it from its file or its folder.

        Raises:
            WrongTypeError: the source is neither.
        """
        if isinstance(source, Calibration):
            return source
        if isinstance(source, str | PathLike):
            return Calibration.load(source)
        advice = "a calib.Calibration, or the path of its folder or calibration.yaml"
        raise wrong_type("calibration", source, advice)

    def __repr__(self) -> str:
        intrinsics = self.camera.intrinsics
        assert intrinsics
        error = f", {self.stages[-1].rms_px:.3f} px" if self.stages else ""
        size = f"{self.camera.width}x{self.camera.height}"
        model = self.camera.model
        name = model if size in model else ", ".join(filter(None, [model, f"{size} px"]))
        cover = "no cover" if self.cover.shape == "none" else self.cover.words
        return harmless(
            f"<Calibration: {name}, lens {intrinsics.model}, fx {intrinsics.fx.value:.1f} px,"
            f" {cover}, {len(self.views)} views{error}>"
        )

    def _repr_html_(self) -> str:
        """Return the table of `calib.describe`, which a notebook shows."""
        return str(resolve_name(DESCRIBE)(self)._repr_html_())

    @property
    def verdict(self) -> "Verdict":
        """Return whether to trust the calibration, and why not (`calib.judge`)."""
        return _verdict_of(self)

    @property
    def K(self) -> NDArray[np.float64]:  # OpenCV's name
        """Return the (3, 3) camera matrix in px, as cv2 takes it. It is that of the undistorted
        pictures.
        """
        k = self.camera.intrinsics
        assert k
        return np.array(
            [[k.fx.value, 0.0, k.cx.value], [0.0, k.fy.value, k.cy.value], [0.0, 0.0, 1.0]]
        )

    @property
    def distortion(self) -> NDArray[np.float64]:
        """Return the (n,) coefficients of the lens alone, without the cover, in the order of cv2
        or, for a fisheye, of cv2.fisheye.
        """
        assert self.camera.intrinsics
        return np.array([number.value for number in self.camera.intrinsics.distortion])

    def rays(self, pixels: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the rays of pixels. From MIN_FIELD_POINTS on, they come from the field of rays,
        which is accurate to 0.001 px.

        Args:
            pixels: (N, 2) px; (0, 0) is the centre of the top-left pixel.

        Returns:
            (N, 3) m origins, where the rays leave the cover, and (N, 3) unit directions, both in
            the camera frame; NaN for a pixel whose ray does not leave the cover.
        """
        origins, directions = on_finite_rows(self._rays, pixel_rows(pixels), 3, 3)
        return origins, directions

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (N, 2) px that see (N, 3) m points in the camera frame; NaN for a point that
        no pixel sees.

        From MIN_FIELD_POINTS on, points in the picture and next to it are projected through the
        field of rays, which is accurate to 0.001 px.
        """
        (pixels,) = on_finite_rows(self._pixels, point_rows(points), 2)
        return pixels

    def _rays(self, pixels: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        field = _point_field(self) if len(pixels) >= MIN_FIELD_POINTS else None
        if not field:
            return self._trace(pixels)
        origins, directions, covered = field.rays(pixels)
        if not covered.all():
            origins[~covered], directions[~covered] = self._trace(pixels[~covered])
        return origins, directions

    def _pixels(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64]]:
        path, values = self.model()
        field = (
            None if path.directly_projects or len(points) < MIN_FIELD_POINTS else _point_field(self)
        )
        if not field:
            return (project(path, values, torch.from_numpy(points), MIDDLE).numpy(),)
        pixels, covered = field.pixels(points)
        if not covered.all():
            remainder = torch.from_numpy(points[~covered])
            pixels[~covered] = project(path, values, remainder, MIDDLE).numpy()
        return (pixels,)

    def _trace(
        self, pixels: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        path, values = self.model()
        rays = path.trace(torch.from_numpy(pixels), values, MIDDLE)
        failed = (rays.failure != 0).unsqueeze(-1)
        origins = torch.where(failed, torch.nan, rays.origin.stacked()).numpy()
        directions = torch.where(failed, torch.nan, rays.direction.stacked()).numpy()
        return origins, directions

    def ray_field(self) -> RayField:
        """Return the rays of the picture on a coarse grid, which give the maps of every depth."""
        return _field_of(self)

    def undistort_maps(self, depth: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the (height, width) maps for cv2.remap that show the scene at `depth` m as the
        bare pinhole camera would.

        A pixel that the camera does not see through the cover is -1, which is outside the picture,
        so cv2.remap's constant border fills it.
        """
        maps = self.ray_field().map_at(real_number(depth, "depth"))
        return maps.x, maps.y

    def save(self, folder: str | FilePath, *, overwrite: bool = False) -> FilePath:
        """Write calibration.yaml and calibration.npz into a folder, and return the former's path.

        Both files change together. The rays, maps and report of an earlier calibration in the
        folder are removed.

        Args:
            folder: the folder, which is created if it does not exist.
            overwrite: replace files of these names that Refracal did not write, or that were
                changed since.

        Raises:
            InputError: such a file exists and `overwrite` is false; nothing is written.
            NotEnoughDataError: a number could not be read back; nothing is written.
        """
        output = FileSet(
            FilePath(folder),
            overwrite=overwrite,
            elsewhere="save into another folder",
            flag="overwrite=True",
        )
        with output as files:
            path = self.write(files)
            files.commit(instead_of=DERIVED)
        return path

    def write(self, files: FileSet) -> FilePath:
        """Add calibration.yaml and calibration.npz to the files of a folder, and return the
        former's path.

        Raises:
            NotEnoughDataError: a number could not be read back; nothing is written.
        """
        document = calibration_mapping(self, self.digest)
        arrays = array_bytes(self)
        check_readable(document, arrays)
        files.write(CALIBRATION_ARRAYS, arrays)
        return files.write(
            CALIBRATION_FILE,
            yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120),
        )

    @property
    def corner_sigma_px(self) -> float:
        """The standard deviation of a corner in x and in y, px, with which the fit weighs it; of a
        fit without one, that of the error that is left.
        """
        joint = self.outcome.joint
        return joint.sigma_px if joint else self.stages[-1].rms_px / 2**0.5

    @property
    def digest(self) -> str:
        """Return the SHA-256 of calibration.npz, which files that are made from it carry."""
        return sha256(array_bytes(self)).hexdigest()

    @staticmethod
    def load(path: str | FilePath) -> "Calibration":
        """Read a calibration.yaml, or the one in a folder, with its calibration.npz.

        Raises:
            WrongTypeError: the argument is no path.
            InputError: a file is missing or damaged, or they do not belong together.
        """
        content = read_content(path)
        return Calibration(**{part.name: getattr(content, part.name) for part in fields(content)})


CalibrationSource = Calibration | str | FilePath
"""A calibration, or the path of its file or folder."""


@lru_cache(maxsize=1)
def _verdict_of(calibration: Calibration) -> "Verdict":
    verdict: Verdict = resolve_name(JUDGE)(calibration)
    return verdict


@lru_cache(maxsize=1)  # a command makes maps and a report of one calibration
def _field_of(calibration: Calibration) -> RayField:
    path, values = calibration.model()
    with single_thread():
        return ray_field(path, values, calibration.camera.width, calibration.camera.height)


@lru_cache(maxsize=2)
def _point_field(calibration: Calibration) -> PointField | None:
    """Return the field, or None if no ray leaves the cover."""
    try:
        return PointField.of(
            *calibration.model(), calibration.camera.width, calibration.camera.height
        )
    except InputError:
        return None
