"""The central camera that comes nearest to a covered one at a given depth: what formats without a
cover can say.

All rays of a central camera meet in one point, those of a covered camera do not. The point is
chosen where they come nearest to meeting, which makes the model change least with depth; then focal
lengths, principal point and lens are fitted, by least squares over a grid of pixels, to what the
camera sees at the given depth. The axes stay those of the calibration's camera frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError
from calib.estimation.model_choice import simplest
from calib.export.formats import OPENCV as OPENCV_LENSES
from calib.export.formats import SPLINED, ExportLens
from calib.export.lens_fit import fit_lens, project
from calib.export.sight import CHECKED, FITTED, Sight
from calib.export.spline_fit import fit_spline, project_spline
from calib.export.windshield_fit import fit_windshield, project_windshield
from calib.optics.build import pinhole_path
from calib.session.cover import Cover
from calib.session.lens import FISHEYE, OPENCV
from calib.threads import single_thread

Array = NDArray[np.float64]

LIMIT = 0.5
"""px: a misfit larger than this is worth a sentence."""
WORTH = 0.02
"""Of the misfit: a lens with more coefficients must leave less by more than this."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """How far the model's pixels are from the camera's, over a grid twice as fine as the fitted
    one.
    """

    depth: float
    """m"""
    rms_px: float
    """Root mean square of the two-dimensional distance."""
    worst_px: float
    drift_px: float
    """The largest change, anywhere, of the two-dimensional error from what it is at the fitted
    depth: the depth's own part.
    """

    def __str__(self) -> str:
        return f"{self.rms_px:.4f} px RMS, {self.worst_px:.4f} px at worst, at {self.depth:g} m"


@dataclass(frozen=True, slots=True, eq=False)
class CentralModel:
    """A pinhole with a lens."""

    width: int
    """px"""
    height: int
    """px"""
    name: str
    """The camera's, as the session calls it; may be empty."""
    lens: ExportLens
    focal: tuple[float, float]
    """px, fx and fy"""
    principal: tuple[float, float]
    """px, cx and cy; (0, 0) is the centre of the top-left pixel."""
    distortion: tuple[float, ...]
    """As many as the lens has: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, or k1 to k4 of a
    fisheye, or a spline's control points, rows of x and y pairs; of a windshield, the lens's own
    and then the polynomials of `windshield_fit`.
    """
    centre: tuple[float, float, float]
    """m, in the calibration's camera frame: where the model's rays meet.

    Its own frame has the same axes and this origin.
    """
    half: Misfit
    """At half of the depth that it was fitted for."""
    at: Misfit
    double: Misfit
    limit: float | None = None
    """rad from the axis, up to which it is fitted and checked; None where the camera sees no
    flatter.
    """

    @property
    def matrix(self) -> Array:
        """(3, 3)"""
        return np.array(
            [
                [self.focal[0], 0, self.principal[0]],
                [0, self.focal[1], self.principal[1]],
                [0, 0, 1.0],
            ]
        )

    @property
    def statement(self) -> list[str]:
        """What a reader of the file should know, a line each."""
        x, y, z = (1000 * metres + 0.0 for metres in self.centre)
        return [
            (
                "A central approximation, by Refracal, of a camera behind a cover, fitted at a"
                f" depth of {self.at.depth:g} m."
            ),
            *(f"Misfit over the image: {misfit}." for misfit in (self.half, self.at, self.double)),
            (
                f"Its origin is at ({x:.6f}, {y:.6f}, {z:.6f}) mm in the calibration's camera"
                " frame, its axes are parallel to that frame's."
            ),
            *([] if self.limit is None else [f"{self._limit}."]),
        ]

    @property
    def _limit(self) -> str:
        assert self.limit is not None
        return (
            f"It holds up to {np.floor(np.degrees(self.limit)):.0f} degrees from the axis, and the"
            " camera sees farther"
        )

    def commented(self) -> str:
        """The same as comments of a file in which those begin with #."""
        return "".join(f"# {line}\n" for line in self.statement)

    def remarks(self) -> Iterator[str]:
        """Sentences about a misfit that is too large to pass in silence, and about an angle beyond
        which nothing is said.
        """
        if self.limit is not None:
            yield f"{self._limit}."
        if self.at.worst_px > LIMIT:
            yield (
                f"even at {self.at.depth:g} m the lens {self.lens.name} is wrong by up to"
                f" {self.at.worst_px:.2f} px, {self.at.rms_px:.2f} px RMS: maps (--format npz,"
                " opencv or stmap) have no such error."
            )
        away = max((self.half, self.double), key=lambda misfit: misfit.drift_px)
        if away.drift_px > LIMIT:
            yield (
                "this camera's distortion depends on depth and a central camera's does not: fitted"
                f" at {self.at.depth:g} m, this one goes wrong by up to {away.drift_px:.2f} px more"
                f" or less at {away.depth:g} m: export one for each depth in use."
            )


