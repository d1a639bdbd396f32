"""The prior that a fleet of cameras gives for another camera of the same make: prior.yaml, as
`calib fleet-prior` writes it, and a session that names it.

The fleet's numbers replace those that the session writes plainly. The fleet's own sessions declared
these, too, so its fits have used them once already. What the session knows of this particular
camera is combined with the fleet's numbers: a number with its own sigma, and intrinsics from bare/.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.files import read_file
from calib.io.yaml_reader import read_yaml
from calib.session.camera import Camera, Intrinsics, camera_to_yaml, read_camera
from calib.session.cover import Cover
from calib.session.cover_section import cover_sections, cover_to_yaml, read_cover
from calib.session.deviation import independent_deviation
from calib.session.freeing import ALL, free_parameters
from calib.session.numbers import (
    check_correlations,
    covariance_of,
    numbers_of,
    replace_covariance,
    replace_numbers,
)
from calib.session.schema import Number, Section

Array = NDArray[np.float64]

FORMAT = 1
MAX_DEVIATION = 3.0
"""Standard deviations: a session that declares a number farther from the fleet's describes a camera
of another make.
"""


@dataclass(frozen=True, slots=True)
class FleetPrior:
    """The numbers of a camera of this make, each with a sigma, and their correlations. The fleet
    did not estimate those without a sigma.
    """

    file: Path
    sha256: str
    camera: Camera
    """The camera, with its intrinsics."""
    cover: Cover
    declared: tuple[Intrinsics, Cover]
    """The numbers that the fleet's sessions declare, each with its tolerance."""
    cameras: int
    """The number of cameras behind the prior."""
    left_out: tuple[tuple[str, str], ...] = ()
    """The cameras that were left out, each with the reason."""

    @property
    def intrinsics(self) -> Intrinsics:
        assert self.camera.intrinsics
        return self.camera.intrinsics

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers that the fleet estimated."""
        return tuple(
            name for name, number in numbers_of(self.intrinsics, self.cover).items() if number.sigma
        )


def fleet_prior_yaml(prior: FleetPrior, version: str) -> str:
    """Return the text of the file."""
    declared = {
        "camera": camera_to_yaml(_with_intrinsics(prior.camera, prior.declared[0])),
        "cover": cover_to_yaml(prior.declared[1]),
    }
    document = {
        "format": FORMAT,
        "refracal": version,
        "cameras": prior.cameras,
        "camera": camera_to_yaml(prior.camera),
        "cover": cover_to_yaml(prior.cover),
        "declared": declared,
        "left_out": [{"camera": camera, "because": because} for camera, because in prior.left_out],
    }
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120)


def read_fleet_prior(file: Path) -> FleetPrior:
    """Read the file; raise InputError if it is not a complete fleet prior."""
    section = Section(read_yaml(file), str(file))
    section.choice(
        "format",
        (FORMAT,),
        f"{FORMAT}, the format that this version of calib reads, as calib fleet-prior writes it",
    )
    section.allow_only(("format", "refracal", "cameras", "camera", "cover", "declared", "left_out"))
    camera, cover = _read_description(section)
    declared_camera, declared_cover = _read_description(
        section.section("declared", "what calib fleet-prior wrote")
    )
    left_out = section.values.get("left_out", [])
    match left_out:
        case list() if all(
            isinstance(entry, dict) and {*entry} == {"camera", "because"} for entry in left_out
        ):
            pass
        case _:
            raise section.error("left_out", left_out, "a list of {camera: ..., because: ...}")
    assert declared_camera.intrinsics
    return FleetPrior(
        file=file,
        sha256=sha256(read_file(file)).hexdigest(),
        camera=camera,
        cover=cover,
        declared=(declared_camera.intrinsics, declared_cover),
        cameras=section.integer("cameras", 1, 10_000_000),
        left_out=tuple((str(entry["camera"]), str(entry["because"])) for entry in left_out),
    )


def check_compatible(prior: FleetPrior, camera: Camera, cover: Cover, file: str) -> None:
    """Raise InputError if a session describes a camera of another kind than the fleet's.

    Args:
        prior: the fleet's.
        camera: the session's.
        cover: the session's.
        file: the session's.
    """
    size = f"{camera.width}x{camera.height}"
    fleet_size = f"{prior.camera.width}x{prior.camera.height}"
    remedy = _remedy(prior)
    if size != fleet_size:
        raise InputError(f"{file}: camera is {size} px: write {fleet_size}, {remedy}.")
    if cover.shape != prior.cover.shape:
        raise InputError(
            f"{file}: cover.shape is {cover.shape}: write {prior.cover.shape}, {remedy}."
        )
    if cover.dimensions.keys() != prior.cover.dimensions.keys():
        raise InputError(f"{file}: cover is {cover.words}: write {prior.cover.words}, {remedy}.")
    if camera.intrinsics:
        _check_lens(prior, camera.intrinsics, f"{file}: camera.intrinsics")
        _check_near(prior, camera.intrinsics, cover, file)
    else:
        _check_near(prior, prior.intrinsics, cover, file)


def combine_with_prior(
    prior: FleetPrior, intrinsics: Intrinsics, cover: Cover, file: str
) -> tuple[Intrinsics, Cover]:
    """Return the prior of this camera before its views are used: the fleet's numbers, updated by
    what the session knows of this camera.

    Args:
        prior: the fleet's.
        intrinsics: with sigmas where this camera's were measured; the fleet's own where they were
            not.
        cover: the session's.
        file: the session's, for messages.

    Raises:
        InputError: the session and the prior contradict each other.
    """
    _check_lens(prior, intrinsics, f"{file}: the lens")
    session_numbers = numbers_of(intrinsics, cover)
    declared = numbers_of(*prior.declared)
    fleet = numbers_of(prior.intrinsics, prior.cover)
    names = prior.names
    measured = tuple(
        name
        for name in names
        if (session_numbers[name].sigma or session_numbers[name].exact)
        and session_numbers[name] not in (declared[name], fleet[name])
    )
    mean, covariance = _joint_prior(prior, fleet)
    at = [names.index(name) for name in measured]
    noise = covariance_of(intrinsics, cover, measured)
    innovation = np.array([session_numbers[name].value for name in measured]) - mean[at]
    innovation_covariance = covariance[np.ix_(at, at)] + noise
    sigmas = np.sqrt(innovation_covariance.diagonal())
    for name, difference, sigma in zip(measured, innovation, sigmas, strict=True):
        deviation = float(difference / sigma)
        _refuse_far(name, session_numbers[name], fleet[name], deviation, prior, file)
    gain = np.linalg.solve(innovation_covariance, covariance[at]).T
    mean = mean + gain @ innovation
    covariance = covariance - gain @ covariance[at]
    free = [
        i for i, name in enumerate(names) if not session_numbers[name].exact or name not in measured
    ]
    free_names = tuple(names[i] for i in free)
    intrinsics, cover = replace_covariance(
        intrinsics, cover, free_names, mean[free], covariance[np.ix_(free, free)]
    )
    if not prior.cover.glass:
        return intrinsics, cover
    figure = slice(len(names), None)
    glass = replace(
        prior.cover.glass,
        mean=mean[figure],
        covariance=covariance[figure, figure],
        numbers=free_names,
        cross_covariance=covariance[figure][:, free],
    )
    return intrinsics, replace(cover, glass=glass)


def _joint_prior(prior: FleetPrior, fleet: Mapping[str, Number]) -> tuple[Array, Array]:
    """Return the (K + N,) mean and (K + N, K + N) covariance of the numbers and the glass's
    coefficients.
    """
    mean = np.array([fleet[name].value for name in prior.names])
    covariance = covariance_of(prior.intrinsics, prior.cover, prior.names)
    if not (glass := prior.cover.glass):
        return mean, covariance
    cross_covariance = np.zeros((len(glass.mean), len(mean)))
    for name, column in zip(glass.numbers, glass.cross_covariance.T, strict=True):
        cross_covariance[:, prior.names.index(name)] = column
    return np.concatenate([mean, glass.mean]), np.block(
        [[covariance, cross_covariance.T], [cross_covariance, glass.covariance]]
    )


def nominal_intrinsics(prior: FleetPrior) -> Intrinsics:
    """Return the fleet's intrinsics as a data sheet would give them: plain numbers."""
    plain = {
        name: Number(number.value)
        for name, number in numbers_of(prior.intrinsics, prior.cover).items()
    }
    return replace_numbers(prior.intrinsics, prior.cover, plain)[0]


