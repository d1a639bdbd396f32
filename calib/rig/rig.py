"""The result of a rig's fit: calibrated cameras, where they are mounted, and their joint
covariance.

rig_calibration.yaml is for people and rig_calibration.npz holds the arrays. Each camera's own
calibration stands beside them, in a folder of the camera's name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import sha256
from os import PathLike
from pathlib import Path as FilePath
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import yaml
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from calib.calibration import DERIVED, Calibration
from calib.calibration_file import read_arrays
from calib.errors import InputError, brief, harmless, wrong_type
from calib.estimation.camera_model import CameraModel
from calib.estimation.covariance import covariance_root
from calib.fitting.corner_range import corner_points
from calib.io.array_arguments import FARTHEST_PX, numbers, pixel_rows, point_rows
from calib.io.file_set import FileSet, find_current
from calib.io.files import npz, reading
from calib.io.numerals import real_number
from calib.io.yaml_reader import read_yaml
from calib.rig.gauge import gauge_motion, mounting_motion, point_motion, ray_motion
from calib.rig.layout import RigLayout
from calib.rig.placements import Indices
from calib.rig.poses import invert_poses, move_points, pose_matrix
from calib.rig.shared_cover import share_cover
from calib.rig.triangulation import (
    PlacedCamera,
    TriangulatedPoints,
    solve_points,
    triangulate_points,
)
from calib.threads import single_thread
from calib.version import VERSION

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict

JUDGE = "calib.rig.judge:judge_rig"
FORMAT = 1
NAME = "rig_calibration.yaml"
ARRAYS = "rig_calibration.npz"
CHUNK = 4096
"""The number of points that are triangulated together: their derivatives by all numbers of two
cameras take 0.06 GB.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RejectedView:
    """A picture of one camera that the rig's fit does not use, and the reason."""

    camera: str
    file: str
    reason: str


@dataclass(frozen=True, slots=True)
class RigRecord:
    """The record of a rig's fit."""

    source: str = ""
    """The path of the rig.yaml."""
    outcome: str = ""
    """A sentence of `calib.estimation.levenberg_marquardt.Outcome`."""
    iterations: int = 0
    """The number of linearisations."""
    scatter: float = 1.0
    """The scatter of the placements about the fit, over that of independent corners; the covariance
    is of placements that scatter so.
    """
    turned: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """For each camera, the views whose corners were renumbered, because the board looks turned
    there.
    """
    rejected: tuple[RejectedView, ...] = ()
    alone_px: Mapping[str, float] = field(default_factory=dict)
    """For each camera, the error of its views in the fit of this camera alone."""


@dataclass(frozen=True, slots=True)
class Mounting:
    """The pose of a camera in the rig."""

    T_camera_reference: Array
    """(4, 4)"""
    sigma: Array
    """(6,) standard deviations of a small rotation (rad) and translation (m) of the camera frame.
    The frames are those of the pinholes, whose directions the views determine less well than those
    of the rays.
    """
    ray_sigma: Array
    """(6,) the same for the rays of this camera against those of the reference, without the motion
    of either camera's rays against its own pinhole.
    """


