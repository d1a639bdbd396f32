"""What a fleet of cameras expects of the next one: prior.yaml, as `calib fleet-prior` writes it,
and a session that names it.

The fleet's numbers take the place of what the session writes plainly, which is what the fleet's own
sessions declared as well: its fits have had that once. What the session knows of this very camera
goes beside them: a number with a sigma of its own, and intrinsics from bare/.
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
from calib.session.cover import Cover, cover_to_yaml, read_cover
from calib.session.freeing import ALL, with_free
from calib.session.numbers import (
    check_correlations,
    covariance_of,
    numbers_of,
    with_covariance,
    with_numbers,
)
from calib.session.schema import Number, Section

Array = NDArray[np.float64]

FORMAT = 1
FARTHEST = 3.0
"""Standard deviations: a session that declares a number farther from the fleet's describes a camera
of another make.
"""


@dataclass(frozen=True, slots=True)
class FleetPrior:
    """The numbers of a camera of this make, each with a sigma, and their correlations; those
    without a sigma the fleet did not estimate.
    """

    file: Path
    sha256: str
    camera: Camera
    """With its intrinsics."""
    cover: Cover
    declared: tuple[Intrinsics, Cover]
    """What the fleet's sessions declare, each number with its tolerance."""
    cameras: int
    """That it was made from."""
    left_out: tuple[tuple[str, str], ...] = ()
    """Cameras that it was not made from, and why."""

    @property
    def intrinsics(self) -> Intrinsics:
        assert self.camera.intrinsics
        return self.camera.intrinsics

    @property
    def names(self) -> tuple[str, ...]:
        """Of the numbers that it knows."""
        return tuple(
            name for name, number in numbers_of(self.intrinsics, self.cover).items() if number.sigma
        )


def fleet_prior_yaml(prior: FleetPrior, version: str) -> str:
    """The file's text."""
    declared = {
        "camera": camera_to_yaml(_with(prior.camera, prior.declared[0])),
        "cover": cover_to_yaml(prior.declared[1]),
    }
    said = {
        "format": FORMAT,
        "refracal": version,
        "cameras": prior.cameras,
        "camera": camera_to_yaml(prior.camera),
        "cover": cover_to_yaml(prior.cover),
        "declared": declared,
        "left_out": [{"camera": camera, "because": because} for camera, because in prior.left_out],
    }
    return yaml.safe_dump(said, sort_keys=False, allow_unicode=True, width=120)


def read_fleet_prior(file: Path) -> FleetPrior:
    """InputError where it is none, or not whole."""
    section = Section(read_yaml(file), str(file))
    section.choice(
        "format",
        (FORMAT,),
        f"{FORMAT}, the format that this version of calib reads, as calib fleet-prior writes it",
    )
    section.only(("format", "refracal", "cameras", "camera", "cover", "declared", "left_out"))
    camera, cover = _described(section)
    told, told_cover = _described(section.section("declared", "what calib fleet-prior wrote"))
    left_out = section.values.get("left_out", [])
    match left_out:
        case list() if all(
            isinstance(one, dict) and {*one} == {"camera", "because"} for one in left_out
        ):
            pass
        case _:
            raise section.wrong("left_out", left_out, "a list of {camera: ..., because: ...}")
    assert told.intrinsics
    return FleetPrior(
        file,
        sha256(read_file(file)).hexdigest(),
        camera,
        cover,
        (told.intrinsics, told_cover),
        section.whole("cameras", 1, 10_000_000),
        tuple((str(one["camera"]), str(one["because"])) for one in left_out),
    )


def check_like(prior: FleetPrior, camera: Camera, cover: Cover, file: str) -> None:
    """InputError where a session describes a camera of another kind than the fleet's.

    Args: file: the session's.
    """
    ours, theirs = (camera.width, camera.height), (prior.camera.width, prior.camera.height)
    drop = f"as {prior.file} is of such cameras, or drop the key prior"
    if ours != theirs:
        raise InputError(
            f"{file}: camera is {ours[0]}x{ours[1]} px: write {theirs[0]}x{theirs[1]}, {drop}."
        )
    if cover.shape != prior.cover.shape:
        raise InputError(
            f"{file}: cover.shape is {cover.shape}: write {prior.cover.shape}, {drop}."
        )
    if camera.intrinsics:
        _check_lens(prior, camera.intrinsics, f"{file}: camera.intrinsics", drop)
        _check_near(prior, camera.intrinsics, cover, file)
    else:
        _check_near(prior, prior.intrinsics, cover, file)


