"""The predicted standard deviation of each pixel's undistorted position, at any depth: the fit's
covariance propagated to the maps.

p_u(Z) = A + B / Z for every pixel, so the variance is a quadratic in inverse depth, of three
coefficients a pixel. The rigid motion of all rays that board views leave open is the gauge: of each
error, the motion that hides most of it at the training corners is subtracted. A wide lens sees
corners that no undistorted picture holds, so the errors at its corners are measured in frames along
their rays, as if the camera looked straight at each corner.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError
from calib.estimation.corner_cells import part_rows
from calib.estimation.covariance import covariance_root
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.observations import BATCH_SIZE
from calib.estimation.parameters import Parameters
from calib.fitting.corner_range import corners_at
from calib.optics.exposure import MIDDLE
from calib.optics.path import Path
from calib.optics.rotation import onto_z
from calib.rounding import two_digits
from calib.threads import single_thread
from calib.undistortion.depth_map import DepthMap
from calib.undistortion.remap import remap

Array = NDArray[np.float64]


class RayErrors(Protocol):
    """A function that returns the errors of the rays of pixels (`ray_errors`)."""

    def __call__(self, pixels: Array, frames: Array | None = None) -> Array: ...


NO_CORNERS = (
    "the calibration's poses and corners do not go with its camera and cover, as if its files had"
    " been edited: fit the session again."
)
SAMPLED = 300
"""The number of corners at which `map_sigmas` computes."""
NODES = (49, 37)
"""Pixels across and down at which the variance is computed; between them it is linear."""


@dataclass(frozen=True, slots=True)
class SigmaField:
    """The predicted error of the undistorted position of every distorted pixel."""

    nodes_x: Array
    """(w,) px"""
    nodes_y: Array
    """(h,) px"""
    variance: Array
    """(h, w, 3) px^2, px^2 m, px^2 m^2: the variance at depth Z is the first + the second / Z + the
    third / Z^2, x and y together. NaN where no ray leaves the cover, or the ray does not go
    forward.
    """

    def at_nodes(self, depth: float) -> Array:
        """Return (h, w) px: the standard deviation of the two-dimensional position at depth m."""
        sigma: Array = np.sqrt(
            np.maximum(self.variance @ np.array([1, 1 / depth, 1 / depth**2]), 0.0)
        )
        return sigma

    def at(
        self, x: NDArray[np.floating], y: NDArray[np.floating], depth: float
    ) -> NDArray[np.float32]:
        """Return the same standard deviation at distorted pixels, px, given as arrays of x and y of
        one shape. NaN outside the image, and next to pixels whose ray does not leave the cover.
        """
        column, inside_x = _node_indices(x, self.nodes_x)
        row, inside_y = _node_indices(y, self.nodes_y)
        sigma = self.at_nodes(depth).astype(np.float32)
        interpolated = remap(sigma, column, row, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE)
        return np.where(inside_x & inside_y, interpolated, np.float32(np.nan))

    def of_map(self, made: DepthMap) -> NDArray[np.float32]:
        """Return (height, width) px for the pixels of a map; NaN where the map is not valid."""
        return np.where(made.valid, self.at(made.x, made.y, made.depth), np.float32(np.nan))


@lru_cache(maxsize=1)  # maps, report and verdict ask the same calibration
def predicted_sigma(calibration: Calibration) -> SigmaField | None:
    """Return the uncertainty of a calibration's maps; None if its fit estimated no covariance."""
    if not calibration.covariance.size:
        return None
    size = calibration.camera.width, calibration.camera.height
    nodes_x = np.linspace(-0.5, size[0] - 0.5, NODES[0])
    nodes_y = np.linspace(-0.5, size[1] - 0.5, NODES[1])
    pixels = np.stack(np.meshgrid(nodes_x, nodes_y), -1).reshape(-1, 2)
    with single_thread():
        spread = ray_errors(calibration)(pixels).reshape(
            len(pixels), 2, 2, -1
        )  # (N, A or B, x or y, S)
    at_infinity, parallax = spread[:, 0], spread[:, 1]
    variance = _coefficients(at_infinity, parallax)
    return SigmaField(nodes_x, nodes_y, variance.reshape(len(nodes_y), len(nodes_x), 3))


def _coefficients(at_infinity: Array, parallax: Array) -> Array:
    """Return the (N, 3) coefficients of `SigmaField.variance` from (N, 2, S) errors of A and B."""
    return np.stack(
        [
            (at_infinity**2).sum((1, 2)),
            2 * (at_infinity * parallax).sum((1, 2)),
            (parallax**2).sum((1, 2)),
        ],
        -1,
    )


def corner_variances(calibration: Calibration) -> Array:
    """Return the (n, 3) coefficients of `SigmaField.variance` at the corners over which
    `map_sigmas` takes its median; (0, 3) if the fit has no covariance.
    """
    errors = _corner_errors(calibration)
    if not errors.size:
        return np.zeros((0, 3))
    return _coefficients(errors[:, :2], errors[:, 2:])


def map_sigmas(calibration: Calibration, depths: Sequence[float]) -> dict[float, float]:
    """Return the predicted standard deviation of the maps in px by depth in m, the median over the
    corners; empty if the fit has no covariance.
    """
    errors = _corner_errors(calibration)
    if not errors.size:
        return {}
    errors_by_depth = {depth: errors[:, :2] + errors[:, 2:] / depth for depth in depths}
    return {
        depth: float(np.nanmedian(np.sqrt((map_errors**2).sum((1, 2)))))
        for depth, map_errors in errors_by_depth.items()
    }


