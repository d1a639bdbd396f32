"""The result of a fit: the rays of a camera behind a cover, and all inputs of the fit.

calibration.yaml is for people, and calibration.npz in the same folder holds the arrays. Together
they are enough to fit again.
"""

import math
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from os import PathLike
from pathlib import Path as FilePath
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import yaml
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration_file import (
    CALIBRATION,
    check_arrays,
    check_joint,
    check_stages,
    read_arrays,
    relief_from_yaml,
)
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View, capture_times
from calib.effects.effect import Effect
from calib.effects.serialise import effect_from_yaml, effect_to_yaml
from calib.effects.varying import Varying
from calib.errors import InputError, NotEnoughDataError, brief, harmless, wrong_type
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import priors_of
from calib.fit_record.history import History
from calib.fit_record.outcome import FitOutcome, Uncertainty
from calib.fit_record.record_file import record_from_yaml, record_to_yaml
from calib.fit_record.request import FitRequest
from calib.io.array_arguments import on_finite_rows, pixel_rows, point_rows
from calib.io.arrays import decode_npz
from calib.io.file_set import FileSet, find_current
from calib.io.files import npz, reading
from calib.io.images import session_pictures
from calib.io.numerals import real_number
from calib.io.yaml_reader import read_yaml
from calib.optics.board_target import POSE, VIEW_BLOCKS
from calib.optics.build import covered_path, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.relief import Relief
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics, camera_to_yaml
from calib.session.cover import Cover
from calib.session.cover_section import cover_to_yaml
from calib.session.point_target import PointTarget
from calib.session.session import (
    fit_pictures_command,
    is_media,
    session_from_mapping,
    session_to_yaml,
)
from calib.threads import single_thread
from calib.undistortion.point_field import PointField
from calib.undistortion.ray_field import RayField, ray_field
from calib.version import VERSION

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict

DESCRIBE = "calib.fitting.description:describe"
JUDGE = "calib.verdict.judge:judge"
"""Functions of rooms above this one, which are loaded when a notebook or a program asks for them.
"""
FORMAT = 2
FILES = ("calibration.yaml", "calibration.npz")
DERIVED = ("rays.npz", "map_*m.npz", "report.html")
"""Files in a calibration's folder that are made from it."""
MAX_READS = 2
"""Times that the two files are read: another writer may replace them between the two."""


MIN_FIELD_POINTS = 20_000
"""Number of rays or points from which a field of rays is faster than tracing each."""
TITLES = {
    "pinhole": "camera alone",
    "cover": "smooth cover",
    "cover+rbf": "fitted cover",
    "cover+rbf+effects": "effects found",
}
"""The titles of a fit's stages in reports."""
SAMPLED_CORNERS = 12
"""Corners of each view whose rays are traced when a file is read; all corners of a thousand views
would take a second.
"""
MIN_LANDED_FRACTION = 0.5
"""Fraction of the sampled corners whose rays must reach the view's board. All corners of a fitted
view do, except outliers.
"""


@dataclass(frozen=True, slots=True)
class Stage:
    """The error of the model after one stage of the fit."""

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
    """The camera and cover as the session declares them. Each number has its tolerance, the
    standard deviation of its prior; 0 if the fit held it.
    """

    intrinsics: Intrinsics
    cover: Cover
    doubted: tuple[str, ...] = ()
    """Numbers that the views contradict, by their names in the ray path. The fit widened their
    priors by calib.estimation.prior_conflict.PRIOR_INFLATION.
    """


