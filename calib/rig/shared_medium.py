"""One medium around a rig: cameras that stand in the same water share its index.

Each camera alone finds its index of the water with an error of its own. Together they have one
number, with one prior.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from calib.calibration import Calibration
from calib.estimation.camera_model import CameraModel
from calib.rig.layout import medium_name
from calib.rig.rig_content import RigContent
from calib.rounding import with_sigma
from calib.session.schema import Number
from calib.session.shapes.layer import medium_word


@dataclass(frozen=True, slots=True)
class SharedMedium:
    """The medium outside of the covers of several cameras."""

    cameras: tuple[str, ...]
    """Two or more, in the order of the rig."""
    word: str
    """One of `calib.session.shapes.layer.MEDIA`."""
    index: Number
    """The estimate with its standard deviation."""

    def __str__(self) -> str:
        """Return a sentence without a full stop."""
        cameras = f"{', '.join(self.cameras[:-1])} and {self.cameras[-1]}"
        index = with_sigma(self.index.value, self.index.sigma)
        return f"One index of {self.word} for {cameras}: {index}"

    def as_mapping(self) -> dict[str, object]:
        """Return the entry of `--json`."""
        index = {"value": self.index.value, "sigma": self.index.sigma}
        return {"cameras": list(self.cameras), "medium": self.word, "index": index}


def find_shared_media(
    calibrations: Mapping[str, Calibration], covers: Mapping[str, str]
) -> dict[str, str]:
    """Return the first camera in the same medium, by the name of each further one.

    Cameras share a medium if each of them estimates its index, if the declared indices belong to
    the same one of air and water, and if they differ by no more than the sum of their tolerances.
    An exact index is held, and an unknown one is no declaration.

    Args:
        calibrations: of the cameras, each by itself.
        covers: the first camera behind the same cover, by the name of each further one. The index
            outside of a shared cover is shared with the cover.
    """
    declared = {
        name: medium
        for name, calibration in calibrations.items()
        if name not in covers
        and (medium := calibration.declared.cover.medium)
        and medium.sigma > 0
        and not medium.unknown
    }
    leaders: list[str] = []
    shared: dict[str, str] = {}
    for name, medium in declared.items():
        leader = next((first for first in leaders if _agree(declared[first], medium)), None)
        if leader is None:
            leaders.append(name)
        else:
            shared[name] = leader
    return shared


def _agree(first: Number, second: Number) -> bool:
    """Return True if two declared indices may be those of one medium."""
    is_near = abs(first.value - second.value) <= first.sigma + second.sigma
    return is_near and medium_word(first.value) == medium_word(second.value)


def with_shared_media(
    models: Mapping[str, CameraModel],
    calibrations: Mapping[str, Calibration],
    media: Mapping[str, str],
) -> dict[str, CameraModel]:
    """Return the models of the cameras with one prior for the index of each shared medium.

    It is the tightest of the declared ones. If the views of a camera contradict the index that it
    declares, it is the widened prior of that camera: all stand in the same medium.

    Args:
        models: of all cameras.
        calibrations: theirs, each by itself.
        media: `find_shared_media`.
    """
    changed = dict(models)
    for first in dict.fromkeys(media.values()):
        members = [first, *(name for name, leader in media.items() if leader == first)]
        doubting = [
            name
            for name in members
            if medium_name(models[name].path) in calibrations[name].declared.doubted
        ]
        source = min(doubting or members, key=lambda name: _prior(models[name]).sigma)
        prior = _prior(models[source])
        for name in members:
            changed[name] = _with_prior(models[name], prior)
    return changed


def _prior(model: CameraModel) -> Number:
    """Return the prior of the index outside of all covers."""
    name = medium_name(model.path)
    return Number(float(model.means[name]), float(model.priors.sigmas[name]))


def _with_prior(model: CameraModel, prior: Number) -> CameraModel:
    """Return a model with another prior of the index outside of all covers, which is independent of
    the camera's numbers: several cameras share it.
    """
    name = medium_name(model.path)
    mean = model.means[name].new_tensor(prior.value)
    sigmas = {**model.priors.sigmas, name: prior.sigma}
    correlations = {
        pair: value for pair, value in model.priors.correlations.items() if name not in pair
    }
    priors = replace(model.priors, sigmas=sigmas, correlations=correlations)
    return replace(model, means={**model.means, name: mean}, priors=priors)


def shared_media(rig: RigContent) -> Iterator[SharedMedium]:
    """Yield the media that cameras of a calibrated rig share, with the estimated indices."""
    for first in dict.fromkeys(rig.media.values()):
        members = {first, *(name for name, leader in rig.media.items() if leader == first)}
        cameras = tuple(name for name in rig.names if rig.covers.get(name, name) in members)
        medium = rig.calibrations[first].cover.medium
        assert medium
        yield SharedMedium(cameras, medium_word(medium.value), medium)
