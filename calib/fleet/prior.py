"""A fleet's own prior: what its cameras' calibrations say of the next camera of their make."""

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
from calib.fleet.population import FEWEST, ROUGHLY, Population, population
from calib.fleet.result import CAMERAS, Result, State, read_result
from calib.io.files import reading
from calib.session.camera import Camera
from calib.session.fleet_prior import FleetPrior
from calib.session.lens import SPLINED
from calib.session.numbers import numbers_of
from calib.verdict.verdict import Word

ELSEWHERE = ("the board", "each single view", "the corners' detector")
"""What effects may be about whose finding leaves a camera's own numbers as they are."""
ALARM = 0.05
"""Chance that a fleet without a fault has a camera that is left out as an outlier."""
SUSPECTS = 3
"""Cameras at a time that are held against the others."""


@dataclass(frozen=True, slots=True)
class Kind:
    """What cameras must have alike to have numbers in common."""

    width: int
    height: int
    lens: str
    coefficients: int
    shape: str
    estimated: tuple[str, ...]

    @staticmethod
    def of(one: Calibration) -> Kind:
        k = one.camera.intrinsics
        assert k
        estimated = tuple(name for name, number in numbers_of(k, one.cover).items() if number.sigma)
        return Kind(
            one.camera.width,
            one.camera.height,
            k.model,
            len(k.distortion) if k.distorts else 0,
            one.cover.shape,
            estimated,
        )

    def __str__(self) -> str:
        cover = f"behind a {self.shape}" if self.shape != "none" else "without a cover"
        return (
            f"{self.width}x{self.height} px, {self.lens} with {self.coefficients} coefficients,"
            f" {cover}"
        )


def fleet_prior(fleet: Path) -> FleetPrior:
    """Of the calibrations in a fleet's folder.

    Raises:
        InputError: it is none, or its cameras are of several kinds, none of which most are.
        NotEnoughDataError: too few of its cameras can be used.
    """
    out: dict[str, str] = {}
    found: dict[str, Calibration] = {}
    for camera in _cameras(fleet):
        try:
            result = read_result(fleet, camera)
            because = _unusable(result)
            if not because:
                assert result
                found[camera] = _last(fleet, result)
                because = _unlike_itself(found[camera])
        except RefracalError as error:
            because = f"its calibration cannot be read ({brief(error)})"
        if because:
            found.pop(camera, None)
            out[camera] = because
    kind = _common(fleet, found, out)
    found = {camera: one for camera, one in found.items() if camera not in out}
    _check_enough(fleet, found, out)
    common = Common.of(kind.estimated, Camera(kind.width, kind.height), list(found.values()))
    told = {camera: common.told(one) for camera, one in found.items()}
    _leave_outliers(told, common, out)
    _check_enough(fleet, told, out)
    known = population(list(told.values()), common.centre, common.axes)
    expected = common.described(known)
    return FleetPrior(
        Path(),
        "",
        Camera(kind.width, kind.height, intrinsics=expected[0]),
        expected[1],
        (common.intrinsics, common.cover),
        known.cameras,
        tuple(sorted(out.items())),
    )


def _cameras(fleet: Path) -> list[str]:
    folder = fleet / CAMERAS
    with reading(folder):
        if not folder.is_dir():
            raise InputError(
                f"{fleet} has no folder {CAMERAS}: give the FLEET that calib batch wrote."
            )
        found = sorted(path.stem for path in folder.glob("*.json") if not path.name.startswith("."))
    if not found:
        raise InputError(f"{folder} has no cameras: give the FLEET that calib batch wrote.")
    return found


def _unusable(result: Result | None) -> str:
    """Why; empty where a result may be used."""
    if not result:
        return "its result is not whole, or of another version"
    if result.state is not State.CALIBRATED:
        return f"it has no calibration: {result.sentence.rstrip('.')}"
    if result.verdict.get("word") == Word.DO_NOT_USE.value:
        return "its verdict is not to use it"
    return ""