@dataclass(frozen=True, slots=True, eq=False)
class AddedEffect:
    """An effect that the diagnosis or the user added, with its estimated parameters."""

    effect: Effect
    parameters: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
    """Value and standard deviation by parameter name: arrays of the same shape, in the parameter's
    unit.
    """


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Calibration:
    """A camera, its cover, and the evidence for both."""

    board: Board
    camera: Camera
    """The camera; its intrinsics are never None."""
    cover: Cover
    relief: Relief | None
    amplitudes: NDArray[np.float64]
    """(rows, columns) m, of the relief; (0, 0) without one."""
    exact_hit: bool
    """True if the relief moves the hit point; false if it only bends the normal (the paper)."""
    views: tuple[View, ...]
    """The fitted views."""
    poses: NDArray[np.float64]
    """(V, 6) T_camera_board of each view: rotation vector (rad) and translation (m); (V, 12) if
    boards move during the readout.
    """
    covariance: NDArray[np.float64]
    """(S, S) covariance of `camera_model().parameters`, poses marginalised; (0, 0) if it was not
    estimated.
    """
    rejected: tuple[RejectedPicture, ...]
    stages: tuple[Stage, ...]
    noise_px: float | None
    """Noise of the corners: root mean square of the two-dimensional error, from the short-scale
    residual; None if too few corners tell it.
    """
    gauge: str
    """The convention that fixes the rigid motion which board views do not determine."""
    request: FitRequest = field(default_factory=FitRequest)
    """The request of the fit."""
    outcome: FitOutcome = field(default_factory=FitOutcome)
    """The record of its outcome."""
    history: History = field(default_factory=History)
    """The changes since the fit."""
    effects: tuple[AddedEffect, ...] = ()
    """The effects of the model."""
    stated: Declared | None = None
    """The declared numbers; None if they are those of `camera` and `cover`, all held."""
    refracal: str = VERSION
    """The version of Refracal that made the calibration."""
    corners_at: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) pixel (px) and depth (m) of the training corners, for a calibration that was converted
    to another medium and has no views.
    """

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

    @property
    def observations(self) -> Observations:
        """Return the detected corners of the views, with their capture times."""
        return Observations.of(self.views, self.board).add_times(
            capture_times(self.views), self.camera.height
        )

    @property
    def declared(self) -> Declared:
        """Return the means and standard deviations of the priors with which camera and cover were
        fitted.
        """
        assert self.camera.intrinsics
        return self.stated or Declared(self.camera.intrinsics, self.cover)

    def model(self) -> tuple[Path, dict[str, Tensor]]:
        """Return the ray path and its parameter values, in torch."""
        assert self.camera.intrinsics
        path, values = covered_path(self.camera.intrinsics, self.cover)
        if self.relief:
            path = with_relief(path, self.relief, exact_hit=self.exact_hit)
            values["relief.amplitudes"] = torch.from_numpy(self.amplitudes)
        for added in self.effects:
            path = added.effect.apply(path)
            values |= {
                name: torch.from_numpy(value) for name, (value, _) in added.parameters.items()
            }
        return path, values

    def camera_model(self) -> CameraModel:
        """Return the ray path at the calibration's values, with the priors of all parameters that
        its fit estimated, including those of effects.
        """
        assert self.camera.intrinsics
        path, values = self.model()
        priors = priors_of(self.camera.intrinsics, self.cover, path)
        priors = priors.with_sigmas(
            {
                parameter.param.name: parameter.sigma
                for added in self.effects
                for parameter in added.effect.effect_parameters
            }
        )
        return CameraModel(path, values, priors, tuple(added.effect for added in self.effects))

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
        document = self._as_mapping(self.digest)
        arrays = self._arrays()
        _check_readable(document, arrays)
        files.write("calibration.npz", arrays)
        return files.write(
            "calibration.yaml",
            yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120),
        )

    @property
    def digest(self) -> str:
        """Return the SHA-256 of calibration.npz, which files that are made from it carry."""
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
        if any(view.blur is not None for view in self.views):
            unknown = np.full((self.board.count, 2), math.nan)
            arrays["blurs"] = np.array(
                [unknown if view.blur is None else view.blur for view in self.views]
            )
        if not self.board.has_grid:
            unknown = np.full((self.board.count, 2, 2), math.nan)
            arrays["target"] = self.board.points()
            arrays["point_covariances"] = np.array(
                [unknown if view.covariance is None else view.covariance for view in self.views]
            ).reshape(-1, *unknown.shape)
        if self.corners_at.size:
            arrays["corners_at"] = self.corners_at
        return npz(arrays, compressed=False)  # not compressed: the same bytes on every machine

    def record(self) -> dict[str, Any]:
        """Return the entries of the key `settings` in calibration.yaml."""
        return record_to_yaml(self.request, self.outcome, self.history)

    def _as_mapping(self, digest: str) -> dict[str, object]:
        relief = self.relief and {
            "low": list(self.relief.low),
            "high": list(self.relief.high),
            "grid": list(self.relief.grid),
            "beta": self.relief.beta,
            "exact_hit": self.exact_hit,
            "inset": self.relief.inset,
            **({"anchor": list(self.relief.anchor)} if self.relief.anchor else {}),
        }
        uncertainty = self.outcome.uncertainty
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
            "effects": [effect_to_yaml(added.effect, added.parameters) for added in self.effects],
            "gauge": self.gauge,
            **({} if uncertainty is None else {"uncertainty": asdict(uncertainty)}),
            "settings": self.record(),
            "noise_px": math.nan if self.noise_px is None else self.noise_px,
            "stages": [
                {"name": s.name, "rms_px": s.rms_px, "rmse_cm": s.rmse_cm} for s in self.stages
            ],
            "frames_rejected": [{"file": r.name, "reason": r.reason} for r in self.rejected],
        }

    @staticmethod
    def load(path: str | FilePath) -> "Calibration":
        """Read a calibration.yaml, or the one in a folder, with its calibration.npz."""
        if not isinstance(path, str | PathLike):
            advice = "the path of a calibration's folder or calibration.yaml"
            raise wrong_type("path", path, advice)
        path = FilePath(path)
        with reading(path):
            if is_media(path):
                raise InputError(
                    f"{path} is a picture or a video where a calibration is needed:"
                    f" {fit_pictures_command(path)} makes one."
                )
            path = path / "calibration.yaml" if path.is_dir() else path
            document, arrays = _read_pair(path)
        try:
            return _from_mapping(document, arrays, path)
        except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(
                f"{path} is not a whole calibration ({brief(error)}): fit the session again."
            ) from error


CalibrationSource = Calibration | str | FilePath
"""A calibration, or the path of its file or folder."""


@lru_cache(maxsize=1)
def _verdict_of(calibration: Calibration) -> "Verdict":
    verdict: Verdict = resolve_name(JUDGE)(calibration)
    return verdict


def _check_readable(document: dict[str, Any], arrays: memoryview) -> None:
    """Raise NotEnoughDataError if `load` would refuse the two files."""
    try:
        _from_mapping(document, decode_npz(bytes(arrays)), FilePath("calibration.yaml"))
    except (InputError, ValueError) as error:
        raise NotEnoughDataError(
            "The views leave a number of the camera or cover open, so that no calibration is"
            " written: take more views, tilted, near and far, or hold more numbers with --free"
            f" ({str(error).rstrip('.')})."
        ) from error


def _read_pair(path: FilePath) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the content of calibration.yaml, and the arrays of the .npz written with it."""
    for _ in range(MAX_READS):
        place = find_current(path)
        if not place.is_file():
            raise InputError(f"{path} does not exist: {_where_to_find(path)}.")
        document = read_yaml(place)
        if document.get("format") != FORMAT:
            version = brief(repr(document.get("format")))
            raise InputError(
                f"{path}: format is {version} where this version of calib reads {FORMAT}: fit the"
                " session again."
            )
        arrays, digest = read_arrays(find_current(path.with_suffix(".npz")))
        if document.get("arrays_sha256", digest) == digest:
            return document, arrays
    raise InputError(
        f"{path} and {path.with_suffix('.npz').name} do not belong together: fit the session again."
    )