def best_central(
    calibration: Calibration, depth: float, lenses: Sequence[ExportLens]
) -> CentralModel:
    """Of the models with these lenses, the simplest (first) whose misfit at `depth` m is within 2 %
    of the smallest.
    """
    with single_thread():
        sight, check = (Sight.of(calibration, grid) for grid in (FITTED, CHECKED))
        models = [_fit(calibration, sight, check, depth, lens) for lens in lenses]
    return models[simplest({place: model.at.rms_px for place, model in enumerate(models)}, WORTH)]


def uncovered(calibration: Calibration) -> Calibration:
    """The camera without its cover, with what the diagnosis found of the camera itself."""
    assert calibration.camera.intrinsics
    alone, _ = pinhole_path(calibration.camera.intrinsics)
    own = tuple(
        found
        for found in calibration.effects
        if not found.effect.on_cover and not found.effect.apply(alone).cover
    )
    return replace(
        calibration, cover=Cover("none", {}), relief=None, amplitudes=np.zeros((0, 0)), effects=own
    )


def _fit(
    calibration: Calibration, sight: Sight, check: Sight, depth: float, lens: ExportLens
) -> CentralModel:
    camera = calibration.camera
    assert camera.intrinsics
    if not np.isfinite(depth):
        raise InputError(
            "a central camera is fitted at a distance, and inf is none: write metres, such as 1000,"
            " or export maps."
        )
    if depth / 2 <= sight.beyond:
        raise InputError(
            f"depth {depth:g} m is too near: write {2.1 * sight.beyond:.2g} or more, so that half"
            " of it is beyond the cover."
        )
    k = camera.intrinsics
    own = k.distortion if (k.model != OPENCV) == lens.fisheye else ()
    bare = [number.value for number in (k.fx, k.fy, k.cx, k.cy, *own)]
    plain = lens != SPLINED and not lens.windshield
    same = (
        plain
        and k.model == (FISHEYE if lens.fisheye else OPENCV)
        and lens.coefficients >= len(k.distortion)
    )
    path, _ = calibration.model()
    centre = np.zeros(3) if path.central else sight.nearly_intersect()
    if path.central and not path.adjustments and same:
        parameters = np.pad(bare, (0, 4 + lens.coefficients - len(bare)))  # it is one already
    elif lens == SPLINED:
        lens, parameters = fit_spline(sight.tangents(depth, centre), sight.pixels, bare)
    elif lens.windshield:
        inner = next(one for one in OPENCV_LENSES[::-1] if one.fisheye == lens.fisheye)
        bare_model = best_central(uncovered(calibration), depth, (inner,))
        within = np.array([*bare_model.focal, *bare_model.principal, *bare_model.distortion])
        parameters = fit_windshield(sight.tangents(depth, centre), sight.pixels, lens, within)
    else:
        parameters = fit_lens(sight.tangents(depth, centre), sight.pixels, bare, lens)
    fitted = _off(lens, parameters, check, depth, centre)
    half, at, double = (
        _misfit(distance, _off(lens, parameters, check, distance, centre), fitted)
        for distance in (depth / 2, depth, 2 * depth)
    )
    fx, fy, cx, cy, *distortion = parameters.tolist()
    x, y, z = centre.tolist()
    return CentralModel(
        camera.width,
        camera.height,
        camera.model,
        lens,
        (fx, fy),
        (cx, cy),
        tuple(distortion),
        (x, y, z),
        half,
        at,
        double,
        check.limit,
    )


def _off(lens: ExportLens, parameters: Array, sight: Sight, depth: float, centre: Array) -> Array:
    """(N, 2) px: the model's pixels minus the camera's."""
    tangents = sight.tangents(depth, centre)
    if lens.knots:
        seen = project_spline(lens, parameters, tangents)
    elif lens.windshield:
        seen = project_windshield(lens, parameters, tangents)
    else:
        seen = project(parameters, tangents, lens.fisheye)[0]
    return np.asarray(seen - sight.pixels)


def _misfit(depth: float, off: Array, fitted: Array) -> Misfit:
    length, drift = (np.linalg.norm(part, axis=-1) for part in (off, off - fitted))
    return Misfit(
        depth, float(np.sqrt((length**2).mean())), float(length.max()), float(drift.max())
    )
