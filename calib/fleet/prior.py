"""A fleet's prior: the numbers and glass that its calibrations predict for the next camera of their
make.
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
"""Probability that a fleet without a fault loses a camera as an outlier."""
SUSPECTS = 3
"""Cameras at a time that are compared with a population without them."""


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

    @staticmethod
    def of(calibration: Calibration) -> Kind:
        k = calibration.camera.intrinsics
        assert k
        estimated = tuple(
            name for name, number in numbers_of(k, calibration.cover).items() if number.sigma
        )
        covered = calibration.cover.shape != "none"
        return Kind(
            calibration.camera.width,
            calibration.camera.height,
            k.model,
            len(k.distortion) if k.distorts else 0,
            f"behind {calibration.cover.words}" if covered else "without a cover",
            estimated,
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
    out: dict[str, str] = {}
    calibrations: dict[str, Calibration] = {}
    for camera in _cameras(fleet):
        try:
            result = read_result(fleet, camera)
            because = _unusable(result)
            if not because:
                assert result
                calibrations[camera] = _last(fleet, result)
                because = _unlike_itself(calibrations[camera])
        except RefracalError as error:
            because = f"its calibration cannot be read ({brief(error)})"
        if because:
            calibrations.pop(camera, None)
            out[camera] = because
    kind = _common(fleet, calibrations, out)
    calibrations = {
        camera: calibration for camera, calibration in calibrations.items() if camera not in out
    }
    _check_enough(fleet, calibrations, out)
    common = Common.of(kind.estimated, Camera(kind.width, kind.height), list(calibrations.values()))
    likelihoods = {
        camera: common.likelihood(calibration) for camera, calibration in calibrations.items()
    }
    _leave_outliers(likelihoods, common, out)
    _check_enough(fleet, likelihoods, out)
    expected = population(list(likelihoods.values()), common.centre, common.axes)
    description = common.described(expected)
    return FleetPrior(
        Path(),
        "",
        Camera(kind.width, kind.height, intrinsics=description[0]),
        description[1],
        (common.intrinsics, common.cover),
        expected.cameras,
        tuple(sorted(out.items())),
    )


def _cameras(fleet: Path) -> list[str]:
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


def _unusable(result: Result | None) -> str:
    """Return why a result cannot be used; empty if it can."""
    if not result:
        return "its result is not whole, or of another version"
    if result.state is not JobState.CALIBRATED:
        return f"it has no calibration: {result.sentence.rstrip('.')}"
    if result.verdict.get("word") == Trust.DO_NOT_USE.value:
        return "its verdict is not to use it"
    return ""


def _last(fleet: Path, result: Result) -> Calibration:
    path = next((path for path in reversed(result.written) if path.endswith(CALIBRATION_FILE)), "")
    if not path:
        raise InputError(f"{result.id} names no calibration: run calib batch again.")
    return Calibration.load(fleet / path)


def _unlike_itself(calibration: Calibration) -> str:
    """Return why a calibration's numbers do not describe its make; empty if they do."""
    k = calibration.camera.intrinsics
    assert k
    if calibration.cover.shape == "none":
        return "it has no cover, and a camera alone takes its numbers from its own views"
    if k.model == SPLINED:
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


def _common(fleet: Path, calibrations: Mapping[str, Calibration], out: dict[str, str]) -> Kind:
    """Return the kind of most cameras, and note the cameras of other kinds as left out."""
    kinds = {camera: Kind.of(calibration) for camera, calibration in calibrations.items()}
    if not kinds:
        _check_enough(fleet, calibrations, out)
    counts = Counter(kinds.values()).most_common()
    kind, majority = counts[0]
    if 2 * majority <= len(kinds) and len(counts) > 1:
        listing = "; ".join(f"{count} are {rival}" for rival, count in counts[:3])
        raise InputError(
            f"{fleet} has cameras of {len(counts)} kinds, and no kind has more than half of them"
            f" ({listing}): run calib batch for each kind."
        )
    for camera, camera_kind in kinds.items():
        if camera_kind != kind:
            alike = str(camera_kind) == str(kind)
            out[camera] = (
                "its fit estimated other numbers than the others'"
                if alike
                else f"it is of another kind: {camera_kind}"
            )
    return kind


def _check_enough(fleet: Path, usable: Mapping[str, object], out: Mapping[str, str]) -> None:
    if len(usable) < MIN_PRIOR_CAMERAS:
        first = next(((camera, because) for camera, because in out.items()), None)
        why = f" (the first that was left out, {first[0]}: {first[1]})" if first else ""
        raise NotEnoughDataError(
            f"A prior takes {MIN_PRIOR_CAMERAS} cameras and {fleet} has {len(usable)} that can be"
            f" used: calibrate more of them{why}."
        )


def _leave_outliers(
    likelihoods: dict[str, LikelihoodInformation], common: Common, out: dict[str, str]
) -> None:
    """Remove cameras that the other cameras do not predict, the most surprising first."""
    alarm = ALARM / len(likelihoods)
    while len(likelihoods) > MIN_PRIOR_CAMERAS:
        fleet = population(list(likelihoods.values()), common.centre, common.axes, ROUGH_DRAWS)
        p_values = {camera: _surprise(views, fleet) for camera, views in likelihoods.items()}
        suspects = sorted(p_values, key=p_values.__getitem__)[:SUSPECTS]
        tests: dict[str, tuple[float, str]] = {}
        for suspect in suspects:
            remainder = population(
                [views for camera, views in likelihoods.items() if camera != suspect],
                common.centre,
                common.axes,
                ROUGH_DRAWS,
            )
            views = likelihoods[suspect]
            tests[suspect] = _surprise(views, remainder), _farthest(views, remainder, common)
        worst = min(tests, key=lambda camera: tests[camera][0])
        p_value, name = tests[worst]
        if p_value > alarm:
            return
        out[worst] = f"the others do not expect its {name} (p = {p_value:.1g})"
        del likelihoods[worst]


def _surprise(views: LikelihoodInformation, expected: Population) -> float:
    return prior_conflict(views, expected.mean, expected.covariance).p_value


def _farthest(views: LikelihoodInformation, expected: Population, common: Common) -> str:
    """Return the number that the views pull farthest from its expected value, in sigmas."""
    at = int(np.argmax(np.abs(views.deviations(expected.mean, expected.covariance))))
    return common.names[at] if at < len(common.names) else "glass"