def _where_to_find(path: FilePath) -> str:
    """Return advice for a calibration.yaml that does not exist."""
    folder = path.parent
    if (folder / "calibration" / path.name).is_file():
        return f"the session's is {folder / 'calibration'}"
    if (folder / "session.yaml").is_file():
        return f"calib fit {shlex.quote(str(folder))} makes it"
    if session_pictures(folder):
        return f"{fit_pictures_command(folder)} makes one of these pictures"
    return "give the folder that calib fit wrote"


def _from_mapping(
    document: dict[str, Any], arrays: dict[str, NDArray[Any]], path: FilePath
) -> Calibration:
    CALIBRATION(document, "")
    target: dict[str, object] = {
        key: document[key] for key in ("board", "target") if key in document
    }
    board, camera, cover = session_from_mapping(
        {**target, "camera": document["camera"], "cover": document["cover"]}, str(path)
    )
    if not board.has_grid:
        pitch = board.pitch if isinstance(board, PointTarget) else None
        board = PointTarget.of(arrays["target"], pitch)
    _, declared, declared_cover = session_from_mapping(
        {
            **target,
            "camera": document["declared"]["camera"],
            "cover": document["declared"]["cover"],
        },
        f"{path}: declared",
    )
    if not (camera.intrinsics and declared.intrinsics):
        raise ValueError("camera.intrinsics is missing")
    relief = None if document["relief"] is None else relief_from_yaml(document["relief"])
    if relief and cover.shape == "none":
        raise ValueError("there is a relief and no cover")
    effects = tuple(AddedEffect(*effect_from_yaml(mapping)) for mapping in document["effects"])
    count = len(arrays["names"])
    if any(len(e.effect.pattern) != count for e in effects if isinstance(e.effect, Varying)):
        raise ValueError("an effect has a pattern that is not of these views")
    check_stages(
        [stage["name"] for stage in document["stages"]],
        has_cover=cover.shape != "none",
        has_views=len(arrays["names"]) > 0,
    )
    request, outcome, history = record_from_yaml(document["settings"])
    if "uncertainty" in document:
        outcome = replace(outcome, uncertainty=Uncertainty(**document["uncertainty"]))
    check_joint(
        outcome.joint,
        has_covariance=arrays["covariance"].size > 0,
        has_relief=relief is not None,
    )
    check_arrays(
        arrays,
        relief,
        board,
        sum(
            VIEW_BLOCKS[block]
            for block in (POSE, *(added.effect.per_view for added in effects))
            if block
        ),
    )
    blurs = arrays.get("blurs", np.full((*arrays["weights"].shape, 2), math.nan))
    covariances = arrays.get("point_covariances", [None] * count)
    calibration = Calibration(
        board=board,
        camera=camera,
        cover=cover,
        relief=relief,
        amplitudes=arrays["amplitudes"],
        exact_hit=bool(document["relief"]["exact_hit"]) if relief else True,
        views=tuple(
            View(
                str(name),
                corners,
                weight,
                None if math.isnan(time_s) else float(time_s),
                str(pose_id) or None,
                covariance=covariance,
                blur=blur if np.isfinite(blur).any() else None,
            )
            for name, corners, weight, time_s, pose_id, covariance, blur in zip(
                *(arrays[key] for key in ("names", "corners", "weights", "times_s", "pose_ids")),
                covariances,
                blurs,
                strict=True,
            )
        ),
        poses=arrays["poses"],
        covariance=arrays["covariance"],
        rejected=tuple(
            RejectedPicture(r["file"], r["reason"]) for r in document["frames_rejected"]
        ),
        stages=tuple(
            Stage(s["name"], float(s["rms_px"]), float(s["rmse_cm"])) for s in document["stages"]
        ),
        noise_px=None if math.isnan(document["noise_px"]) else float(document["noise_px"]),
        gauge=document["gauge"],
        request=request,
        outcome=outcome,
        history=history,
        effects=effects,
        stated=Declared(
            declared.intrinsics,
            declared_cover,
            tuple(map(str, document["declared"].get("doubted", ()))),
        ),
        refracal=document["refracal"],
        corners_at=arrays.get("corners_at", np.zeros((0, 3))),
    )
    if calibration.covariance.size and len(calibration.covariance) != (
        count := calibration.camera_model().parameters.count
    ):
        raise ValueError(
            f"covariance is of {len(calibration.covariance)} parameters where {count} were"
            " estimated"
        )
    _check_views(calibration)
    return calibration


