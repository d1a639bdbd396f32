"""The places of all numbers in the vector of a rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from calib.estimation.camera_model import CameraModel
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES
from calib.session.cover import MEDIUM
from calib.session.parameter_names import NUMBER, number_of

MOUNTING = "mounting"
"""The prefix of a mounting among the values of a ray path that reads it."""


@dataclass(frozen=True, slots=True)
class RigLayout:
    """The places of the cameras' parameters and mountings in the vector of a rig.

    The cameras' parameters come first, camera by camera, in the order of each camera's own vector.
    A parameter that cameras share stands where the first of them has it: the board's shape and
    print are those of all cameras, the cover's numbers and its relief those of a shared cover, the
    index outside of the covers that of a shared medium. Then come the six numbers of each mounting
    but the reference's.
    """

    columns: tuple[Tensor, ...]
    """For each camera, (S_c,) int64: the places of its own vector."""
    mountings: tuple[Tensor, ...]
    """For each camera, (6,) int64: the places of its mounting; (0,) for the reference."""
    frames: tuple[int, ...]
    """For each camera, the camera in whose frame its boards are placed: itself, or the first one
    behind a shared cover.
    """
    count: int
    """S, the length of the vector."""
    media: Mapping[str, str] = field(default_factory=dict)
    """The first camera in the same medium, by the name of each further one."""

    @staticmethod
    def of(
        names: Sequence[str],
        models: Sequence[CameraModel],
        reference: str,
        covers: Mapping[str, str] = {},
        media: Mapping[str, str] = {},
    ) -> RigLayout:
        """Return the layout of cameras.

        Args:
            names: of the cameras.
            models: theirs.
            reference: the name of the reference.
            covers: the first camera behind the same cover, by the name of each camera that shares
                its cover with an earlier one.
            media: the first camera in the same medium, by the name of each camera that shares its
                medium with an earlier one.
        """
        places: dict[tuple[str, str], Tensor] = {}
        entries: list[list[tuple[str, str]]] = []
        count = 0
        for name, model in zip(names, models, strict=True):
            keys = []
            medium = medium_name(model.path)
            for parameter, place in model.parameters.slices().items():
                owner = _owner(name, parameter, model, covers)
                is_medium = parameter == medium
                key = (media.get(owner, owner), MEDIUM) if is_medium else (owner, parameter)
                keys.append(key)
                if key not in places and not parameter.startswith(MOUNTING):
                    size = place.stop - place.start
                    places[key] = torch.arange(count, count + size)
                    count += size
            entries.append(keys)
        mountings = []
        for name in names:
            size = 0 if name == reference else 6
            places["", f"{MOUNTING}.{name}"] = torch.arange(count, count + size)
            mountings.append(torch.arange(count, count + size))
            count += size
        empty = torch.zeros(0, dtype=torch.int64)
        columns = [torch.cat([empty, *(places[key] for key in keys)]) for keys in entries]
        frames = [names.index(covers.get(name, name)) for name in names]
        return RigLayout(
            columns=tuple(columns),
            mountings=tuple(mountings),
            frames=tuple(frames),
            count=count,
            media=media,
        )

    def of_models(self, names: Sequence[str], models: Sequence[CameraModel]) -> RigLayout:
        """Return the layout of the same cameras with other models."""
        reference = next(
            name for name, entries in zip(names, self.mountings, strict=True) if not len(entries)
        )
        covers = {
            name: names[frame]
            for name, frame in zip(names, self.frames, strict=True)
            if names[frame] != name
        }
        return RigLayout.of(names, models, reference, covers, self.media)


def medium_name(path: Path) -> str:
    """Return the name of the index outside of all covers of a path; "" without a cover."""
    names = [param.name for param in path.params if number_of(param.name) == MEDIUM]
    return names[-1] if names else ""


def _owner(name: str, parameter: str, model: CameraModel, covers: Mapping[str, str]) -> str:
    """Return the name of the camera whose parameter this is; "" for one of the board or a
    mounting.
    """
    board = {param.name for param in model.path.target.params}
    if parameter in board or parameter.startswith(MOUNTING):
        return ""
    is_cover = parameter == AMPLITUDES or NUMBER.fullmatch(parameter)
    return covers.get(name, name) if is_cover else name
