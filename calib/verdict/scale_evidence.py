"""The evidence that the views themselves give for depth and length.

Take every ray of a camera as a direction: it has a place in an undistorted picture at infinity. If
that picture grows by one per cent, every length that is measured at a known distance is off by one
per cent, and so is every distance that is measured by a known length. A rigid motion of the camera
turns these places and does not scale them. The relative change of this scale is therefore what a
wrong number costs in depth and length, whatever parameter it hides in.

A declaration is no evidence from the views. Here every declared number is free: by the tolerance of
its kind (calib.session.tolerances), or by its declared standard deviation where that is larger. The
focal length is free by far more, as if nobody had declared it. The scale's uncertainty that then
remains is what the views do not confirm. Numbers that other pictures gave, in bare/ or of a fleet,
keep their own standard deviation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.corners.view import pose_labels
from calib.estimation.covariance import invert_precision, regression
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.joint_fit import UNEVEN_GLASS
from calib.estimation.parameters import Parameters
from calib.estimation.prior_conflict import PRIOR_INFLATION
from calib.estimation.priors import Priors
from calib.estimation.view_equations import ReducedView
from calib.inference.fitted_model import FittedModel
from calib.session.freeing import ALL, free_parameters
from calib.session.numbers import numbers_of, replace_numbers
from calib.session.parameter_names import CAMERA, number_of
from calib.session.schema import Number
from calib.session.tolerances import FOCAL
from calib.verdict.case import averaged_optimum_of

Array = NDArray[np.float64]

SQUARE_PIXELS = 0.003
"""Standard deviation of fx / fy - 1: the median of 31 measured sets is 0.0014 to 0.0028. An error
of a declared focal length is one of both.
"""
SAMPLED = 300
"""Corners at which the scale is taken."""


@dataclass(frozen=True, slots=True)
class Correction:
    """The change of one number that the views ask for, in its SI unit or px."""

    change: float
    sigma: float
    """Standard deviation of the change."""
    scale_change: float
    """The relative change of the scale that the number's change makes by itself."""
    share: float
    """The fraction of the scale's variance that would vanish if its group were known exactly: a
    group is fx and fy, or the components of one list in session.yaml.
    """


@dataclass(frozen=True, slots=True, eq=False)
class ScaleEvidence:
    """The scale of depth and length by the views alone: its uncertainty and the change that they
    ask for.
    """

    sigma: float
    """Relative standard deviation, of the scale across or down the picture, whichever is larger."""
    change: float
    """The relative change that the views ask for; 0 where every number is as they want it."""
    change_sigma: float
    """Standard deviation of that change if every declared number is right: of independent corners,
    or of views that scatter more than these.
    """
    gain: float
    """The fraction by which the change would lower the root mean square error."""
    corrections: Mapping[str, Correction]
    """The change of each declared number, by its name."""


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def scale_evidence(calibration: Calibration) -> ScaleEvidence:
    """Return what a calibration's views say of the scale, from one linearisation at its end."""
    optimum = _freed(calibration)
    parameters, prior = optimum.parameters(), optimum.prior_precision()
    poses = _poses(calibration, [view.reduce() for view in optimum.equations()])
    information = np.zeros_like(prior)
    score, squares = np.zeros(parameters.count), optimum.merged_squares
    for rows, residual in poses:
        information += rows.T @ rows
        score += rows.T @ residual
        squares += float(residual @ residual)
    covariance = invert_precision(torch.from_numpy(information + prior)).numpy()
    force = score + prior @ optimum.deviation
    step = -covariance @ force
    remaining = np.array([rows.T @ (residual + rows @ step) for rows, residual in poses])
    centred = remaining - remaining.mean(0)
    sampled = covariance @ information @ covariance
    clustered = covariance @ (centred.T @ centred) @ covariance
    by_scale = _scale_jacobian(optimum, parameters)  # (2, S), across and down
    mean = by_scale.mean(0)
    variances = np.einsum("ks,st,kt->k", by_scale, covariance, by_scale)
    worse = by_scale[int(np.argmax(variances))]
    gain = float(force @ covariance @ force) / max(squares, 1e-300)
    return ScaleEvidence(
        sigma=float(np.sqrt(max(0.0, variances.max()))),
        change=float(mean @ step),
        change_sigma=float(np.sqrt(max(mean @ sampled @ mean, mean @ clustered @ mean, 0.0))),
        gain=1.0 - float(np.sqrt(1.0 - min(1.0, max(0.0, gain)))),
        corrections=_corrections(parameters, step, covariance, mean, worse),
    )


def _poses(calibration: Calibration, views: Sequence[ReducedView]) -> list[tuple[Array, Array]]:
    """Return the (2m, S) rows and (2m,) residuals of each pose of the board. Pictures of one pose
    count as one picture.
    """
    labels = pose_labels(calibration.views)
    weights = 1.0 / np.sqrt(np.bincount(labels)[labels])
    poses = []
    for label in range(labels.max() + 1):
        members = np.flatnonzero(labels == label).tolist()
        rows = np.concatenate([weights[i] * views[i].jacobian for i in members])
        residual = np.concatenate([weights[i] * views[i].residual for i in members])
        poses.append((rows, residual))
    return poses