@dataclass(frozen=True, slots=True)
class Baseline:
    """The distance between the pinholes of two cameras."""

    first: str
    second: str
    metres: float
    sigma: float
    """m"""

    def as_mapping(self) -> dict[str, object]:
        """Return the entry of rig_calibration.yaml and of `--json`."""
        metres = {"value": self.metres, "sigma": self.sigma}
        return {"from": self.first, "to": self.second, "metres": metres}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Rig:
    """Several calibrated cameras behind covers, and where they are mounted."""

    calibrations: Mapping[str, Calibration]
    """The calibration of each camera, in the order of rig.yaml. Their poses are those of the
    placements.
    """
    reference: str
    """The camera whose frame is that of the rig."""
    mountings: Array
    """(C, 6) T_camera_reference: rotation vectors (rad) and translations (m); zero for the
    reference.
    """
    covariance: Array
    """(S, S) covariance of the vector of `RigLayout`: all cameras' parameters and mountings,
    placements marginalised; (0, 0) if it could not be estimated.
    """
    placements: Array
    """(P, 6) T_reference_board."""
    placement_names: tuple[str, ...]
    """P names, each that of its first picture."""
    of_views: Mapping[str, Indices]
    """For each camera, the (V,) placement of each view of its calibration."""
    covers: Mapping[str, str] = field(default_factory=dict)
    """The first camera behind the same cover, by the name of each further camera behind it."""
    record: RigRecord = field(default_factory=RigRecord)
    refracal: str = VERSION
    """The version of Refracal that made it."""

    def __repr__(self) -> str:
        cameras = ", ".join(self.calibrations)
        return harmless(f"<Rig: {cameras}; {len(self.placements)} placements of the board>")

    @property
    def verdict(self) -> Verdict:
        """Return whether to trust the rig, and why not."""
        verdict: Verdict = resolve_name(JUDGE)(self)
        return verdict

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the cameras."""
        return tuple(self.calibrations)

    def mounting(self, name: str) -> Mounting:
        """Return the pose of a camera in the rig, with its standard deviations.

        Raises:
            InputError: the rig has no camera of this name.
        """
        return _geometry(self).mounting(self.index(name))

    @property
    def baselines(self) -> tuple[Baseline, ...]:
        """The distances between all pairs of cameras."""
        geometry = _geometry(self)
        return tuple(
            geometry.baseline(first, second)
            for first in range(len(self.names))
            for second in range(first + 1, len(self.names))
        )

    def project(self, points: ArrayLike) -> dict[str, Array]:
        """Return, for each camera, the (N, 2) px that see (N, 3) m points in the reference's frame;
        NaN for a point that the camera does not see.
        """
        rows = torch.from_numpy(point_rows(points))
        with single_thread():
            return {
                name: camera.project(rows).numpy()
                for name, camera in zip(self.names, _geometry(self).cameras, strict=True)
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
        geometry = _geometry(self)
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
        cameras = _geometry(self).cameras
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
        geometry = _geometry(self)
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
    def load(path: str | FilePath) -> Rig:
        """Read a rig_calibration.yaml, or the one in a folder, with the calibrations beside it.

        Raises:
            WrongTypeError: the argument is no path.
            InputError: a file is missing or damaged, or they do not belong together.
        """
        if not isinstance(path, str | PathLike):
            raise wrong_type("path", path, f"the path of a rig's folder or {NAME}")
        file = FilePath(path)
        with reading(file):
            file = file / NAME if file.is_dir() else file
        if not find_current(file).is_file():
            raise InputError(f"{file} does not exist: give the folder that calib rig fit wrote.")
        document = read_yaml(find_current(file))
        if document.get("format") != FORMAT:
            version = brief(repr(document.get("format")))
            raise InputError(
                f"{file}: format is {version} where this version of calib reads {FORMAT}: fit the"
                " rig again."
            )
        arrays, digest = read_arrays(find_current(file.with_suffix(".npz")))
        try:
            return _from_mapping(document, arrays, digest, file)
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"{file} is not a whole rig ({brief(error)}): fit the rig again."
            ) from error

    def arrays(self) -> memoryview:
        """Return the bytes of rig_calibration.npz."""
        return npz(
            {
                "mountings": self.mountings,
                "covariance": self.covariance,
                "placements": self.placements,
                "placement_names": np.array(self.placement_names, dtype=str),
                **{f"views_{name}": places for name, places in self.of_views.items()},
            },
            compressed=False,
        )

    def as_mapping(self) -> dict[str, object]:
        """Return the content of rig_calibration.yaml."""
        cameras = {}
        for name, calibration in self.calibrations.items():
            mounting = self.mounting(name)
            cameras[name] = {
                "calibration": f"{name}/calibration.yaml",
                "arrays_sha256": calibration.digest,
                "rms_px": calibration.stages[-1].rms_px,
                "rms_alone_px": self.record.alone_px.get(name, calibration.stages[-1].rms_px),
                "views": len(calibration.views),
                "T_camera_reference": mounting.T_camera_reference.tolist(),
                "sigma": mounting.sigma.tolist(),
                "ray_sigma": mounting.ray_sigma.tolist(),
            }
        return {
            "format": FORMAT,
            "refracal": self.refracal,
            "arrays_sha256": sha256(self.arrays()).hexdigest(),
            "reference": self.reference,
            "shared_cover": dict(self.covers),
            "cameras": cameras,
            "baselines": [baseline.as_mapping() for baseline in self.baselines],
            "placements": len(self.placements),
            "source": self.record.source,
            "outcome": self.record.outcome,
            "iterations": self.record.iterations,
            "uncertainty": {
                "method": "placements",
                "placements": len(self.placements),
                "inflation": self.record.scatter,
            },
            "turned": {name: list(views) for name, views in self.record.turned.items()},
            "frames_rejected": [
                {"camera": r.camera, "file": r.file, "reason": r.reason}
                for r in self.record.rejected
            ],
        }

    def index(self, name: str) -> int:
        """Return the place of a camera among the names.

        Raises:
            InputError: the rig has no camera of this name.
        """
        if name not in self.calibrations:
            raise InputError(
                f"The rig has no camera {brief(repr(name))}: its cameras are"
                f" {', '.join(self.calibrations)}."
            )
        return self.names.index(name)

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


class RigFiles:
    """The files of a rig's result: those of the rig, and those of each camera in a folder of its
    name. They are written together: a reader refuses a rig whose cameras are of another fit.
    """

    def __init__(
        self,
        folder: FilePath,
        names: Sequence[str],
        *,
        overwrite: bool,
        inputs: Sequence[FilePath] = (),
        flag: str = "--overwrite",
    ) -> None:
        self.rig = FileSet(folder, overwrite=overwrite, inputs=inputs, flag=flag)
        self.cameras = {
            name: FileSet(folder / name, overwrite=overwrite, inputs=inputs, flag=flag)
            for name in names
        }
        self._stack = ExitStack()

    def __enter__(self) -> RigFiles:
        with ExitStack() as stack:
            for files in (self.rig, *self.cameras.values()):
                stack.enter_context(files)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.close()

    def reserve(self, names: Sequence[str] = ()) -> None:
        """Check that the files may be written, and further ones of the rig's folder."""
        self.rig.reserve([NAME, ARRAYS, *names])
        for files in self.cameras.values():
            files.reserve(["calibration.yaml", "calibration.npz"])

    def write(self, rig: Rig) -> list[FilePath]:
        """Add the files of a rig, and return their future paths, the rig's own first."""
        self.rig.write(ARRAYS, rig.arrays())
        text = yaml.safe_dump(rig.as_mapping(), sort_keys=False, allow_unicode=True, width=120)
        written = [self.rig.write(NAME, text)]
        written += [rig.calibrations[name].write(files) for name, files in self.cameras.items()]
        return written

    def commit(self) -> None:
        """Make the files the current ones."""
        for files in self.cameras.values():
            files.commit(instead_of=DERIVED)
        self.rig.commit(instead_of=("report.html",))


