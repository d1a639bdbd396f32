"""The ray path: from a pixel through the lens, then through each surface of the cover in order, to
the board.

`Path` is an ordered tuple of stages, the paper's Fig. 3. An effect changes the path: it adds an
adjustment in front of the lens, replaces a stage, or bends the board.

`Path.trace` goes from pixels to rays that leave the cover, `Path.land` on to the board, and
`Path.place` from corners to points in space. `trace_with_derivatives` keeps what the derivatives
need: each stage returns its result and a function that pulls derivatives back through it.
`projection` solves the inverse, from a point to its pixel.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby
from typing import Protocol

import torch
from torch import Tensor

from calib.optics.board_target import Landing, Target
from calib.optics.crossing import Crossing
from calib.optics.derivatives import ByName, ByRay, add_to, by_autograd
from calib.optics.exposure import MIDDLE, Exposure
from calib.optics.interface import Interface, records
from calib.optics.lens import PIXELS, Lens
from calib.optics.linear_term import LinearTerm
from calib.optics.params import Param, Values
from calib.optics.placement import Placement
from calib.optics.rays import Rays
from calib.optics.relief import Relief
from calib.optics.relief_view import described_at
from calib.optics.view_blocks import (
    CENTRE,
    FLEX,
    FOCAL,
    MOTION,
    POSE,
    block_columns,
    blocks_of_size,
)
from calib.session.parameter_names import CAMERA

OWN = "camera of the view"
"""The name of the derivatives by the camera of each ray's view (`Path.camera_block`)."""