def _freed(calibration: Calibration) -> FittedModel:
    """Return the end of the fit with every declared number free."""
    optimum = averaged_optimum_of(calibration)
    joint = replace(
        optimum.joint,
        smoothness=optimum.joint.smoothness or (UNEVEN_GLASS if calibration.relief else None),
    )
    priors = optimum.model.priors
    names = {param.name for param in optimum.model.path.params}
    plausible = {
        name: sigma for name, sigma in _plausible(calibration).items() if sigma and name in names
    }
    correlations = {
        (first, second): value
        * _narrowing(priors, plausible, first)
        * _narrowing(priors, plausible, second)
        for (first, second), value in priors.correlations.items()
    }
    if _declares_intrinsics(calibration):
        ratio = SQUARE_PIXELS / (PRIOR_INFLATION * FOCAL.sigma)
        correlations.pop((CAMERA.fy, CAMERA.fx), None)
        correlations[CAMERA.focal] = 1.0 - ratio**2 / 2
    wider = replace(priors, sigmas={**priors.sigmas, **plausible}, correlations=correlations)
    return replace(optimum, model=replace(optimum.model, priors=wider), joint=joint)


def _narrowing(priors: Priors, plausible: Mapping[str, float], name: str) -> float:
    """Return the factor on a number's correlations that keeps its covariances."""
    if name not in plausible or name not in priors.sigmas:
        return 1.0
    return float(priors.sigmas[name]) / plausible[name]


def _plausible(calibration: Calibration) -> dict[str, float]:
    """Return the standard deviation that each declared number may have, in its SI unit or px."""
    declared = calibration.declared
    stated = numbers_of(declared.intrinsics, declared.cover)
    plain = {name: Number(number.value) for name, number in stated.items()}
    intrinsics, cover = replace_numbers(declared.intrinsics, declared.cover, plain)
    tolerances = numbers_of(*free_parameters(intrinsics, cover, (ALL,)))
    by_session = _declares_intrinsics(calibration)
    sigmas = {
        name: number.sigma
        if CAMERA.has(name) and not by_session
        else max(number.sigma, tolerances[name].sigma if name in tolerances else 0.0)
        for name, number in stated.items()
    }
    if by_session:
        for name in CAMERA.focal:
            sigmas[name] = max(
                sigmas[name], PRIOR_INFLATION * FOCAL.sigma * abs(stated[name].value)
            )
    return sigmas


def _declares_intrinsics(calibration: Calibration) -> bool:
    """True if session.yaml declares the intrinsics: else pictures gave them."""
    return calibration.outcome.intrinsics_from in (None, "session.yaml")


def _scale_jacobian(optimum: FittedModel, parameters: Parameters) -> Array:
    """Return (2, S): the relative change of the undistorted picture at infinity, across and down,
    by the parameters' vector. A rotation of all rays is projected out.
    """
    pixels = optimum.observations.pixels.numpy()
    pixels = pixels[:: max(1, len(pixels) // SAMPLED)]
    jacobian, motions, failed = undistorted_jacobian(optimum.model.path, parameters, pixels)
    values = optimum.joint.values
    centre = [float(values[name]) for name in CAMERA.centre]
    offset = (pixels - centre)[~failed]
    columns = np.zeros((len(offset), 2, 5))
    columns[:, :, :3] = motions[~failed, 0, :, :3]
    columns[:, 0, 3] = offset[:, 0]
    columns[:, 1, 4] = offset[:, 1]
    design = columns.reshape(-1, 5)
    lengths = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    change = jacobian[~failed, 0].reshape(len(design), -1)
    solved = np.linalg.lstsq(design / lengths, change, rcond=None)[0]
    return np.asarray(solved[3:] / lengths[3:, None])


def _corrections(
    parameters: Parameters, step: Array, covariance: Array, mean: Array, worse: Array
) -> dict[str, Correction]:
    """Return the declared scalars' corrections. They share the variance of the scale `worse`."""
    slices = parameters.slices()
    scalars = {
        param.name: param.scale
        for param in parameters.free
        if not parameters.origin[param.name].ndim
        and (CAMERA.has(param.name) or number_of(param.name))
    }
    variance = max(float(worse @ covariance @ worse), 1e-300)
    corrections = {}
    for name, scale in scalars.items():
        at = slices[name].start
        group = parameters.entries(member for member in scalars if _group(member) == _group(name))
        cross = covariance[group] @ worse
        explained = worse @ regression(covariance, group) @ cross
        corrections[name] = Correction(
            change=scale * float(step[at]),
            sigma=scale * float(np.sqrt(covariance[at, at])),
            scale_change=float(mean[at] * step[at]),
            share=float(explained) / variance,
        )
    return corrections


def _group(name: str) -> str:
    """Return the name under which session.yaml has a number."""
    if name in CAMERA.focal:
        return "focal"
    number = number_of(name)
    return name.removesuffix(number) + number.partition(".")[0]
