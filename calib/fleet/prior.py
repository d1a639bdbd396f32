"""A fleet's prior: the numbers and glass that its calibrations predict for the next camera of their
make.

Cameras are left out, each with a reason, if they have no calibration that can be used, if they are
of another kind than most, or if the others do not predict them. The prior is that of the others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.calibration import Calibration
from calib.errors import InputError, NotEnoughDataError, RefracalError, brief
from calib.estimation.likelihood_information import LikelihoodInformation, prior_conflict
from calib.fleet.common import Common
from calib.fleet.population import MIN_PRIOR_CAMERAS, ROUGH_DRAWS, Population, population
from calib.fleet.result import CAMERAS, JobState, Result, read_result
from calib.io.files import reading
from calib.io.result_names import CALIBRATION_FILE
from calib.session.camera import Camera
from calib.session.fleet_prior import FleetPrior
from calib.session.lens import SPLINED
from calib.session.numbers import numbers_of
from calib.verdict.verdict import Trust

OUTSIDE_CAMERA = ("the board", "each single view", "the corners' detector")
"""Subjects of effects that leave a camera's numbers unchanged."""
ALARM = 0.05
"""The probability that a fleet without a fault loses a camera as an outlier."""
SUSPECTS = 3
"""The number of cameras that are compared, in each round, with a population without them."""


@dataclass(frozen=True, slots=True)
class Kind:
    """The properties that cameras must share to have numbers in common."""

    width: int
    height: int
    lens: str
    coefficients: int
    cover: str
    """The words for what it looks through."""
    estimated: tuple[str, ...]
    """The names of the numbers that the fit estimated."""

    @staticmethod
    def of(calibration: Calibration) -> Kind:
        """Return the kind of a calibrated camera."""
        camera, cover = calibration.camera, calibration.cover
        intrinsics = camera.intrinsics
        assert intrinsics
        has_cover = cover.shape != "none"
        return Kind(
            width=camera.width,
            height=camera.height,
            lens=intrinsics.model,
            coefficients=len(intrinsics.distortion) if intrinsics.distorts else 0,
            cover=f"behind {cover.words}" if has_cover else "without a cover",
            estimated=tuple(
                name for name, number in numbers_of(intrinsics, cover).items() if number.sigma
            ),
        )

    def __str__(self) -> str:
        return (
            f"{self.width}x{self.height} px, {self.lens} with {self.coefficients} coefficients,"
            f" {self.cover}"
        )


def estimate_fleet_prior(fleet: Path) -> FleetPrior:
    """Return the prior that the calibrations in a fleet's folder give.

    Raises:
        InputError: the folder is no fleet, or no kind has more than half of its cameras.
        NotEnoughDataError: too few of its cameras can be used.
    """
    calibrations, left_out = _usable_calibrations(fleet)
    if not calibrations:
        _check_enough(fleet, calibrations, left_out)
    kind = _kind_of_most(fleet, calibrations)
    for camera, calibration in list(calibrations.items()):
        if reason := _difference(Kind.of(calibration), kind):
            left_out[camera] = reason
            del calibrations[camera]
    _check_enough(fleet, calibrations, left_out)
    common = Common.of(kind.estimated, Camera(kind.width, kind.height), list(calibrations.values()))
    likelihoods = {
        camera: common.likelihood(calibration) for camera, calibration in calibrations.items()
    }
    for camera, reason in _outliers(likelihoods, common).items():
        left_out[camera] = reason
        del likelihoods[camera]
    _check_enough(fleet, likelihoods, left_out)
    expected = population(list(likelihoods.values()), common.centre, common.axes)
    intrinsics, cover = common.described(expected)
    return FleetPrior(
        file=Path(),
        sha256="",
        camera=Camera(kind.width, kind.height, intrinsics=intrinsics),
        cover=cover,
        declared=(common.intrinsics, common.cover),
        cameras=expected.cameras,
        left_out=tuple(sorted(left_out.items())),
    )


def _usable_calibrations(fleet: Path) -> tuple[dict[str, Calibration], dict[str, str]]:
    """Return the calibrations that describe their make, and the reasons against the others, both by
    camera.
    """
    calibrations: dict[str, Calibration] = {}
    left_out: dict[str, str] = {}
    for camera in _camera_names(fleet):
        try:
            result = read_result(fleet, camera)
            reason = _reason_against_result(result)
            if not reason:
                assert result
                calibration = _read_last_calibration(fleet, result)
                reason = _reason_against_calibration(calibration)
        except RefracalError as error:
            reason = f"its calibration cannot be read ({brief(error)})"
        if reason:
            left_out[camera] = reason
        else:
            calibrations[camera] = calibration
    return calibrations, left_out


def _camera_names(fleet: Path) -> list[str]:
    """Return the names of the cameras that have a result in a fleet's folder.

    Raises:
        InputError: there is none.
    """
    folder = fleet / CAMERAS
    with reading(folder):
        if not folder.is_dir():
            raise InputError(
                f"{fleet} has no folder {CAMERAS}: give the FLEET that calib batch wrote."
            )
        cameras = sorted(
            path.stem for path in folder.glob("*.json") if not path.name.startswith(".")
        )
    if not cameras:
        raise InputError(f"{folder} has no cameras: give the FLEET that calib batch wrote.")
    return cameras