@dataclass(frozen=True, slots=True, eq=False)
class _Geometry:
    """The cameras of a rig with the roots of its covariance."""

    names: tuple[str, ...]
    cameras: tuple[PlacedCamera, ...]
    """A camera behind a shared cover has the mounting of the first camera behind it, in whose frame
    its rays are.
    """
    mountings: Tensor
    """(C, 6) T_camera_reference."""
    mounting_columns: tuple[Indices, ...]
    """For each camera, (6,) the places of its mounting in the vector; (0,) for the reference."""
    root: Array
    """(S, Q) R with R R^T the covariance; Q is 0 without one."""
    gauge: Array
    """(6, S) `gauge_motion`."""
    ray_motions: tuple[Array, ...]
    """For each camera, (6, S) `ray_motion`."""

    def triangulate(self, pixels: Sequence[Array]) -> TriangulatedPoints:
        return triangulate_points(self.cameras, pixels, len(self.root))

    def errors_without_gauge(self, result: TriangulatedPoints) -> Array:
        """Return the (N, 3, Q) m errors of points for each independent error of unit variance."""
        motion = point_motion(result.points) @ self.gauge
        errors: Array = (result.by_numbers - motion) @ self.root
        return errors

    def distances(
        self, result: TriangulatedPoints, pairs: NDArray[np.intp], noise_px: float
    ) -> tuple[Array, Array]:
        """Return the (M,) m distances of (M, 2) pairs of points, and their standard deviations."""
        first, second = pairs[:, 0], pairs[:, 1]
        offset = result.points[second] - result.points[first]
        length = np.linalg.norm(offset, axis=-1)
        apart = (length > 0)[:, None]
        direction = np.where(apart, offset / np.where(apart, length[:, None], 1.0), 3**-0.5)
        direction = np.where(np.isnan(length)[:, None], np.nan, direction)
        by_numbers = result.by_numbers[second] - result.by_numbers[first]
        errors = np.einsum("mi,mis->ms", direction, by_numbers) @ self.root
        noise = np.where(
            (first == second)[:, None, None], 0.0, result.noise[first] + result.noise[second]
        )
        from_pixels = noise_px**2 * np.einsum("mi,mij,mj->m", direction, noise, direction)
        return length, np.sqrt((errors**2).sum(-1) + from_pixels)

    def mounting(self, index: int) -> Mounting:
        camera = self.cameras[index]
        count = len(self.root)
        reference = next(i for i, places in enumerate(self.mounting_columns) if not len(places))
        by_numbers, by_rays = np.zeros((6, count)), np.zeros((6, count))
        if index != reference:
            mounting = self.mountings[index]
            by_numbers[:, self.mounting_columns[index]] = mounting_motion(mounting)
            if len(camera.mounting_columns):
                by_rays[:, camera.mounting_columns] = mounting_motion(camera.mounting)
            to_camera = _adjoint(camera.mounting)
            by_rays += to_camera @ self.ray_motions[reference] - self.ray_motions[index]
        return Mounting(
            pose_matrix(self.mountings[index]), self._sigma(by_numbers), self._sigma(by_rays)
        )

    def baseline(self, first: int, second: int) -> Baseline:
        centres, slopes = [], []
        for index in (first, second):
            matrix = pose_matrix(self.mountings[index])
            columns = self.mounting_columns[index]
            centres.append(-matrix[:3, :3].T @ matrix[:3, 3])
            slope = np.zeros((3, len(self.root)))
            if len(columns):
                # A motion of everything outside by d moves the pinhole by -R^T d.
                motion = mounting_motion(self.mountings[index])
                slope[:, columns] = -matrix[:3, :3].T @ motion[3:]
            slopes.append(slope)
        offset = centres[1] - centres[0]
        length = float(np.linalg.norm(offset))
        direction = offset / max(length, 1e-12)
        sigma = self._sigma((direction @ (slopes[1] - slopes[0]))[None])
        return Baseline(self.names[first], self.names[second], length, float(sigma[0]))

    def _sigma(self, by_numbers: Array) -> Array:
        return np.asarray(np.linalg.norm(by_numbers @ self.root, axis=-1))


