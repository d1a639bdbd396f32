"""Derivatives by every estimated parameter of a path, row by row, from few reverse passes.

A relief and what is linear in its parameters (`optics.linear_term`) are differentiated by probes, a
few for each row, and the chain rule spreads these over their parameters; the others are
differentiated one by one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.optics.linear_term import LinearTerm
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.rays import Rays
from calib.optics.relief import PROBES


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Where the path was differentiated."""

    pixels: Tensor
    """(M, 2) px"""
    rays: Rays
    """(M,) that left the cover."""
    values: Values
    """Without leaves."""
    parts: Iterable[tuple[LinearTerm, Tensor, Tensor]]
    """As `Path.linear_terms` has them."""


@dataclass(frozen=True, slots=True, eq=False)
class Probed:
    """The values of a path with all that they are differentiated by."""

    path: Path
    parameters: Parameters
    values: dict[str, Tensor]
    leaves: dict[str, Tensor]
    """(M, ...) by name: probes, and the parameters that have none."""

    @staticmethod
    def of(
        path: Path, parameters: Parameters, values: Values, rows: int, parts: Iterable[object]
    ) -> Probed:
        """
        Args:
            rows: M.
            parts: of the path, those of which `columns` will know where they are asked.
        """
        like = next(iter(values.values()))
        linear = [part for part in parts if isinstance(part, LinearTerm)]
        probe = {name: by for part in linear for name, by in part.probes.items()}
        free = [param.name for param in parameters.free]
        leaves = {
            name: like.new_zeros(rows)
            for name in (
                *(PROBES if parameters.relief else ()),
                *(probe[n] for n in free if n in probe),
            )
        }
        leaves |= {
            name: values[name].expand(rows, *values[name].shape).clone()
            for name in free
            if name not in probe
        }
        for leaf in leaves.values():
            leaf.requires_grad_()
        return Probed(path, parameters, {**values, **leaves}, leaves)

    def columns(self, derivatives: Sequence[Tensor], seen: Seen) -> Tensor | None:
        """(M, k, S) by the vector of the parameters, from the (M, k, ...) by each of the leaves;
        None where there is no parameter.
        """
        if not self.parameters.count:
            return None
        by = dict(zip(self.leaves, derivatives, strict=True))
        rows, outputs = derivatives[0].shape[:2]
        found = derivatives[0].new_empty(rows, outputs, self.parameters.count)
        if self.parameters.relief:
            outer = self.path.cover[-1]
            assert outer.relief
            _, adjusted = self.path.adjust_pixels(seen.pixels, seen.values)
            where = outer.surface.chart(outer.frame.at(adjusted).enter(seen.rays.origin.detach()))
            outer.relief.spread(
                torch.stack([by[name] for name in PROBES], -1),
                where,
                found[..., : self.parameters.amplitudes],
            )
        scales, places = (
            {param.name: param.scale for param in self.parameters.free},
            self.parameters.slices(),
        )
        for name, scale in scales.items():
            if name in by:
                found[..., places[name]] = (
                    scale * by[name].flatten(2)
                    if by[name].ndim > 2
                    else scale * by[name].unsqueeze(-1)
                )
        for part, x, y in seen.parts:
            for name, weights in part.weights(x, y).items():
                if part.probes[name] in by and name in places:
                    probed = scales[name] * by[part.probes[name]]
                    torch.mul(
                        probed.unsqueeze(-1), weights.unsqueeze(-2), out=found[..., places[name]]
                    )
        return found
