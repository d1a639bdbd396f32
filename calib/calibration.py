"""The result: what rays a camera behind a cover sees along, with everything that it was fitted
from.

calibration.yaml is for people, calibration.npz beside it holds the arrays. Together they are enough
to fit again.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import torch
import yaml
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration_file import (
    CALIBRATION,
    check_arrays,
    check_settings,
    check_stages,
    read_arrays,
    relief_from_yaml,
)
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View, capture_times
from calib.effects.effect import Effect
from calib.effects.serialise import effect_from_yaml, effect_to_yaml
from calib.errors import InputError, NotEnoughDataError, brief
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import priors_of
from calib.io.array_arguments import on_finite_rows, pixel_rows, point_rows
from calib.io.arrays import decode_npz
from calib.io.file_set import FileSet, find_current
from calib.io.files import npz, reading
from calib.io.numerals import number
from calib.io.yaml_reader import read_yaml
from calib.optics.board_target import POSE, VIEW_BLOCKS
from calib.optics.build import covered_path, with_relief
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.relief import Relief
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics, camera_to_yaml
from calib.session.cover import Cover, cover_to_yaml
from calib.session.session import session_from_mapping, session_to_yaml
from calib.threads import single_thread
from calib.undistortion.point_field import PointField
from calib.undistortion.ray_field import RayField, ray_field
from calib.version import VERSION

FORMAT = 2
FILES = ("calibration.yaml", "calibration.npz")
DERIVED = ("rays.npz", "map_*m.npz", "report.html")
"""What lies beside a calibration and is made from it."""
LOOKS = 2
"""At the two files: another writer may put a set in force between them."""


MANY = 20_000
"""Rays or points for which it pays to trace a field first."""
TITLES = {
    "pinhole": "camera alone",
    "cover": "smooth cover",
    "cover+rbf": "uneven cover",
    "cover+rbf+effects": "effects found",
}
"""The stages of a fit as people are told them."""
SAMPLED_CORNERS = 12
"""Corners of each view whose rays are traced when a file is read; all corners of a thousand views
would take a second.
"""
FEWEST_LANDED = 0.5
"""Of these, the part that must land on the view's board. A fitted view's corners all do, but for
outliers.
"""


@dataclass(frozen=True, slots=True)
class Stage:
    """How well the model did after one stage of the fit."""

    name: str
    """pinhole, cover, cover+rbf"""
    rms_px: float
    """Root mean square two-dimensional reprojection error."""
    rmse_cm: float
    """Root mean square distance on the board."""

    @property
    def title(self) -> str:
        return TITLES.get(self.name, self.name)


@dataclass(frozen=True, slots=True)
class Declared:
    """What the session says of the camera and its cover, each number with its tolerance: its
    prior's standard deviation; 0 where held.
    """

    intrinsics: Intrinsics
    cover: Cover
    doubted: tuple[str, ...] = ()
    """Numbers that the views contradict, as the ray path calls them: the fit widened their prior by
    calib.estimation.prior_conflict.PRIOR_INFLATION.
    """


@dataclass(frozen=True, slots=True, eq=False)
class AddedEffect:
    """An effect that was added, with its parameters."""

    effect: Effect
    parameters: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
    """By name: the value and its standard deviation, shaped alike, in the number's own unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A camera, its cover, and the evidence for both."""

    board: Board
    camera: Camera
    """With its intrinsics."""
    cover: Cover
    relief: Relief | None
    amplitudes: NDArray[np.float64]
    """(rows, columns) m, of the relief; (0, 0) without one."""
    exact_hit: bool
    """Whether the relief moves the hit point, or only bends the normal as in the paper."""
    views: tuple[View, ...]
    """The views that it was fitted to."""
    poses: NDArray[np.float64]
    """(V, 6) T_camera_board of each view: rotation vector (rad) and translation (m); (V, 12) where
    boards move during the readout.
    """
    covariance: NDArray[np.float64]
    """(S, S) of `camera_model().parameters`, poses marginalised. (0, 0): not estimated."""
    rejected: tuple[RejectedPicture, ...]
    stages: tuple[Stage, ...]
    noise_px: float
    """The corners' noise, root mean square of the two-dimensional error, from the residual's
    short-scale part.
    """
    settings: dict[str, Any]
    """What the fit was asked to do."""
    gauge: str
    """What fixes the rigid motion that board views leave open."""
    effects: tuple[AddedEffect, ...] = ()
    """What the diagnosis added to the model."""
    stated: Declared | None = None
    """None: as `camera` and `cover` are, all held."""
    refracal: str = VERSION
    """The version that made it."""
    corners_at: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) px and m, of a calibration that was put into another medium and has no views: where
    training corners were, and their depth.
    """

    @property
    def observations(self) -> Observations:
        """The seen corners of its views, with when each was seen."""
        return Observations.of(self.views, self.board).add_times(
            capture_times(self.views), self.camera.height
        )

    @property
    def declared(self) -> Declared:
        """The means and standard deviations of the priors that camera and cover were fitted
        with.
        """
        assert self.camera.intrinsics
        return self.stated or Declared(self.camera.intrinsics, self.cover)

    def model(self) -> tuple[Path, dict[str, Tensor]]:
        """The ray path and its parameters, in torch."""
        assert self.camera.intrinsics
        path, values = covered_path(self.camera.intrinsics, self.cover)
        if self.relief:
            path = with_relief(path, self.relief, exact_hit=self.exact_hit)
            values["relief.amplitudes"] = torch.from_numpy(self.amplitudes)
        for found in self.effects:
            path = found.effect.apply(path)
            values |= {
                name: torch.from_numpy(value) for name, (value, _) in found.parameters.items()
            }
        return path, values

    def camera_model(self) -> CameraModel:
        """The ray path at the calibration's values, with the priors of what its fit estimated, the
        effects' parameters among them.
        """
        assert self.camera.intrinsics
        path, values = self.model()
        priors = priors_of(self.camera.intrinsics, self.cover, path)
        priors = priors.with_sigmas(
            {
                unknown.param.name: unknown.sigma
                for found in self.effects
                for unknown in found.effect.effect_parameters
            }
        )
        return CameraModel(path, values, priors, tuple(found.effect for found in self.effects))

    def rays(self, pixels: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The rays along which pixels see; of MANY and more, through the field of rays, to 0.001
        px.

        Args:
            pixels: (N, 2) px; (0, 0) is the centre of the top-left pixel.

        Returns:
            (N, 3) m where each ray leaves the cover and (N, 3) unit where it goes, in the camera
            frame; NaN where none leaves it.
        """
        origins, directions = on_finite_rows(self._rays, pixel_rows(pixels), 3, 3)
        return origins, directions

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) m in the camera frame to the (N, 2) px that see them; NaN for a point that none
        sees. Of MANY and more, those on the picture and next to it go through the field of rays, to
        0.001 px.
        """
        (pixels,) = on_finite_rows(self._pixels, point_rows(points), 2)
        return pixels

    def _rays(self, pixels: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        field = _point_field(self) if len(pixels) >= MANY else None
        if not field:
            return self._traced(pixels)
        origins, directions, held = field.rays(pixels)
        if not held.all():
            origins[~held], directions[~held] = self._traced(pixels[~held])
        return origins, directions

    def _pixels(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64]]:
        path, values = self.model()
        field = None if path.directly_projects or len(points) < MANY else _point_field(self)
        if not field:
            return (project(path, values, torch.from_numpy(points)).numpy(),)
        pixels, held = field.pixels(points)
        if not held.all():
            pixels[~held] = project(path, values, torch.from_numpy(points[~held])).numpy()
        return (pixels,)

    def _traced(
        self, pixels: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        path, values = self.model()
        rays = path.trace(torch.from_numpy(pixels), values)
        lost = (rays.failure != 0).unsqueeze(-1)
        origins, directions = (
            torch.where(lost, torch.nan, v.stacked()).numpy() for v in (rays.origin, rays.direction)
        )
        return origins, directions

    def ray_field(self) -> RayField:
        """The rays of the whole image on a coarse grid: the undistortion of every depth."""
        return _field_of(self)

    def undistort_maps(self, depth: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Maps for cv2.remap that show the scene at `depth` m as the bare pinhole camera would:
        (height, width) each.

        A pixel that the camera does not see through the cover has -1, outside the picture, so
        cv2.remap's constant border fills it.
        """
        made = self.ray_field().map_at(number(depth, "depth"))
        return made.x, made.y

    def save(self, folder: str | FilePath, *, overwrite: bool = False) -> FilePath:
        """Write calibration.yaml and calibration.npz into a folder, and return the first's path.

        They change together; what the folder has of an earlier calibration, its rays, maps and
        report, goes with that.

        Args:
            folder: is made where it does not exist.
            overwrite: replace files of these names that Refracal did not write, or that were
                changed since.

        Raises:
            InputError: such a file is there, and `overwrite` is false; nothing is written then.
            NotEnoughDataError: it has numbers that could not be read back; nothing is written then.
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
        """Add calibration.yaml and calibration.npz to the files of a folder, and return the first's
        path.

        Raises:
            NotEnoughDataError: as `save`.
        """
        said, arrays = self._as_mapping(self.digest), self._arrays()
        _check_readable(said, arrays)
        files.write("calibration.npz", arrays)
        return files.write(
            "calibration.yaml", yaml.safe_dump(said, sort_keys=False, allow_unicode=True, width=120)
        )

    @property
    def digest(self) -> str:
        """SHA-256 of its calibration.npz, which what is made from it carries."""
        return sha256(self._arrays()).hexdigest()

    def _arrays(self) -> memoryview:
        arrays = {
            "amplitudes": self.amplitudes,
            "poses": self.poses,
            "covariance": self.covariance,
            "times_s": np.array(
                [math.nan if view.time_s is None else view.time_s for view in self.views],
                dtype=np.float64,
            ),
            "pose_ids": np.array([view.pose_id or "" for view in self.views], dtype=str),
            "names": np.array([view.name for view in self.views]),
            "corners": (
                np.array([view.corners for view in self.views]).reshape(-1, self.board.count, 2)
            ),
            "weights": np.array([view.weight for view in self.views]).reshape(-1, self.board.count),
        }
        if self.corners_at.size:
            arrays["corners_at"] = self.corners_at
        return npz(
            arrays, compressed=False
        )  # the same bytes wherever it is saved, whatever compresses there

    def _as_mapping(self, digest: str) -> dict[str, object]:
        relief = self.relief and {
            "low": list(self.relief.low),
            "high": list(self.relief.high),
            "grid": list(self.relief.grid),
            "beta": self.relief.beta,
            "exact_hit": self.exact_hit,
        }
        return {
            "format": FORMAT,
            "refracal": self.refracal,
            "arrays_sha256": digest,
            **session_to_yaml(self.board, self.camera, self.cover),
            "declared": {
                "camera": camera_to_yaml(replace(self.camera, intrinsics=self.declared.intrinsics)),
                "cover": cover_to_yaml(self.declared.cover),
                "doubted": list(self.declared.doubted),
            },
            "relief": relief,
            "effects": [effect_to_yaml(found.effect, found.parameters) for found in self.effects],
            "gauge": self.gauge,
            "settings": self.settings,
            "noise_px": self.noise_px,
            "stages": [
                {"name": s.name, "rms_px": s.rms_px, "rmse_cm": s.rmse_cm} for s in self.stages
            ],
            "frames_rejected": [{"file": r.name, "reason": r.reason} for r in self.rejected],
        }

    @staticmethod
    def load(path: str | FilePath) -> "Calibration":
        """Read a calibration.yaml, or the folder that holds one, with the .npz beside it."""
        path = FilePath(path)
        with reading(path):
            path = path / "calibration.yaml" if path.is_dir() else path
            said, arrays = _read_pair(path)
        try:
            return _from_mapping(said, arrays, path)
        except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(
                f"{path} is not a whole calibration ({brief(error)}): fit the session again."
            ) from error


def _check_readable(said: dict[str, Any], arrays: memoryview) -> None:
    """As whoever reads them would."""
    try:
        _from_mapping(said, decode_npz(bytes(arrays)), FilePath("calibration.yaml"))
    except (InputError, ValueError) as error:
        raise NotEnoughDataError(
            "The views leave a number of the camera or cover open, so that no calibration is"
            " written: take more views, tilted, near and far, or hold more numbers with --free"
            f" ({str(error).rstrip('.')})."
        ) from error


def _read_pair(path: FilePath) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What calibration.yaml says, and the arrays of the .npz that was written with it."""
    for _ in range(LOOKS):
        place = find_current(path)
        if not place.is_file():
            within = path.parent / "calibration"
            there = (
                f"the session's is {within}"
                if (within / path.name).is_file()
                else "give the calibration.yaml that calib fit wrote"
            )
            raise InputError(f"{path} does not exist: {there}.")
        said = read_yaml(place)
        if said.get("format") != FORMAT:
            shown = brief(repr(said.get("format")))
            raise InputError(
                f"{path}: format is {shown} where this version of calib reads {FORMAT}: fit the"
                " session again."
            )
        arrays, digest = read_arrays(find_current(path.with_suffix(".npz")))
        if said.get("arrays_sha256", digest) == digest:
            return said, arrays
    raise InputError(
        f"{path} and {path.with_suffix('.npz').name} do not belong together: fit the session again."
    )