class Adjustment(Protocol):
    """A change of the pixels and values before a ray starts, for example a focal length that
    drifts, or a bias of the corner detector.

    It leads from the observed pixel to the true one: if corners are observed too far right by s, it
    moves their pixels by -s.
    """

    @property
    def params(self) -> tuple[Param, ...]: ...

    def __call__(
        self, pixels: Tensor, values: Values, exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        """Return the (..., 2) px and the values that the stages read."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """M rays where they leave the cover, and their derivatives in closed form."""

    rays: Rays
    relief_chart: tuple[Tensor, Tensor] | None
    """The two (M,) chart coordinates at which the outer relief is read; None without a relief."""
    relief_factors: tuple[Tensor | float, ...]
    """The factors of the relief's height and of its two slopes on the chart."""
    pull: Callable[[ByRay], ByName]
    """A function from the (k, M) derivatives of k outputs by the rays to those by name."""


@dataclass(frozen=True, slots=True)
class Path:
    """An ordered tuple of named, frozen, pure stages (the paper's Fig. 3).

    Each call takes the values of its parameters and the exposure of the rays.
    """

    lens: Lens
    cover: tuple[Interface, ...] = ()
    target: Target = field(default_factory=Target)
    adjustments: tuple[Adjustment, ...] = ()
    shutter: bool = False
    """True if boards move while a picture is read out: then every view has a motion block next to
    its pose.
    """
    camera_block: str = ""
    """FOCAL if every view has a focal length of its own, given as the fraction by which it is
    longer than the shared one; CENTRE if every view has a principal point of its own, given as a
    shift in px; empty if views share the camera.
    """
    block_scales: tuple[tuple[str, float], ...] = ()
    """(block, scale): the size of a per-view block over its largest plausible size; 1 for a block
    that is not listed.
    """

    @property
    def params(self) -> tuple[Param, ...]:
        """Every parameter that some stage reads, once, in the order of the path."""
        params = [
            param
            for stage in (*self.adjustments, *self.stages, self.target)
            for param in stage.params
        ]
        return tuple({param.name: param for param in params}.values())

    @property
    def central(self) -> bool:
        """True if all rays come from one point, so that the distortion of a picture does not depend
        on depth.
        """
        return not (self.cover or self.lens.pupil)

    @property
    def directly_projects(self) -> bool:
        """True if the lens alone gives the pixel of a point, even beside and behind the pinhole."""
        return self.lens.wide and self.central and not self.adjustments

    def distance(self, points: Tensor) -> Tensor:
        """Return the (...) m distances of (..., 3) m points in the camera frame.

        It is the depth z, as in maps, unless the lens is wide. A wide lens sees points beside and
        behind the camera, whose depth is 0 or less, so its distances are measured from the origin.
        """
        return points.norm(dim=-1) if self.lens.wide else points[..., 2]

    @property
    def view_blocks(self) -> tuple[str, ...]:
        """The blocks of `view_blocks.VIEW_BLOCKS` that every view has."""
        return (
            POSE,
            *([MOTION] if self.shutter else []),
            *([FLEX] if self.target.flex else []),
            *([self.camera_block] if self.camera_block else []),
        )

    @property
    def has_private_blocks(self) -> bool:
        """True if views have parameters of their own in addition to their poses."""
        return len(self.view_blocks) > 1

    @property
    def outermost(self) -> tuple[Interface, ...]:
        """The interfaces of the outermost cover, from the inside out; none without a cover."""
        return tuple(
            stage for stage in self.cover if stage.surface.names == self.cover[-1].surface.names
        )

    @property
    def relief(self) -> Relief | None:
        """The relief of the outermost surface of the cover."""
        return self.cover[-1].relief if self.cover else None

    def settled_relief(self, values: Values) -> Relief | None:
        """Return the relief, described for these values: if it has an anchor, as the camera sees it
        there.
        """
        if not self.relief or not self.relief.anchor:
            return self.relief
        middle = next(iter(values.values())).new_zeros(1, 2)
        _, values = self.adjust_pixels(middle, values, MIDDLE)
        view = self.cover[-1].relief_view(values)
        return described_at(self.relief, view.anchor, view.size)

    def relief_growth(self, values: Values) -> float:
        """Return the height of the outer relief over that of its own size; 1 without one."""
        middle = next(iter(values.values())).new_zeros(1, 2)
        _, values = self.adjust_pixels(middle, values, MIDDLE)
        place = self.cover[-1].relief_place(values) if self.cover else None
        return float(place.growth) if place else 1.0

    @property
    def stages(self) -> tuple[Lens | Interface, ...]:
        """The stages that a ray passes before the board."""
        return (self.lens, *self.cover)

    def trace(
        self,
        pixels: Tensor,
        values: Values,
        exposure: Exposure | None,
        *,
        near: Tensor | None = None,
    ) -> Rays:
        """Return the rays of (..., 2) px where they leave the cover. `near` is that of `Lens`."""
        pixels, values = self.adjust_pixels(pixels, values, exposure)
        return self.trace_from(self.lens(pixels, values, near), values, 1)

    def values_of_views(self, values: Values, poses: Tensor) -> Values:
        """Return the values with the camera of each row's view, for (..., B) view parameters."""
        columns = block_columns(blocks_of_size(poses.shape[-1]))
        for block in (FOCAL, CENTRE):
            if block in columns:
                return with_own_camera(values, poses[..., columns[block]])
        return values

    def adjust_pixels(
        self, pixels: Tensor, values: Values, exposure: Exposure | None
    ) -> tuple[Tensor, Values]:
        """Return the (..., 2) px and the values after all adjustments, as the stages read them."""
        for adjust in self.adjustments:
            pixels, values = adjust(pixels, values, exposure)
        return pixels, values

    def linear_terms(
        self,
        pixels: Tensor,
        values: Values,
        exposure: Exposure | None,
        landing: Landing | None = None,
    ) -> Iterator[tuple[LinearTerm, Tensor, Tensor]]:
        """Yield the terms that are linear in their parameters, each with the two (...) coordinates
        at which it acts, for rays of (..., 2) px. Without `landing`, the board's terms are left
        out.
        """
        for adjust in self.adjustments:
            if isinstance(adjust, LinearTerm):
                yield adjust, pixels[..., 0], pixels[..., 1]
            pixels, values = adjust(pixels, values, exposure)
        if landing:
            yield from landing.linear_terms()

    def trace_from(self, rays: Rays, values: Values, passed: int) -> Rays:
        """Return rays where they leave the cover.

        Args:
            rays: rays that have passed the first `passed` stages. The lens counts as one.
            values: the values after all adjustments.
        """
        if not records(rays, values):
            return self._cross_cover(rays, values, frozenset(), passed)[0].rays
        for interface in self.cover[passed - 1 :]:
            rays = interface(rays, values)
        return rays

    def trace_with_derivatives(
        self,
        pixels: Tensor,
        values: Values,
        exposure: Exposure | None,
        names: frozenset[str],
        *,
        cameras: Tensor | None = None,
        near: Tensor | None = None,
    ) -> Trace:
        """Trace (M, 2) px to where their rays leave the cover.

        Args:
            names: the parameters by which the rays are differentiated. The amplitudes of the
                outer relief and the numbers of linear adjustments have no derivatives of their own:
                those by their probes stand for them.
            cameras: (M, 1 or 2) the numbers of each ray's own camera, if `camera_block` is set.
            near: that of `Lens`.

        Returns:
            The trace. Its derivatives are by name, by PIXELS, and by OWN if `cameras` is given.
        """
        moved, adjusted, adjust_back = self._adjust_with_derivatives(
            pixels, values, exposure, names, cameras
        )
        stage_names = names | {name for name in adjusted if adjusted[name] is not values.get(name)}
        rays, pull_lens = self.lens.launch(moved, adjusted, stage_names, near)
        cover, pull_cover = self._cross_cover(rays, adjusted, stage_names)

        def pull(by_rays: ByRay) -> ByName:
            entering, by = pull_cover(by_rays)
            by_pixels, by_lens = pull_lens(entering)
            for name, value in by_lens.items():
                add_to(by, name, value)
            return adjust_back(by_pixels, by)

        return replace(cover, pull=pull)

    def trace_on(self, rays: Rays, values: Values, names: frozenset[str], passed: int) -> Trace:
        """Trace rays as `trace_from` does, with their derivatives by these parameters of the stages
        that are left.
        """
        return self._cross_cover(rays, values, names, passed)[0]

    def _cross_cover(
        self, rays: Rays, values: Values, names: frozenset[str], passed: int = 1
    ) -> tuple[Trace, Callable[[ByRay], tuple[ByRay, ByName]]]:
        """Return the trace of rays through the interfaces that are left, and the function from the
        derivatives by the rays that leave to those by the rays that enter and by name.
        """
        steps: list[Callable[[ByRay, frozenset[str]], tuple[ByRay, ByName]]] = []
        crossing: Crossing | None = None
        for frame, interfaces in groupby(self.cover[passed - 1 :], lambda stage: stage.frame):
            pose = frame.at(values)
            rays = pose.enter_rays(rays)
            steps.append(partial(frame.pull_entering, values, pose, rays))
            for interface in interfaces:
                rays, crossing = interface.cross(rays, values)
                steps.append(partial(interface.pull, crossing, values))
            steps.append(partial(frame.pull_leaving, values, pose, rays))
            rays = pose.leave_rays(rays)

        def pull(by_rays: ByRay) -> tuple[ByRay, ByName]:
            by: ByName = {}
            for step in steps[::-1]:
                by_rays, by_step = step(by_rays, names)
                for name, value in by_step.items():
                    add_to(by, name, value)
            return by_rays, by

        chart = crossing.relief_chart if crossing and crossing.chart else None
        factors = crossing.outer[0].factors if crossing and crossing.outer else (1.0, 1.0, 1.0)
        return Trace(rays, chart, factors, lambda by_rays: pull(by_rays)[1]), pull

    def _adjust_with_derivatives(
        self,
        pixels: Tensor,
        values: Values,
        exposure: Exposure | None,
        names: frozenset[str],
        cameras: Tensor | None,
    ) -> tuple[Tensor, Values, Callable[[Tensor, ByName], ByName]]:
        """Return the pixels and values as the stages read them, and a function that turns the
        derivatives by these into those by the pixels and values before the adjustments.
        """
        if cameras is None and not self.adjustments:
            return pixels, values, lambda by_pixels, by: {**by, PIXELS: by_pixels}
        probes = {
            probe
            for adjust in self.adjustments
            if isinstance(adjust, LinearTerm)
            for probe in adjust.probes.values()
        }
        linear = {
            name
            for adjust in self.adjustments
            if isinstance(adjust, LinearTerm)
            for name in adjust.probes
        }
        rows = len(pixels)
        inputs = {
            name: values[name].expand(rows, *values[name].shape)
            for name in (names & {*values}) - linear
            if values[name].ndim < 2  # no adjustment moves amplitudes
        }
        inputs |= {name: pixels.new_zeros(rows) for name in probes}
        inputs[PIXELS] = pixels
        if cameras is not None:
            inputs[OWN] = cameras
        changed: list[str] = []

        def adjust_rows(leaves: Values) -> Sequence[Tensor]:
            start = {**values, **leaves}
            adjusted = with_own_camera(start, leaves[OWN]) if cameras is not None else start
            moved, adjusted = self.adjust_pixels(leaves[PIXELS], adjusted, exposure)
            changed[:] = [name for name in adjusted if adjusted[name] is not start.get(name)]
            return [*moved.unbind(-1), *(adjusted[name] for name in changed)]

        outputs, pull = by_autograd(adjust_rows, inputs)
        adjusted = {**values, **dict(zip(changed, outputs[2:], strict=True))}

        def pull_back(by_pixels: Tensor, by: ByName) -> ByName:
            zero = torch.zeros_like(by_pixels[..., 0])
            by_changed = [by.pop(name, zero) for name in changed]
            for name, value in pull([*by_pixels.unbind(-1), *by_changed]).items():
                add_to(by, name, value)
            return by

        return torch.stack(outputs[:2], -1), adjusted, pull_back

    def land(
        self, pixels: Tensor, values: Values, poses: Tensor, exposure: Exposure | None
    ) -> tuple[Tensor, Tensor]:
        """Return the (..., 2) m nominal board coordinates where the rays of (..., 2) px land, and
        (...) uint8 failures. `poses` are the (..., B) view parameters of the boards, pose first.
        """
        return self.land_beside(torch.zeros_like(pixels), pixels, values, poses, exposure)

    def land_beside(
        self,
        corners: Tensor,
        pixels: Tensor,
        values: Values,
        poses: Tensor,
        exposure: Exposure | None,
    ) -> tuple[Tensor, Tensor]:
        """Return the (..., 2) m offsets from corners, in the form of `planes`, to the points where
        the rays of (..., 2) px land in the corners' planes, and (...) uint8 failures.
        """
        rays = self.trace(pixels, self.values_of_views(values, poses), exposure)
        corners, planes = self.planes(corners, Placement.of(poses).at_exposure(exposure))
        landed, failure = self.target(rays, planes, values)
        return landed - corners, failure

    def planes(self, corners: Tensor, boards: Placement) -> tuple[Tensor, Placement]:
        """Return the (..., 2) m coordinates of corners in the planes where their rays land, and the
        placements of these planes.

        Corners at (..., 2) m lie in their board's plane. A target with (..., 3) m points is not
        flat: each point has a plane of its own, as a plane of the target may be seen edge-on.
        """
        if corners.shape[-1] == 2:
            return corners, boards
        return torch.zeros_like(corners[..., :2]), boards.planes(corners, is_wide=self.lens.wide)

    def place(
        self,
        corners: Tensor,
        values: Values,
        poses: Tensor,
        exposure: Exposure | None,
        rays: Rays | None = None,
    ) -> Tensor:
        """Return the (..., 3) m points in the camera frame of (..., 2 or 3) m board coordinates, on
        boards with (..., B) view parameters, pose first. If there is glass on the board, (...) rays
        say from where it is seen, and the points are those where the corners appear.
        """
        return self.target.place(corners, Placement.of(poses).at_exposure(exposure), values, rays)


def with_own_camera(values: Values, cameras: Tensor) -> Values:
    """Return the values with a camera for each row, from (..., 1) fractions by which its focal
    length is longer, or (..., 2) px by which its principal point is shifted.
    """
    if cameras.shape[-1] == 1:
        return {**values, **{name: values[name] * (1 + cameras[..., 0]) for name in CAMERA.focal}}
    shifts = zip(CAMERA.centre, cameras.unbind(-1), strict=True)
    return {**values, **{name: values[name] + shift for name, shift in shifts}}