def _read_description(section: Section) -> tuple[Camera, Cover]:
    """Read a camera with intrinsics, and a cover."""
    covers = cover_sections(section, "{shape: cone, ...}")
    camera = read_camera(section.section("camera", "{width: 1640, height: 1232, intrinsics: ...}"))
    cover = read_cover(*covers)
    if not camera.intrinsics:
        raise section.error(
            "camera", camera_to_yaml(camera), "its intrinsics, as calib fleet-prior wrote it"
        )
    check_correlations(covers[0], camera.intrinsics, cover)
    return camera, cover


def _with_intrinsics(camera: Camera, intrinsics: Intrinsics) -> Camera:
    return Camera(camera.width, camera.height, intrinsics=intrinsics)


def _remedy(prior: FleetPrior) -> str:
    """Return what to do about a session that contradicts the prior."""
    return f"as {prior.file} is of such cameras, or drop the key prior"


def _check_lens(prior: FleetPrior, intrinsics: Intrinsics, subject: str) -> None:
    """Raise InputError if the lens has another model or number of coefficients than the fleet's."""
    fleet = prior.intrinsics
    count = len(intrinsics.distortion) if intrinsics.distorts else 0
    fleet_count = len(fleet.distortion) if fleet.distorts else 0
    if (intrinsics.model, count) != (fleet.model, fleet_count):
        raise InputError(
            f"{subject} is {intrinsics.model} with {count} coefficients: write {fleet.model} with"
            f" {fleet_count}, {_remedy(prior)}."
        )


def _check_near(prior: FleetPrior, intrinsics: Intrinsics, cover: Cover, file: str) -> None:
    """Raise InputError if a plain number deviates from the fleet's by more than its tolerance
    explains.
    """
    declared = numbers_of(intrinsics, cover)
    fleet = numbers_of(prior.intrinsics, prior.cover)
    tolerant = numbers_of(*free_parameters(intrinsics, cover, (ALL,)))
    for name in prior.names:
        if name in declared and not declared[name].sigma and not declared[name].exact:
            distance = declared[name].value - fleet[name].value
            deviation = independent_deviation(distance, tolerant[name].sigma, fleet[name].sigma)
            _refuse_far(name, declared[name], fleet[name], deviation, prior, file)


def _refuse_far(
    name: str, declared: Number, fleet: Number, deviation: float, prior: FleetPrior, file: str
) -> None:
    """Raise InputError if a number deviates by too many standard deviations."""
    if abs(deviation) > MAX_DEVIATION:
        raise InputError(
            f"{file}: {name} is {declared.value:.6g} where the cameras of {prior.file} have"
            f" {fleet.value:.6g} (in m, rad or px), {abs(deviation):.1f} standard deviations apart:"
            " correct it, or drop the key prior."
        )