def _from_mapping(
    said: dict[str, Any], arrays: dict[str, NDArray[Any]], path: FilePath
) -> Calibration:
    CALIBRATION(said, "")
    board, camera, cover = session_from_mapping(
        {key: said[key] for key in ("board", "camera", "cover")}, str(path)
    )
    _, declared, declared_cover = session_from_mapping(
        {
            "board": said["board"],
            "camera": said["declared"]["camera"],
            "cover": said["declared"]["cover"],
        },
        f"{path}: declared",
    )
    if not (camera.intrinsics and declared.intrinsics):
        raise ValueError("camera.intrinsics is missing")
    relief = None if said["relief"] is None else relief_from_yaml(said["relief"])
    if relief and cover.shape == "none":
        raise ValueError("there is a relief and no cover")
    effects = tuple(AddedEffect(*effect_from_yaml(one)) for one in said["effects"])
    check_stages(
        [stage["name"] for stage in said["stages"]],
        has_cover=cover.shape != "none",
        has_views=len(arrays["names"]) > 0,
    )
    check_settings(
        said["settings"],
        has_covariance=arrays["covariance"].size > 0,
        has_relief=relief is not None,
    )
    check_arrays(
        arrays,
        relief,
        board,
        sum(
            VIEW_BLOCKS[part]
            for part in (POSE, *(added.effect.per_view for added in effects))
            if part
        ),
    )
    read = Calibration(
        board=board,
        camera=camera,
        cover=cover,
        relief=relief,
        amplitudes=arrays["amplitudes"],
        exact_hit=bool(said["relief"]["exact_hit"]) if relief else True,
        views=tuple(
            View(
                str(name),
                corners,
                weight,
                None if math.isnan(time_s) else float(time_s),
                str(pose_id) or None,
            )
            for name, corners, weight, time_s, pose_id in zip(
                *(arrays[key] for key in ("names", "corners", "weights", "times_s", "pose_ids")),
                strict=True,
            )
        ),
        poses=arrays["poses"],
        covariance=arrays["covariance"],
        rejected=tuple(RejectedPicture(r["file"], r["reason"]) for r in said["frames_rejected"]),
        stages=tuple(
            Stage(s["name"], float(s["rms_px"]), float(s["rmse_cm"])) for s in said["stages"]
        ),
        noise_px=float(said["noise_px"]),
        settings=dict(said["settings"]),
        gauge=said["gauge"],
        effects=effects,
        stated=Declared(
            declared.intrinsics,
            declared_cover,
            tuple(map(str, said["declared"].get("doubted", ()))),
        ),
        refracal=said["refracal"],
        corners_at=arrays.get("corners_at", np.zeros((0, 3))),
    )
    if read.covariance.size and len(read.covariance) != (
        count := read.camera_model().parameters.count
    ):
        raise ValueError(
            f"covariance is of {len(read.covariance)} parameters where {count} were estimated"
        )
    _check_views(read)
    return read