def _reason_against_result(result: Result | None) -> str:
    """Return why a result cannot be used; empty if it can."""
    if not result:
        return "its result is not whole, or of another version"
    if result.state is not JobState.CALIBRATED:
        return f"it has no calibration: {result.sentence.rstrip('.')}"
    if result.verdict.get("word") == Trust.DO_NOT_USE.value:
        return "its verdict is not to use it"
    return ""


def _read_last_calibration(fleet: Path, result: Result) -> Calibration:
    """Return the last calibration that a camera's job wrote: the diagnosed one, if there is one.

    Raises:
        InputError: the job wrote none.
    """
    path = next((path for path in reversed(result.written) if path.endswith(CALIBRATION_FILE)), "")
    if not path:
        raise InputError(f"{result.id} names no calibration: run calib batch again.")
    return Calibration.load(fleet / path)


def _reason_against_calibration(calibration: Calibration) -> str:
    """Return why a calibration's numbers do not describe its make; empty if they do."""
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    if calibration.cover.shape == "none":
        return "it has no cover, and a camera alone takes its numbers from its own views"
    if intrinsics.model == SPLINED:
        return "its lens is a spline, whose numbers no other lens shares"
    effects = [
        added.effect.name
        for added in calibration.effects
        if added.effect.about not in OUTSIDE_CAMERA
    ]
    if effects:
        return f"its diagnosis found {', '.join(effects)}"
    joint = calibration.outcome.joint
    if not calibration.relief or not (joint and joint.relief_prior):
        return "its fit did not estimate how uneven its glass is"
    if not calibration.covariance.size or not Kind.of(calibration).estimated:
        return "no number of it was fitted"
    if (prior := calibration.outcome.fleet_prior) and prior.used:
        return "it was fitted with a fleet's prior, which would be counted twice"
    return ""


def _kind_of_most(fleet: Path, calibrations: Mapping[str, Calibration]) -> Kind:
    """Return the kind that more than half of the cameras have.

    Raises:
        InputError: no kind has more than half of them.
    """
    counts = Counter(map(Kind.of, calibrations.values())).most_common()
    kind, majority = counts[0]
    if 2 * majority <= len(calibrations) and len(counts) > 1:
        listing = "; ".join(f"{count} are {rival}" for rival, count in counts[:3])
        raise InputError(
            f"{fleet} has cameras of {len(counts)} kinds, and no kind has more than half of them"
            f" ({listing}): run calib batch for each kind."
        )
    return kind


def _difference(kind: Kind, expected: Kind) -> str:
    """Return how a kind differs from the expected one; empty if it does not."""
    if kind == expected:
        return ""
    if str(kind) == str(expected):
        return "its fit estimated other numbers than the others'"
    return f"it is of another kind: {kind}"


def _check_enough(fleet: Path, usable: Mapping[str, object], left_out: Mapping[str, str]) -> None:
    """Raise NotEnoughDataError if too few cameras can be used."""
    if len(usable) >= MIN_PRIOR_CAMERAS:
        return
    why = ""
    for camera, reason in list(left_out.items())[:1]:
        why = f" (the first that was left out, {camera}: {reason})"
    raise NotEnoughDataError(
        f"A prior takes {MIN_PRIOR_CAMERAS} cameras and {fleet} has {len(usable)} that can be"
        f" used: calibrate more of them{why}."
    )


def _outliers(likelihoods: Mapping[str, LikelihoodInformation], common: Common) -> dict[str, str]:
    """Return the cameras that the other cameras do not predict, the most surprising first, each
    with the reason. MIN_PRIOR_CAMERAS always remain.
    """
    alarm = ALARM / len(likelihoods)  # Bonferroni
    remaining = dict(likelihoods)
    reasons: dict[str, str] = {}

    def expected_without(camera: str) -> Population:
        others = [likelihood for name, likelihood in remaining.items() if name != camera]
        return population(others, common.centre, common.axes, ROUGH_DRAWS)

    while len(remaining) > MIN_PRIOR_CAMERAS:
        expected = expected_without("")
        rough = {name: _p_value(likelihood, expected) for name, likelihood in remaining.items()}
        p_values: dict[str, float] = {}
        numbers: dict[str, str] = {}
        for suspect in sorted(rough, key=rough.__getitem__)[:SUSPECTS]:
            expected = expected_without(suspect)
            p_values[suspect] = _p_value(remaining[suspect], expected)
            numbers[suspect] = _most_surprising_number(remaining[suspect], expected, common)
        worst = min(p_values, key=p_values.__getitem__)
        if p_values[worst] > alarm:
            break
        reasons[worst] = (
            f"the others do not expect its {numbers[worst]} (p = {p_values[worst]:.1g})"
        )
        del remaining[worst]
    return reasons


def _p_value(likelihood: LikelihoodInformation, expected: Population) -> float:
    """Return how often chance puts a camera as far from the expected numbers."""
    return prior_conflict(likelihood, expected.mean, expected.covariance).p_value


def _most_surprising_number(
    likelihood: LikelihoodInformation, expected: Population, common: Common
) -> str:
    """Return the name of the number that a camera's views pull farthest from its expected value, in
    standard deviations; "glass" if it is one of the glass.
    """
    deviations = likelihood.deviations(expected.mean, expected.covariance)
    index = int(np.argmax(np.abs(deviations)))
    return common.names[index] if index < len(common.names) else "glass"