def _last(fleet: Path, result: Result) -> Calibration:
    path = next(
        (path for path in reversed(result.written) if path.endswith("calibration.yaml")), ""
    )
    if not path:
        raise InputError(f"{result.id} names no calibration: run calib batch again.")
    return Calibration.load(fleet / path)


def _unlike_itself(one: Calibration) -> str:
    """Why a calibration's numbers are not what its make could have; empty where they are."""
    k = one.camera.intrinsics
    assert k
    if one.cover.shape == "none":
        return "it has no cover, and a camera alone takes its numbers from its own views"
    if k.model == SPLINED:
        return "its lens is a spline, whose numbers no other lens shares"
    own = [added.effect.name for added in one.effects if added.effect.about not in ELSEWHERE]
    if own:
        return f"its diagnosis found {', '.join(own)}"
    if not one.relief or not one.settings.get("relief_prior"):
        return "its fit estimated no relief by its evidence"
    if not one.covariance.size or not Kind.of(one).estimated:
        return "its fit held every number as it is declared"
    if one.settings.get("fleet_prior", {}).get("used"):
        return "it was fitted with a fleet's prior, which would be counted twice"
    return ""


def _common(fleet: Path, found: Mapping[str, Calibration], out: dict[str, str]) -> Kind:
    """The kind of most cameras; the others are left out."""
    kinds = {camera: Kind.of(one) for camera, one in found.items()}
    if not kinds:
        _check_enough(fleet, found, out)
    counts = Counter(kinds.values()).most_common()
    kind, most = counts[0]
    if 2 * most <= len(kinds) and len(counts) > 1:
        said = "; ".join(f"{count} are {other}" for other, count in counts[:3])
        raise InputError(
            f"{fleet} has cameras of {len(counts)} kinds, none of which most are ({said}): run"
            " calib batch for each kind."
        )
    for camera, other in kinds.items():
        if other != kind:
            alike = str(other) == str(kind)
            out[camera] = (
                "its fit estimated other numbers than the others'"
                if alike
                else f"it is of another kind: {other}"
            )
    return kind


def _check_enough(fleet: Path, found: Mapping[str, object], out: Mapping[str, str]) -> None:
    if len(found) < FEWEST:
        first = next(((camera, because) for camera, because in out.items()), None)
        why = f" (the first that was left out, {first[0]}: {first[1]})" if first else ""
        raise NotEnoughDataError(
            f"A prior takes {FEWEST} cameras and {fleet} has {len(found)} that can be used:"
            f" calibrate more of them{why}."
        )


def _leave_outliers(
    told: dict[str, LikelihoodInformation], common: Common, out: dict[str, str]
) -> None:
    """Without those that the others do not expect, the farthest first."""
    alarm = ALARM / len(told)
    while len(told) > FEWEST:
        every = population(list(told.values()), common.centre, common.axes, ROUGHLY)
        far = {camera: _surprise(one, every) for camera, one in told.items()}
        suspects = sorted(far, key=far.__getitem__)[:SUSPECTS]
        by = {}
        for camera in suspects:
            others = population(
                [one for other, one in told.items() if other != camera],
                common.centre,
                common.axes,
                ROUGHLY,
            )
            by[camera] = _surprise(told[camera], others), _farthest(told[camera], others, common)
        worst = min(by, key=lambda camera: by[camera][0])
        p_value, name = by[worst]
        if p_value > alarm:
            return
        out[worst] = f"the others do not expect its {name} (p = {p_value:.1g})"
        del told[worst]


def _surprise(one: LikelihoodInformation, known: Population) -> float:
    return prior_conflict(one, known.mean, known.covariance).p_value


def _farthest(one: LikelihoodInformation, known: Population, common: Common) -> str:
    """The number that its views pull farthest, in the standard deviations that it may have."""
    at = int(np.argmax(np.abs(one.deviations(known.mean, known.covariance))))
    return common.names[at] if at < len(common.names) else "glass"