@lru_cache(maxsize=4)
def _geometry(rig: Rig) -> _Geometry:
    models = _models(rig.calibrations, rig.reference, rig.covers, rig.mountings)
    layout = RigLayout.of(rig.names, models, rig.reference, rig.covers)
    cameras = tuple(
        PlacedCamera(
            model.path,
            model.means,
            model.parameters,
            layout.columns[index].numpy(),
            torch.from_numpy(rig.mountings[layout.frames[index]]),
            layout.mountings[layout.frames[index]].numpy(),
        )
        for index, model in enumerate(models)
    )
    mountings = torch.from_numpy(rig.mountings)
    mounting_columns = tuple(entries.numpy() for entries in layout.mountings)
    if not rig.covariance.size:
        empty = np.zeros((6, layout.count))
        return _Geometry(
            names=rig.names,
            cameras=cameras,
            mountings=mountings,
            mounting_columns=mounting_columns,
            root=np.zeros((layout.count, 0)),
            gauge=empty,
            ray_motions=(empty,) * len(cameras),
        )
    pixels = [c.observations.pixels.numpy() for c in rig.calibrations.values()]
    points = []
    for index, calibration in enumerate(rig.calibrations.values()):
        in_camera = torch.from_numpy(corner_points(calibration))
        to_reference = invert_poses(mountings[index])
        placed = move_points(cameras[index].mounting, move_points(to_reference, in_camera))
        points.append(placed.numpy())
    with single_thread():
        return _Geometry(
            names=rig.names,
            cameras=cameras,
            mountings=mountings,
            mounting_columns=mounting_columns,
            root=covariance_root(rig.covariance),
            gauge=gauge_motion(cameras, pixels, points, layout.count),
            ray_motions=tuple(
                ray_motion(camera, corners, places, layout.count)
                for camera, corners, places in zip(cameras, pixels, points, strict=True)
            ),
        )


