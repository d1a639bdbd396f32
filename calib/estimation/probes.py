"""Derivatives by every estimated parameter of a path, row by row, from few reverse passes.

A relief and terms that are linear in their parameters (`optics.linear_term`) are differentiated by
probes, a few for each row. The chain rule turns the derivatives by the probes into those by the
parameters. The other parameters are differentiated one by one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.optics.exposure import Exposure
from calib.optics.linear_term import LinearTerm
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.rays import Rays
from calib.optics.relief import PROBES


@dataclass(frozen=True, slots=True, eq=False)
class TracedRows:
    """The rows at which the path was differentiated."""

    pixels: Tensor
    """(M, 2) px"""
    rays: Rays
    """(M,) rays that left the cover."""
    values: Values
    """The values without probes."""
    exposure: Exposure | None
    terms: Iterable[tuple[LinearTerm, Tensor, Tensor]]
    """The result of `Path.linear_terms`."""


@dataclass(frozen=True, slots=True, eq=False)
class ProbedValues:
    """The values of a path together with the tensors by which they are differentiated."""

    path: Path
    parameters: Parameters
    values: dict[str, Tensor]
    leaves: dict[str, Tensor]
    """(M, ...) by name: the probes, and the parameters without a probe."""

    @staticmethod
    def of(
        path: Path, parameters: Parameters, values: Values, rows: int, terms: Iterable[object]
    ) -> ProbedValues:
        """Return the values with probes for M rows.

        Args:
            rows: M.
            terms: parts of the path; those that are linear terms, with which `columns` will be
                called, get probes.
        """
        like = next(iter(values.values()))
        linear = [term for term in terms if isinstance(term, LinearTerm)]
        probe = {name: probe for term in linear for name, probe in term.probes.items()}
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
        return ProbedValues(path, parameters, {**values, **leaves}, leaves)

    def columns(self, derivatives: Sequence[Tensor], rows: TracedRows) -> Tensor | None:
        """Return the (M, k, S) derivatives by the vector of the parameters, from the (M, k, ...)
        derivatives by the leaves; None if there is no parameter.
        """
        if not self.parameters.count:
            return None
        by = dict(zip(self.leaves, derivatives, strict=True))
        count, outputs = derivatives[0].shape[:2]
        columns = derivatives[0].new_empty(count, outputs, self.parameters.count)
        if self.parameters.relief:
            outer = self.path.cover[-1]
            assert outer.relief
            _, adjusted = self.path.adjust_pixels(rows.pixels, rows.values, rows.exposure)
            point = outer.frame.at(adjusted).enter(rows.rays.origin.detach())
            outer.relief.spread(
                torch.stack([by[name] for name in PROBES], -1),
                outer.relief_chart(point, adjusted),
                columns[..., : self.parameters.amplitudes],
            )
        scales = {param.name: param.scale for param in self.parameters.free}
        slices = self.parameters.slices()
        for name, scale in scales.items():
            if name in by:
                columns[..., slices[name]] = (
                    scale * by[name].flatten(2)
                    if by[name].ndim > 2
                    else scale * by[name].unsqueeze(-1)
                )
        for term, x, y in rows.terms:
            for name, weights in term.weights(x, y).items():
                if term.probes[name] in by and name in slices:
                    by_probe = scales[name] * by[term.probes[name]]
                    torch.mul(
                        by_probe.unsqueeze(-1),
                        weights.unsqueeze(-2),
                        out=columns[..., slices[name]],
                    )
        return columns