def _check_views(calibration: Calibration) -> None:
    """Raise ValueError where a view has corners or a pose that no fit could have: too few corners
    for a pose, corners outside the picture, or rays that do not reach the board.
    """
    camera, views = calibration.camera, calibration.views
    _, unusable = split_usable_views(views, calibration.board)
    if unusable:
        raise ValueError(f"{unusable[0].name}: {unusable[0].reason}")
    last = np.array([camera.width, camera.height]) - 0.5
    for view in views:
        seen = view.corners[view.seen]
        if ((seen < -0.5) | (seen > last)).any():
            raise ValueError(f"{view.name} has a corner outside the picture")
    if not views:
        return
    observations = calibration.observations
    row = torch.arange(len(observations.view)) - observations.starts[observations.view]
    spacing = (observations.starts.diff()[observations.view] // SAMPLED_CORNERS).clamp(min=1)
    some = observations.select_rows(row % spacing == 0)
    path, values = calibration.model()
    with single_thread():
        _, failure = path.land(
            some.pixels, some.with_times(values), torch.from_numpy(calibration.poses)[some.view]
        )
    landed = torch.bincount(some.view[failure == 0], minlength=len(views))
    lost = landed < FEWEST_LANDED * some.starts.diff()
    if lost.any():
        name = views[int(lost.int().argmax())].name
        raise ValueError(f"the corners of {name} do not lie on a board at its pose")


@lru_cache(maxsize=1)  # a command makes maps and a report of one calibration
def _field_of(calibration: Calibration) -> RayField:
    path, values = calibration.model()
    with single_thread():
        return ray_field(path, values, calibration.camera.width, calibration.camera.height)


@lru_cache(maxsize=2)
def _point_field(calibration: Calibration) -> PointField | None:
    """None where no ray leaves the cover."""
    try:
        return PointField.of(
            *calibration.model(), calibration.camera.width, calibration.camera.height
        )
    except InputError:
        return None