def describe_sigmas(
    sigmas: Mapping[float, float], reach: tuple[float, float] = (0.0, math.inf)
) -> str:
    """Return the standard deviations of maps in px by depth in m as text, each with two digits.

    Args:
        reach: m, the depths of the nearest and of the farthest board: others are marked.
    """
    nearest, farthest = reach
    return ", ".join(
        f"{two_digits(sigma)} px at {depth:g} m"
        f"{'' if nearest <= depth <= farthest else ' (no board was there)'}"
        for depth, sigma in sigmas.items()
    )


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def _corner_errors(calibration: Calibration) -> Array:
    """Return the (n, 4, S) errors of the rays of some corners; for a wide lens, of corners that its
    undistorted picture holds.
    """
    pixels = corners_at(calibration)[:, :2]
    if calibration.model()[0].lens.wide:
        pixels = pixels[calibration.ray_field().holds(pixels)]
    return ray_errors(calibration)(pixels[:: max(1, len(pixels) // SAMPLED)])


@lru_cache(maxsize=1)
def ray_errors(calibration: Calibration) -> RayErrors:
    """Return a function from (N, 2) px to the (N, 4, S) errors of their A (px) and B (px m) for
    each of S independent errors of unit variance, which all pixels share; NaN where no ray leaves
    the cover, or the ray does not go forward. S is 0 if the fit estimated no covariance. With
    frames, (N, 3, 3) rotations from the camera frame, A and B of each pixel are taken in its frame.
    """
    if not calibration.covariance.size:
        return _no_errors
    change = UndistortedChange.of(calibration)
    root = covariance_root(calibration.covariance)

    def errors(pixels: Array, frames: Array | None = None) -> Array:
        jacobian, invalid = change.jacobian(pixels, frames)
        return np.where(invalid[:, None, None], np.nan, jacobian @ root)

    return errors


def _no_errors(pixels: Array, frames: Array | None = None) -> Array:  # noqa: ARG001
    """Return the errors of a calibration without a covariance, (N, 4, 0)."""
    return np.zeros((len(pixels), 4, 0))


def frames_along(directions: Array) -> Array:
    """Return (N, 3, 3) rotations from the camera frame to frames whose z axes point along (N, 3)
    unit directions; the identity where a direction is NaN.
    """
    undefined = np.isnan(directions).any(-1, keepdims=True)
    defined = np.where(undefined, [0.0, 0.0, 1.0], directions)
    return np.asarray(onto_z(torch.from_numpy(defined)).numpy())


@dataclass(frozen=True, slots=True)
class UndistortedChange:
    """The change of a calibration's undistorted pixels with the parameters of its fit, after the
    motion of the gauge is projected out.
    """

    path: Path
    parameters: Parameters
    motion: Array
    """(6, S): the rigid motion of all rays that hides most of a change of each parameter at the
    training corners.
    """

    @staticmethod
    def of(calibration: Calibration) -> UndistortedChange:
        """Return the change for a calibration; InputError if a training corner is not in front of
        the camera.
        """
        model = calibration.camera_model()
        path, parameters, corners = model.path, model.parameters, corners_at(calibration)
        if calibration.views:
            corners = corners[part_rows(calibration.observations).numpy()]
        corners = corners[corners[:, 2] > 0]  # a lens that is not wide sees nothing behind it
        if not len(corners):
            raise InputError(NO_CORNERS)
        distance = corners[:, 2]
        normal, right_side = np.zeros((6, 6)), np.zeros((6, parameters.count))
        for first in range(0, len(distance), BATCH_SIZE):
            batch = slice(first, first + BATCH_SIZE)
            pixels = corners[batch, :2]
            near = 1 / distance[batch]
            frames = None
            if path.lens.wide:
                rays = path.trace(torch.from_numpy(pixels), model.means, MIDDLE)
                frames = frames_along(rays.direction.stacked().numpy())
            jacobian, motions, invalid = undistorted_jacobian(path, parameters, pixels, frames)
            at_depth = (
                np.stack([np.ones_like(near), near], -1)[:, :, None, None]
                * ~invalid[:, None, None, None]
            )
            by_parameters = (at_depth * jacobian).sum(1).reshape(2 * len(near), -1)
            by_motion = (at_depth * motions).sum(1).reshape(2 * len(near), -1)
            normal += by_motion.T @ by_motion
            right_side += by_motion.T @ by_parameters
        try:
            motion = np.linalg.solve(normal, right_side)
        except np.linalg.LinAlgError as error:
            raise InputError(NO_CORNERS) from error
        return UndistortedChange(path, parameters, np.asarray(motion, dtype=np.float64))

    def jacobian(
        self, pixels: Array, frames: Array | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the (N, 4, S) Jacobian of A and B by the parameters, and (N,), true where there is
        no ray or it does not go forward. With (N, 3, 3) frames, A and B of each pixel are taken in
        its frame.
        """
        jacobian, motions, invalid = undistorted_jacobian(
            self.path, self.parameters, pixels, frames
        )
        return (jacobian - motions @ self.motion).reshape(
            len(pixels), 4, jacobian.shape[-1]
        ), invalid


def _node_indices(
    pixels: NDArray[np.floating], nodes: Array
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return coordinates in px as fractional indices of evenly spaced nodes, and a mask that is
    true where they lie between the first and the last node, up to float32's rounding.
    """
    index = ((pixels - nodes[0]) / (nodes[1] - nodes[0])).astype(np.float32)
    return index, (index >= -1e-3) & (index <= len(nodes) - 1 + 1e-3)
