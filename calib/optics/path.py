"""The ray path: from a pixel through the lens, then through each surface of the cover in order, to
the board.

`Path` is an ordered tuple of stages, the paper's Fig. 3. Effects change it: by adjustments before
the lens, by other stages, by a board that is not flat. Forward tracing is from the camera outwards;
`projection` solves the inverse.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import torch
from torch import Tensor

from calib.optics.board_target import FLEX, MOTION, POSE, Placement, Target
from calib.optics.interface import Interface
from calib.optics.lens import Lens
from calib.optics.linear_part import LinearPart
from calib.optics.params import LINE, Param, Values
from calib.optics.rays import Rays
from calib.optics.relief import Relief


class Adjustment(Protocol):
    """Changes what the stages read, before a ray starts: a focal length that drifts, a corner that
    the detector puts aside.

    It leads from the seen pixel to the true one: what was seen too far right by s is moved by -s.
    """

    @property
    def params(self) -> tuple[Param, ...]: ...

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        """(..., 2) px and the parameters, as the stages are to have them."""
        ...


@dataclass(frozen=True, slots=True)
class Path:
    """An ordered tuple of named, frozen, pure stages (the paper's Fig. 3).

    Its parameters are passed to each call.
    """

    lens: Lens
    cover: tuple[Interface, ...] = ()
    target: Target = field(default_factory=Target)
    adjustments: tuple[Adjustment, ...] = ()
    shutter: bool = False
    """Whether boards move while a picture is read out: then every view has a motion beside its
    pose.
    """
    sizes: tuple[tuple[str, float], ...] = ()
    """How large the parts are that views have for themselves beside their poses, over what is
    possible at most; 1 of those not named.
    """

    @property
    def params(self) -> tuple[Param, ...]:
        """Every number that some stage reads, once, in the order of the path."""
        read = [
            param
            for stage in (*self.adjustments, *self.stages, self.target)
            for param in stage.params
        ]
        return tuple({param.name: param for param in read}.values())

    @property
    def central(self) -> bool:
        """Whether all rays come from one point, so that a picture is distorted alike at every
        depth.
        """
        return not (self.cover or self.lens.pupil)

    @property
    def directly_projects(self) -> bool:
        """Whether the lens alone says which pixel sees a point, beside and behind the pinhole,
        too.
        """
        return self.lens.wide and self.central and not self.adjustments

    def distance(self, points: Tensor) -> Tensor:
        """Return the (...) m distances of (..., 3) m points in the camera frame.

        It is the depth z, as in maps, unless the lens is wide. A wide lens sees points beside and
        behind the camera, whose depth is 0 or less, so its distances are measured from the origin.
        """
        return points.norm(dim=-1) if self.lens.wide else points[..., 2]

    @property
    def view_parts(self) -> tuple[str, ...]:
        """What every view has for itself, of `board_target.PARTS`."""
        return (POSE, *([MOTION] if self.shutter else []), *([FLEX] if self.target.flex else []))

    @property
    def private(self) -> bool:
        """Whether views have more for themselves than a pose."""
        return len(self.view_parts) > 1

    @property
    def relief(self) -> Relief | None:
        """Of the cover's outer surface."""
        return self.cover[-1].relief if self.cover else None

    @property
    def stages(self) -> tuple[Lens | Interface, ...]:
        """What a ray passes before the board."""
        return (self.lens, *self.cover)

    def trace(self, pixels: Tensor, values: Values) -> Rays:
        """(..., 2) px to the rays that leave the cover."""
        pixels, values = self.adjusted(pixels, values)
        return self.onward(self.lens(pixels, values), values, 1)

    def adjusted(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        """(..., 2) px and the parameters as the stages read them."""
        for adjust in self.adjustments:
            pixels, values = adjust(pixels, values)
        return pixels, values

    def linear_parts(
        self, pixels: Tensor, values: Values, landed: Tensor | None = None
    ) -> Iterator[tuple[LinearPart, Tensor, Tensor]]:
        """Its parts that are linear in their parameters, and the (...) coordinates that they are
        asked at, by rays of (..., 2) px that landed at (..., 2) m nominal board coordinates; None:
        no board is asked about.
        """
        for adjust in self.adjustments:
            if isinstance(adjust, LinearPart):
                yield adjust, pixels[..., 0], pixels[..., 1]
            pixels, values = adjust(pixels, values)
        if landed is not None:
            yield from self.target.linear_parts(landed, values)

    def onward(self, rays: Rays, values: Values, passed: int) -> Rays:
        """Rays that have passed the lens and `passed` stages in all to the rays that leave the
        cover; values already adjusted.
        """
        for interface in self.cover[passed - 1 :]:
            rays = interface(rays, values)
        return rays

    def land(self, pixels: Tensor, values: Values, poses: Tensor) -> tuple[Tensor, Tensor]:
        """(..., 2) px and (..., B) own parameters of boards, their poses first, to (..., 2) m on
        the board and (...) uint8 failures.
        """
        return self.target(
            self.trace(pixels, values), Placement.of(poses).during(values.get(LINE)), values
        )

    def place(self, corners: Tensor, values: Values, poses: Tensor) -> Tensor:
        """(..., 2) m board coordinates on boards with (..., B) own parameters to (..., 3) m in the
        camera frame.
        """
        return self.target.place(corners, Placement.of(poses).during(values.get(LINE)), values)


def by_row(outputs: Tensor, inputs: Sequence[Tensor]) -> list[Tensor]:
    """Derivatives of a function that treats every row by itself.

    Two reverse passes serve any number of inputs, so this is far cheaper than a forward pass for
    each input.

    Args:
        outputs: (N, k), computed from the inputs.
        inputs: (N, ...) each, requiring gradients: row n of the outputs depends on row n alone.

    Returns:
        For each input its (N, k, ...) derivative, zero where the outputs do not depend on it.
    """
    k = outputs.shape[-1]
    passes = [
        torch.autograd.grad(
            outputs[..., i].sum(),
            inputs,
            retain_graph=i < k - 1,
            allow_unused=True,
            materialize_grads=True,
        )
        for i in range(k)
    ]
    return [torch.stack(columns, 1) for columns in zip(*passes, strict=True)]
