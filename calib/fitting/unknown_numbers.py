"""Where a fit starts if numbers of the camera or its cover are unknown: at the most probable end of
rough fits from several places within their priors.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import torch
from torch import Tensor

from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import FIRST_SIGMA, ROUGH_ROUNDS, JointFit, Start
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.estimation.stated_priors import priors_of
from calib.fitting.setup import Setup
from calib.fitting.stages import MAX_LOST_FRACTION
from calib.intrinsics.calibrate import calibrate_bare
from calib.optics.build import covered_path, pinhole_path
from calib.optics.params import Values
from calib.progress import Progress, Silent
from calib.session.cover import Cover
from calib.session.numbers import camera_numbers, unknown_names
from calib.session.parameter_names import CAMERA, COVER, number_of
from calib.session.shapes.layer import MEDIA
from calib.session.shapes.registry import find_shape

SPREAD = (0.0, -1.0, 1.0)
"""The places of the starts within a prior, in its standard deviations from the mean."""
RADII = (1.0, 0.5, 3.0)
"""The same for radii, relative to the mean: a radius is positive."""
MAX_FITS = 4
"""Starts from which a fit is tried, those of the smallest errors."""
ALONG = ("axis_offset.z", "centre.z")
"""The numbers that place a round cover along the optical axis: what its refraction depends on
most.
"""


def with_initial_values(setup: Setup, views: Sequence[View], progress: Progress) -> Setup:
    """Return the setup with a start for each unknown number; the setup itself if all are known."""
    names = unknown_names(setup.intrinsics, setup.cover)
    if not names:
        return setup
    lens = _lens_of_views(setup, views, names)
    setup = replace(setup, initial=lens, bare_lens=lens)
    observations = Observations.of(views, setup.board)
    starts = [
        {**scaled, **start}
        for start in _starts(setup.cover)
        for scaled in _in_medium(lens, setup.cover, start)
    ]
    advance = progress.task(f"First values, {setup.cover.shape}", len(starts))
    beginnings: list[_Beginning] = []
    for count, start in enumerate(starts, 1):
        beginnings.append(_Beginning.of(replace(setup, initial=start), observations))
        advance(count, f"best {min(beginning.rms_px for beginning in beginnings):.3g} px")
    beginnings.sort(key=lambda beginning: beginning.rms_px)
    fits = [beginning.fit(observations) for beginning in beginnings[:MAX_FITS]]
    finite = [joint for joint in fits if joint and joint.finite]
    if not finite:
        return beginnings[0].setup
    values = min(finite, key=lambda joint: joint.cost).values
    return replace(setup, initial={name: float(values[name]) for name in names if name in values})


def _lens_of_views(setup: Setup, views: Sequence[View], names: Sequence[str]) -> dict[str, float]:
    """Return the unknown intrinsics as these views show them without the cover; empty if the views
    do not show them.
    """
    numbers = camera_numbers(setup.intrinsics)
    wanted = [name for name in names if name in numbers]
    if not wanted:
        return {}
    model, count = setup.intrinsics.model, len(setup.intrinsics.distortion)
    camera = replace(setup.camera, intrinsics=None, lens=model, lens_coefficients=count)
    try:
        lens = calibrate_bare(views, setup.board, camera, Silent()).intrinsics
    except (InputError, NotEnoughDataError):
        return {}
    values = {name: number.value for name, number in camera_numbers(lens).items()}
    return {name: values[name] for name in wanted if name in values}


def _in_medium(
    lens: Mapping[str, float], cover: Cover, start: Mapping[str, float]
) -> Iterator[dict[str, float]]:
    """Yield the intrinsics of the views, and those of a lens without distortion if a flat window
    magnifies by the index of what is outside and distorts.
    """
    yield dict(lens)
    medium = cover.medium
    index = start.get(cover.medium_name, medium.value if medium else 1.0)
    if index != 1.0 and not {*CAMERA.focal}.isdisjoint(lens):
        focal = {name: lens[name] / index for name in CAMERA.focal if name in lens}
        yield {name: 0.0 if name not in CAMERA.centre else lens[name] for name in lens} | focal


def _starts(cover: Cover) -> Iterator[dict[str, float]]:
    """Yield the values of the cover's unknown numbers at which a fit may start. The camera is
    inside of every cover.
    """
    numbers = {name: number for name, number in cover.numbers.items() if number.unknown}
    choices = []
    for name, number in numbers.items():
        kind = number_of(name)
        values: Sequence[float] = (number.value,)
        if kind == "inner_radius":
            values = [factor * number.value for factor in RADII]
        elif kind in ALONG:
            values = [number.value + place * number.sigma for place in SPREAD]
        elif name == cover.medium_name:
            values = tuple(MEDIA.values())
        choices.append(values)
    for values in product(*choices):
        start = dict(zip(numbers, values, strict=True))
        if _has_room(cover, start):
            yield start


def _has_room(cover: Cover, start: Mapping[str, float]) -> bool:
    """Return True if the camera is inside the innermost cover at these values."""
    check = find_shape(cover.shape).check_camera
    if not check:
        return True
    inner = COVER.of("")
    values = {name: number.value for name, number in cover.numbers.items()} | dict(start)
    return not check(
        {name.removeprefix(inner): v for name, v in values.items() if name.startswith(inner)}
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Beginning:
    """A setup at its initial values, with even glass."""

    setup: Setup
    model: CameraModel
    values: Values
    poses: Tensor
    """(V, 6)"""
    rms_px: float
    """The error there; infinity where the cover hides the board."""

    @staticmethod
    def of(setup: Setup, observations: Observations) -> "_Beginning":
        """Fit the poses of the board."""
        path, means = covered_path(setup.intrinsics, setup.cover)
        model = CameraModel(path, means, priors_of(setup.intrinsics, setup.cover, path))
        lens, lens_means = pinhole_path(setup.intrinsics)
        poses = pinhole_poses(lens, setup.initial_values(lens_means), observations)
        values = setup.initial_values(means)
        poses = refine_poses(path, values, observations, poses).blocks
        residual = residuals(path, values, observations, poses)
        fraction = float((~torch.isfinite(residual.image)).any(-1).double().mean())
        rms_px = residual.rms_px if fraction <= MAX_LOST_FRACTION else torch.inf
        return _Beginning(setup, model, values, poses, rms_px)

    def fit(self, observations: Observations) -> JointFit | None:
        """Return a rough fit; None where the cover hides the board."""
        if self.rms_px == torch.inf or not bool(torch.isfinite(self.poses).all()):
            return None
        start = Start(dict(self.values), FIRST_SIGMA, None)
        return self.model.fit(observations, self.poses, start, ROUGH_ROUNDS)