def _check_views(calibration: Calibration) -> None:
    """Raise ValueError if a view has corners or a pose that no fit could have: too few corners for
    a pose, corners outside the picture, or rays that do not reach the board.
    """
    camera, views = calibration.camera, calibration.views
    _, unusable = split_usable_views(views, calibration.board)
    if unusable:
        raise ValueError(f"{unusable[0].name}: {unusable[0].reason}")
    last = np.array([camera.width, camera.height]) - 0.5
    for view in views:
        corners = view.corners[view.seen]
        if ((corners < -0.5) | (corners > last)).any():
            raise ValueError(f"{view.name} has a corner outside the picture")
    if not views:
        return
    observations = calibration.observations
    row = torch.arange(len(observations.view)) - observations.starts[observations.view]
    spacing = (observations.starts.diff()[observations.view] // SAMPLED_CORNERS).clamp(min=1)
    sample = observations.select_rows(row % spacing == 0)
    path, values = calibration.model()
    with single_thread():
        _, failure = path.land(
            sample.pixels,
            values,
            torch.from_numpy(calibration.poses)[sample.view],
            sample.exposure,
        )
    landed = torch.bincount(sample.view[failure == 0], minlength=len(views))
    implausible = landed < MIN_LANDED_FRACTION * sample.starts.diff()
    if implausible.any():
        name = views[int(implausible.int().argmax())].name
        raise ValueError(f"the corners of {name} do not lie on a board at its pose")


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