def expected(
    prior: FleetPrior, intrinsics: Intrinsics, cover: Cover, file: str
) -> tuple[Intrinsics, Cover]:
    """What is known of this camera before its views: the fleet's numbers, with what the session
    knows of this one.

    Args:
        intrinsics: with sigmas where this camera's were measured; the fleet's own where they were
            not.
        file: the session's, for messages.

    Raises:
        InputError: they cannot be true together.
    """
    _check_lens(
        prior,
        intrinsics,
        f"{file}: the lens",
        f"as {prior.file} is of such cameras, or drop the key prior",
    )
    said, declared, fleet = (
        numbers_of(intrinsics, cover),
        numbers_of(*prior.declared),
        numbers_of(prior.intrinsics, prior.cover),
    )
    names = prior.names
    own = tuple(
        n
        for n in names
        if (said[n].sigma or said[n].exact) and said[n] not in (declared[n], fleet[n])
    )
    mean, covariance = _all_of(prior, fleet)
    at = [names.index(name) for name in own]
    noise = covariance_of(intrinsics, cover, own)
    away = np.array([said[name].value for name in own]) - mean[at]
    allowed = covariance[np.ix_(at, at)] + noise
    for name, by, sigma in zip(own, away, np.sqrt(allowed.diagonal()), strict=True):
        _refuse_far(name, said[name], fleet[name], float(by / sigma), prior, file)
    gain = np.linalg.solve(allowed, covariance[at]).T
    mean, covariance = mean + gain @ away, covariance - gain @ covariance[at]
    left = [i for i, name in enumerate(names) if not said[name].exact or name not in own]
    kept = tuple(names[i] for i in left)
    intrinsics, cover = with_covariance(
        intrinsics, cover, kept, mean[left], covariance[np.ix_(left, left)]
    )
    if not prior.cover.glass:
        return intrinsics, cover
    figure = slice(len(names), None)
    beside = covariance[figure][:, left]
    return intrinsics, replace(
        cover,
        glass=replace(
            prior.cover.glass,
            mean=mean[figure],
            covariance=covariance[figure, figure],
            numbers=kept,
            beside=beside,
        ),
    )


def _all_of(prior: FleetPrior, fleet: Mapping[str, Number]) -> tuple[Array, Array]:
    """(K + N,) and (K + N, K + N) of the numbers, and of the glass's coefficients."""
    mean, covariance = (
        np.array([fleet[name].value for name in prior.names]),
        covariance_of(prior.intrinsics, prior.cover, prior.names),
    )
    if not (glass := prior.cover.glass):
        return mean, covariance
    beside = np.zeros((len(glass.mean), len(mean)))
    for name, column in zip(glass.numbers, glass.beside.T, strict=True):
        beside[:, prior.names.index(name)] = column
    return np.concatenate([mean, glass.mean]), np.block(
        [[covariance, beside.T], [beside, glass.covariance]]
    )


def nominal(prior: FleetPrior) -> Intrinsics:
    """The fleet's intrinsics as a data sheet would have them: plain numbers."""
    plain = {
        name: Number(number.value)
        for name, number in numbers_of(prior.intrinsics, prior.cover).items()
    }
    return with_numbers(prior.intrinsics, prior.cover, plain)[0]


def _described(section: Section) -> tuple[Camera, Cover]:
    place = section.section("cover", "{shape: cone, ...}")
    camera, cover = (
        read_camera(section.section("camera", "{width: 1640, height: 1232, intrinsics: ...}")),
        read_cover(place),
    )
    if not camera.intrinsics:
        raise section.wrong(
            "camera", camera_to_yaml(camera), "its intrinsics, as calib fleet-prior wrote it"
        )
    check_correlations(place, camera.intrinsics, cover)
    return camera, cover


def _with(camera: Camera, intrinsics: Intrinsics) -> Camera:
    return Camera(camera.width, camera.height, intrinsics=intrinsics)


def _check_lens(prior: FleetPrior, intrinsics: Intrinsics, what: str, drop: str) -> None:
    ours, theirs = (
        (k.model, len(k.distortion) if k.distorts else 0) for k in (intrinsics, prior.intrinsics)
    )
    if ours != theirs:
        raise InputError(
            f"{what} is {ours[0]} with {ours[1]} coefficients: write {theirs[0]} with {theirs[1]},"
            f" {drop}."
        )


def _check_near(prior: FleetPrior, intrinsics: Intrinsics, cover: Cover, file: str) -> None:
    """What is written plainly may be off by its tolerance, but not of another make."""
    said, fleet = numbers_of(intrinsics, cover), numbers_of(prior.intrinsics, prior.cover)
    tolerant = numbers_of(*with_free(intrinsics, cover, (ALL,)))
    for name in prior.names:
        if name in said and not said[name].sigma and not said[name].exact:
            apart = (said[name].value - fleet[name].value) / np.hypot(
                tolerant[name].sigma, fleet[name].sigma
            )
            _refuse_far(name, said[name], fleet[name], float(apart), prior, file)


def _refuse_far(
    name: str, said: Number, fleet: Number, sigmas: float, prior: FleetPrior, file: str
) -> None:
    if abs(sigmas) > FARTHEST:
        raise InputError(
            f"{file}: {name} is {said.value:.6g} where the cameras of {prior.file} have"
            f" {fleet.value:.6g} (in m, rad or px), {abs(sigmas):.1f} standard deviations apart:"
            " correct it, or drop the key prior."
        )
