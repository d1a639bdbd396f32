"""The derivatives by the vector of a fit's shared parameters, from those along the ray path.

The amplitudes of a relief, and the parameters of a term that is linear in them
(`optics.linear_term`), act on a ray by a few probes. The chain rule turns the derivatives by the
probes into those by the parameters.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.optics.derivatives import ByName
from calib.optics.exposure import Exposure
from calib.optics.linear_term import LinearTerm
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.rays import Rays
from calib.optics.relief import PROBES


@dataclass(frozen=True, slots=True, eq=False)
class TracedRows:
    """The rows at which a path was differentiated."""

    pixels: Tensor
    """(M, 2) px"""
    rays: Rays
    """(M,) rays that left the cover."""
    values: Values
    exposure: Exposure | None
    terms: Iterable[tuple[LinearTerm, Tensor, Tensor]]
    """The result of `Path.linear_terms`."""


def shared_columns(
    path: Path, parameters: Parameters, by: ByName, rows: TracedRows, outputs: int
) -> Tensor:
    """Return the (M, k, S) derivatives of k `outputs` by the vector of the parameters, from the (k,
    M, ...) derivatives by name; 0 for a parameter that is not named there.
    """
    columns = rows.pixels.new_empty(len(rows.pixels), outputs, parameters.count)
    slices = parameters.slices()
    if parameters.relief:
        outer = path.cover[-1]
        assert outer.relief
        _, adjusted = path.adjust_pixels(rows.pixels, rows.values, rows.exposure)
        point = outer.frame.at(adjusted).enter(rows.rays.origin)
        outer.relief.spread(
            torch.stack([by[name] for name in PROBES], -1).transpose(0, 1),
            outer.relief_chart(point, adjusted),
            columns[..., : parameters.amplitudes],
        )
    weights = {
        name: (term.probes[name], weight)
        for term, x, y in rows.terms
        for name, weight in term.weights(x, y).items()
    }
    for param in parameters.free:
        place = columns[..., slices[param.name]]
        if param.name in weights:
            probe, weight = weights[param.name]
            torch.mul(param.scale * by[probe].mT.unsqueeze(-1), weight.unsqueeze(-2), out=place)
        elif param.name in by:
            place.copy_(
                param.scale * by[param.name].reshape(outputs, len(columns), -1).transpose(0, 1)
            )
        else:
            place.zero_()
    return columns
