"""Fit the central camera that is nearest to a covered one at a given depth, for formats without a
cover.

All rays of a central camera meet in one point; those of a covered camera do not. The centre is the
point where they come nearest to meeting, so that the model changes least with depth. Then focal
lengths, principal point and lens are fitted by least squares, over a grid of pixels, to what the
camera sees at the given depth. The axes stay those of the calibration's camera frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError
from calib.estimation.model_choice import simplest_model
from calib.export.formats import OPENCV as OPENCV_LENSES
from calib.export.formats import SPLINED, ExportLens
from calib.export.lens_fit import fit_export_lens, project_slopes
from calib.export.sampled_rays import CHECK_GRID, FIT_GRID, SampledRays
from calib.export.spline_fit import fit_spline, project_spline
from calib.export.windshield_fit import fit_windshield, project_windshield
from calib.optics.build import pinhole_path
from calib.session.cover import Cover
from calib.session.lens import FISHEYE, OPENCV
from calib.threads import single_thread

Array = NDArray[np.float64]

MISFIT_LIMIT = 0.5
"""px: a larger misfit is reported in a sentence."""
MIN_IMPROVEMENT = 0.02
"""Part of the misfit by which a lens with more coefficients must lower it."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """The deviation of the model's pixels from the camera's, over a grid twice as fine as the
    fitted one.
    """

    depth: float
    """m"""
    rms_px: float
    """The root mean square of the two-dimensional distance."""
    worst_px: float
    drift_px: float
    """The largest change, at any pixel, of the two-dimensional error from its value at the fitted
    depth: the error that the depth causes.
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
    """The camera's name in the session; may be empty."""
    lens: ExportLens
    focal: tuple[float, float]
    """px, fx and fy"""
    principal: tuple[float, float]
    """px, cx and cy; (0, 0) is the centre of the top-left pixel."""
    distortion: tuple[float, ...]
    """The lens's coefficients: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, or k1 to k4 of a
    fisheye, or a spline's control points, rows of x and y pairs. A windshield has its lens's
    coefficients and then the polynomials of `windshield_fit`.
    """
    centre: tuple[float, float, float]
    """m, in the calibration's camera frame: the point where the model's rays meet.

    The model's frame has the same axes and this origin.
    """
    misfit_at_half_depth: Misfit
    """At half of the depth for which it was fitted."""
    misfit_at_depth: Misfit
    misfit_at_double_depth: Misfit
    angle_limit: float | None = None
    """rad from the axis, the largest angle at which the model is fitted and checked; None if the
    camera sees nothing beyond it.
    """

    @property
    def misfits(self) -> tuple[Misfit, Misfit, Misfit]:
        """The misfits at half of the depth, at the depth, and at twice the depth."""
        return self.misfit_at_half_depth, self.misfit_at_depth, self.misfit_at_double_depth

    @property
    def matrix(self) -> Array:
        """(3, 3) camera matrix, px."""
        return np.array(
            [
                [self.focal[0], 0, self.principal[0]],
                [0, self.focal[1], self.principal[1]],
                [0, 0, 1.0],
            ]
        )

    @property
    def statement(self) -> list[str]:
        """The lines that tell a reader of the file about the model."""
        x, y, z = 1000 * np.array(self.centre) + 0.0
        return [
            (
                "A central approximation, by Refracal, of a camera behind a cover, fitted at a"
                f" depth of {self.misfit_at_depth.depth:g} m."
            ),
            *(f"Misfit over the image: {misfit}." for misfit in self.misfits),
            (
                f"Its origin is at ({x:.6f}, {y:.6f}, {z:.6f}) mm in the calibration's camera"
                " frame, its axes are parallel to that frame's."
            ),
            *self._limit_sentences(),
        ]

    def commented(self) -> str:
        """Return the statement as comment lines that start with #."""
        return "".join(f"# {line}\n" for line in self.statement)

    def remarks(self) -> Iterator[str]:
        """Yield sentences about the angle beyond which the model does not hold, and about a misfit
        that is too large to be ignored.
        """
        yield from self._limit_sentences()
        fitted = self.misfit_at_depth
        if fitted.worst_px > MISFIT_LIMIT:
            yield (
                f"the camera model is off by up to {fitted.worst_px:.2f} px even at"
                f" {fitted.depth:g} m. Maps have no such error: use those that --format opencv, npz"
                " or stmap writes."
            )
        worst = max(
            (self.misfit_at_half_depth, self.misfit_at_double_depth),
            key=lambda misfit: misfit.drift_px,
        )
        if worst.drift_px > MISFIT_LIMIT:
            yield (
                f"the camera model holds at {fitted.depth:g} m. At {worst.depth:g} m its error"
                f" changes by up to {worst.drift_px:.2f} px, for the distortion depends on the"
                " depth: export one for each depth that you use."
            )

    def _limit_sentences(self) -> Iterator[str]:
        """Yield a sentence on the angle up to which the model holds, if the camera sees more."""
        if self.angle_limit is not None:
            yield (
                f"It holds up to {np.floor(np.degrees(self.angle_limit)):.0f} degrees from the"
                " axis, and the camera sees farther."
            )


