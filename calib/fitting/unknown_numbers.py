"""Where a fit starts if numbers of the camera or its cover are unknown: at the most probable end of
rough fits from several places within their priors.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import torch

from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import FIRST_SIGMA, ROUGH_ROUNDS, JointFit, Start
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.estimation.stated_priors import priors_of
from calib.fitting.stages import MAX_LOST_FRACTION, Setup
from calib.intrinsics.calibrate import calibrate_bare
from calib.optics.build import covered_path, pinhole_path
from calib.progress import Progress, Silent
from calib.session.cover import Cover
from calib.session.numbers import camera_numbers, unknown_names
from calib.session.parameter_names import CAMERA, COVER, number_of
from calib.session.shapes.registry import find_shape

SPREAD = (0.0, -1.0, 1.0)
"""The places of the starts within a prior, in its standard deviations from the mean."""
RADII = (1.0, 0.5, 3.0)
"""The same for radii, relative to the mean: a radius is positive."""
MEDIA = (1.0, 1.333)
"""The same for the index of what is outside: air and water."""
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
    setup = replace(setup, initial=lens)
    observations = Observations.of(views, setup.board)
    starts = [
        {**scaled, **start}
        for start in _starts(setup.cover)
        for scaled in _in_medium(lens, setup.cover, start)
    ]
    advance = progress.task("Unknown numbers", len(starts))
    ranked: list[tuple[float, int]] = []
    for i, start in enumerate(starts):
        ranked.append((_error_at(replace(setup, initial=start), observations), i))
        advance(i + 1, f"{min(ranked)[0]:.3g} px")
    fits: list[tuple[float, Mapping[str, float]]] = []
    for error, i in sorted(ranked)[:MAX_FITS]:
        joint = _rough_fit(replace(setup, initial=starts[i]), observations)
        if error < torch.inf and joint and joint.finite:
            estimates = {name: float(joint.values[name]) for name in names if name in joint.values}
            fits.append((joint.cost, estimates))
    if not fits:
        return replace(setup, initial=starts[min(ranked)[1]])
    return replace(setup, initial=min(fits, key=lambda fit: fit[0])[1])


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
            values = MEDIA
        choices.append(values)
    for values in product(*choices):
        start = dict(zip(numbers, values, strict=True))
        if _has_room(cover, start):
            yield start


def _has_room(cover: Cover, start: Mapping[str, float]) -> bool:
    """Return True if the camera is inside of the innermost cover at these values."""
    check = find_shape(cover.shape).check_camera
    if not check:
        return True
    inner = COVER.of("")
    values = {name: number.value for name, number in cover.numbers.items()} | dict(start)
    return not check(
        {name.removeprefix(inner): v for name, v in values.items() if name.startswith(inner)}
    )


def _model(setup: Setup) -> CameraModel:
    build = covered_path(setup.intrinsics, setup.cover)
    path, means = build
    return CameraModel(path, means, priors_of(setup.intrinsics, setup.cover, path))


def _error_at(setup: Setup, observations: Observations) -> float:
    """Return the error in px at the initial values; infinity where the cover hides the board."""
    model = _model(setup)
    lens, means = pinhole_path(setup.intrinsics)
    poses = pinhole_poses(lens, setup.initial_values(means), observations)
    values = setup.initial_values(model.means)
    poses = refine_poses(model.path, values, observations, poses).blocks
    residual = residuals(model.path, values, observations, poses)
    fraction = (~torch.isfinite(residual.image)).any(-1).double().mean()
    return residual.rms_px if float(fraction) <= MAX_LOST_FRACTION else torch.inf


def _rough_fit(setup: Setup, observations: Observations) -> JointFit | None:
    """Return a rough fit of even glass, from the initial values."""
    model = _model(setup)
    lens, means = pinhole_path(setup.intrinsics)
    poses = pinhole_poses(lens, setup.initial_values(means), observations)
    values = setup.initial_values(model.means)
    poses = refine_poses(model.path, values, observations, poses).blocks
    if not bool(torch.isfinite(poses).all()):
        return None
    return model.fit(observations, poses, Start(values, FIRST_SIGMA, None), ROUGH_ROUNDS)