def _models(
    calibrations: Mapping[str, Calibration],
    reference: str,
    covers: Mapping[str, str],
    mountings: Array,
) -> list[CameraModel]:
    """Return the models of the cameras, with the covers that they share."""
    models = {name: calibration.camera_model() for name, calibration in calibrations.items()}
    placed = dict(zip(calibrations, torch.from_numpy(mountings), strict=True))
    for name, first in covers.items():
        frame = "" if first == reference else first
        models[name] = share_cover(name, models[name], frame, models[first], placed)
    return list(models.values())


def placed_cameras(rig: Rig) -> tuple[PlacedCamera, ...]:
    """Return the cameras of a rig as triangulation takes them."""
    return _geometry(rig).cameras


def _adjoint(mounting: Tensor) -> Array:
    """Return the (6, 6) matrix from a small motion in the reference's frame to that in a camera's
    frame.
    """
    matrix = pose_matrix(mounting)
    turn = matrix[:3, :3]
    x, y, z = matrix[:3, 3]
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = turn
    adjoint[3:, 3:] = turn
    adjoint[3:, :3] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
    return adjoint


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


def _from_mapping(
    document: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], digest: str, file: FilePath
) -> Rig:
    cameras = document["cameras"]
    calibrations = {
        name: Calibration.load(file.parent / entry["calibration"])
        for name, entry in cameras.items()
    }
    fits = all(c.digest == cameras[name]["arrays_sha256"] for name, c in calibrations.items())
    if document["arrays_sha256"] != digest or not fits:
        raise InputError(
            f"{file} and the files beside it do not belong together: fit the rig again."
        )
    if document["reference"] not in calibrations:
        raise ValueError("reference is none of the cameras")
    of_views = {name: arrays[f"views_{name}"].astype(np.int64) for name in calibrations}
    placements = arrays["placements"].astype(np.float64)
    for name, places in of_views.items():
        if (
            len(places) != len(calibrations[name].views)
            or not ((places >= 0) & (places < len(placements))).all()
        ):
            raise ValueError(f"the placements of {name} are not those of its views")
    mountings = arrays["mountings"].astype(np.float64)
    if mountings.shape != (len(calibrations), 6):
        raise ValueError("mountings is not of these cameras")
    covers = {str(name): str(first) for name, first in document["shared_cover"].items()}
    models = _models(calibrations, document["reference"], covers, mountings)
    layout = RigLayout.of(tuple(calibrations), models, document["reference"], covers)
    covariance = arrays["covariance"].astype(np.float64)
    if covariance.size and covariance.shape != (layout.count, layout.count):
        raise ValueError(f"covariance is not of {layout.count} numbers")
    return Rig(
        calibrations=calibrations,
        reference=document["reference"],
        mountings=mountings,
        covariance=covariance,
        placements=placements,
        placement_names=tuple(map(str, arrays["placement_names"])),
        of_views=of_views,
        covers=covers,
        record=RigRecord(
            source=str(document["source"]),
            outcome=str(document["outcome"]),
            iterations=int(document["iterations"]),
            scatter=float(document["uncertainty"]["inflation"]),
            turned={name: tuple(map(str, views)) for name, views in document["turned"].items()},
            rejected=tuple(
                RejectedView(str(r["camera"]), str(r["file"]), str(r["reason"]))
                for r in document["frames_rejected"]
            ),
            alone_px={name: float(entry["rms_alone_px"]) for name, entry in cameras.items()},
        ),
        refracal=str(document["refracal"]),
    )