def best_central(
    calibration: Calibration, depth: float, lenses: Sequence[ExportLens]
) -> CentralModel:
    """Return the simplest (first) of the models with these lenses whose misfit at `depth` m is
    within 2 % of the smallest.
    """
    with single_thread():
        rays = SampledRays.sample(calibration, FIT_GRID)
        check_rays = SampledRays.sample(calibration, CHECK_GRID)
        models = [_fit(calibration, rays, check_rays, depth, lens) for lens in lenses]
    misfits = {index: model.misfit_at_depth.rms_px for index, model in enumerate(models)}
    return models[simplest_model(misfits, MIN_IMPROVEMENT)]


def remove_cover(calibration: Calibration) -> Calibration:
    """Return the camera without its cover, with the effects that the diagnosis found in the camera
    itself.
    """
    assert calibration.camera.intrinsics
    bare_path, _ = pinhole_path(calibration.camera.intrinsics)
    camera_effects = tuple(
        effect
        for effect in calibration.effects
        if not effect.effect.on_cover and not effect.effect.apply(bare_path).cover
    )
    return replace(
        calibration,
        cover=Cover("none", {}),
        relief=None,
        amplitudes=np.zeros((0, 0)),
        effects=camera_effects,
    )


def _fit(
    calibration: Calibration,
    rays: SampledRays,
    check_rays: SampledRays,
    depth: float,
    lens: ExportLens,
) -> CentralModel:
    camera = calibration.camera
    assert camera.intrinsics
    if not np.isfinite(depth):
        raise InputError(
            "a central camera is fitted at a finite distance: write metres, such as 1000, or export"
            " maps."
        )
    if depth / 2 <= rays.exit_depth:
        raise InputError(
            f"depth {depth:g} m is too near: write {2.1 * rays.exit_depth:.2g} or more, so that"
            " half of it lies beyond the cover."
        )
    k = camera.intrinsics
    coefficients = k.distortion if (k.model != OPENCV) == lens.fisheye else ()
    bare = [number.value for number in (k.fx, k.fy, k.cx, k.cy, *coefficients)]
    plain = lens != SPLINED and not lens.windshield
    is_sufficient = (
        plain
        and k.model == (FISHEYE if lens.fisheye else OPENCV)
        and lens.coefficients >= len(k.distortion)
    )
    path, _ = calibration.model()
    centre = np.zeros(3) if path.central else rays.nearly_intersect()
    if path.central and not path.adjustments and is_sufficient:
        parameters = np.pad(
            bare, (0, 4 + lens.coefficients - len(bare))
        )  # the camera is central already
    elif lens == SPLINED:
        lens, parameters = fit_spline(rays.tangents(depth, centre), rays.pixels, bare)
    elif lens.windshield:
        inner = next(
            candidate for candidate in OPENCV_LENSES[::-1] if candidate.fisheye == lens.fisheye
        )
        bare_model = best_central(remove_cover(calibration), depth, (inner,))
        bare_parameters = np.array(
            [*bare_model.focal, *bare_model.principal, *bare_model.distortion]
        )
        parameters = fit_windshield(
            rays.tangents(depth, centre), rays.pixels, lens, bare_parameters
        )
    else:
        parameters = fit_export_lens(rays.tangents(depth, centre), rays.pixels, bare, lens)
    error = _pixel_errors(lens, parameters, check_rays, depth, centre)
    half_error = _pixel_errors(lens, parameters, check_rays, depth / 2, centre)
    double_error = _pixel_errors(lens, parameters, check_rays, 2 * depth, centre)
    fx, fy, cx, cy, *distortion = parameters.tolist()
    x, y, z = centre.tolist()
    return CentralModel(
        width=camera.width,
        height=camera.height,
        name=camera.model,
        lens=lens,
        focal=(fx, fy),
        principal=(cx, cy),
        distortion=tuple(distortion),
        centre=(x, y, z),
        misfit_at_half_depth=_misfit(depth / 2, half_error, error),
        misfit_at_depth=_misfit(depth, error, error),
        misfit_at_double_depth=_misfit(2 * depth, double_error, error),
        angle_limit=check_rays.angle_limit,
    )


def _pixel_errors(
    lens: ExportLens, parameters: Array, rays: SampledRays, depth: float, centre: Array
) -> Array:
    """Return (N, 2) px, the model's pixels minus the camera's."""
    tangents = rays.tangents(depth, centre)
    if lens.knots:
        pixels = project_spline(lens, parameters, tangents)
    elif lens.windshield:
        pixels = project_windshield(lens, parameters, tangents)
    else:
        pixels = project_slopes(parameters, tangents, lens.fisheye)[0]
    return np.asarray(pixels - rays.pixels)


def _misfit(depth: float, error: Array, fitted_error: Array) -> Misfit:
    """Return the misfit at this depth; `fitted_error` is the error at the fitted depth."""
    length = np.linalg.norm(error, axis=-1)
    drift = np.linalg.norm(error - fitted_error, axis=-1)
    return Misfit(
        depth, float(np.sqrt((length**2).mean())), float(length.max()), float(drift.max())
    )
