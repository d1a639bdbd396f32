"""A fleet's own prior: what its cameras' calibrations say of the next camera of their make."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError, NotEnoughDataError, RefracalError, brief
from calib.estimation.doubt import DOUBT
from calib.estimation.stated_priors import widened
from calib.estimation.surprise import Told, surprise
from calib.fleet.population import FEWEST, ROUGHLY, Population, population
from calib.fleet.result import CAMERAS, Result, State, read_result
from calib.io.files import reading
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.fleet_prior import FleetPrior
from calib.session.freeing import ALL, with_free
from calib.session.lens import SPLINED
from calib.session.numbers import covariance_of, numbers_of, with_covariance, with_numbers
from calib.session.schema import Number
from calib.verdict.verdict import Word

Array = NDArray[np.float64]

ELSEWHERE = ("the board", "each single view", "the corners' detector")
"""What effects may be about whose finding leaves a camera's own numbers as they are."""
LOOSE = 1e3
"""Times its tolerance: as good as no prior at all."""
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
        return Kind(one.camera.width, one.camera.height, k.model, len(k.distortion) if k.distorts else 0, one.cover.shape, estimated)

    def __str__(self) -> str:
        cover = f"behind a {self.shape}" if self.shape != "none" else "without a cover"
        return f"{self.width}x{self.height} px, {self.lens} with {self.coefficients} coefficients, {cover}"


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
    intrinsics, cover = _drawing(list(found.values()))
    told = {camera: _told(one, kind.estimated, numbers_of(intrinsics, cover)) for camera, one in found.items()}
    centre, axes = _axes(intrinsics, cover, kind.estimated)
    _leave_outliers(told, centre, axes, kind.estimated, out)
    _check_enough(fleet, told, out)
    known = population(list(told.values()), centre, axes)
    plain = {name: Number(number.value) for name, number in numbers_of(intrinsics, cover).items()}
    expected = with_covariance(*with_numbers(intrinsics, cover, plain), kind.estimated, known.mean, known.covariance)
    camera = Camera(kind.width, kind.height, intrinsics=expected[0])
    return FleetPrior(Path(), "", camera, expected[1], (intrinsics, cover), known.cameras, tuple(sorted(out.items())))


def _cameras(fleet: Path) -> list[str]:
    folder = fleet / CAMERAS
    with reading(folder):
        if not folder.is_dir():
            raise InputError(f"{fleet} has no folder {CAMERAS}: give the FLEET that calib batch wrote.")
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
    path = next((path for path in reversed(result.written) if path.endswith("calibration.yaml")), "")
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
        raise InputError(f"{fleet} has cameras of {len(counts)} kinds, none of which most are ({said}): run calib batch for each kind.")
    for camera, other in kinds.items():
        if other != kind:
            alike = str(other) == str(kind)
            out[camera] = "its fit estimated other numbers than the others'" if alike else f"it is of another kind: {other}"
    return kind


def _check_enough(fleet: Path, found: Mapping[str, object], out: Mapping[str, str]) -> None:
    if len(found) < FEWEST:
        first = next(((camera, because) for camera, because in out.items()), None)
        why = f" (the first that was left out, {first[0]}: {first[1]})" if first else ""
        raise NotEnoughDataError(
            f"A prior takes {FEWEST} cameras and {fleet} has {len(found)} that can be used: calibrate more of them{why}."
        )


def _drawing(found: Sequence[Calibration]) -> tuple[Intrinsics, Cover]:
    """What most sessions declare, each number with its tolerance; where they differ, as measured numbers do, their median, by the tolerance
    of its kind."""
    first = found[0].declared
    said = [numbers_of(one.declared.intrinsics, one.declared.cover) for one in found]
    common: dict[str, Number] = {}
    measured: dict[str, Number] = {}
    for name in said[0]:
        number, times = Counter(one[name] for one in said).most_common(1)[0]
        if 2 * times > len(said):
            common[name] = number
        else:
            measured[name] = Number(float(np.median([one[name].value for one in said])))
    by_kind = numbers_of(*with_free(*with_numbers(first.intrinsics, first.cover, common | measured), (ALL,)))
    return with_numbers(first.intrinsics, first.cover, common | {name: by_kind[name] for name in measured})


def _told(one: Calibration, names: tuple[str, ...], drawing: Mapping[str, Number]) -> Told:
    """What a camera's views say, and its own measurements: its calibration, less what the drawing had put in."""
    parameters = one.camera_model().parameters
    places = parameters.entries(names)
    scales = np.array([param.scale for name in names for param in parameters.free if param.name == name])
    covariance = one.covariance[np.ix_(places, places)] * scales[:, None] * scales
    intrinsics, cover = one.declared.intrinsics, one.declared.cover
    declared = numbers_of(intrinsics, cover)
    for name in one.declared.doubted:
        intrinsics, cover = widened(intrinsics, cover, name, DOUBT)
    for name in names:
        if declared[name] != drawing[name]:  # a measurement of this camera, which stays
            intrinsics, cover = widened(intrinsics, cover, name, LOOSE)
    assert one.camera.intrinsics
    estimate = numbers_of(one.camera.intrinsics, one.cover)
    mean, stated = (np.array([numbers[name].value for name in names]) for numbers in (estimate, declared))
    return Told.between(mean, covariance, stated, covariance_of(intrinsics, cover, names))


def _axes(intrinsics: Intrinsics, cover: Cover, names: tuple[str, ...]) -> tuple[Array, Array]:
    """(K,) what is declared, and the (K, K) directions in which cameras differ independently: each number by itself, but the focal lengths of
    x and y together and against each other, for one lens makes both."""
    drawing = numbers_of(intrinsics, cover)
    axes = np.diag([drawing[name].sigma for name in names])
    if {"camera.fx", "camera.fy"} <= {*names}:
        both = [names.index("camera.fx"), names.index("camera.fy")]
        axes[np.ix_(both, both)] = axes[np.ix_(both, both)] @ np.array([[1, 1], [1, -1]]) / np.sqrt(2)
    return np.array([drawing[name].value for name in names]), axes


def _leave_outliers(told: dict[str, Told], centre: Array, axes: Array, names: tuple[str, ...], out: dict[str, str]) -> None:
    """Without those that the others do not expect, the farthest first."""
    alarm = ALARM / len(told)
    while len(told) > FEWEST:
        every = population(list(told.values()), centre, axes, ROUGHLY)
        far = {camera: _surprise(one, every) for camera, one in told.items()}
        suspects = sorted(far, key=far.__getitem__)[:SUSPECTS]
        by = {}
        for camera in suspects:
            others = population([one for other, one in told.items() if other != camera], centre, axes, ROUGHLY)
            by[camera] = _surprise(told[camera], others), _farthest(told[camera], others, names)
        worst = min(by, key=lambda camera: by[camera][0])
        p_value, name = by[worst]
        if p_value > alarm:
            return
        out[worst] = f"the others do not expect its {name} (p = {p_value:.1g})"
        del told[worst]


def _surprise(one: Told, known: Population) -> float:
    return surprise(one, known.mean, known.covariance, known.cameras).p_value


def _farthest(one: Told, known: Population, names: tuple[str, ...]) -> str:
    """The number that its views pull farthest, in the standard deviations that it may have."""
    return names[int(np.argmax(np.abs(one.pulls(known.mean, known.covariance))))]
