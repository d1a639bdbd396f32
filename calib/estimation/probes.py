"""The derivatives by the vector of a fit's shared parameters, from those along the ray path.

The amplitudes of a relief, and the parameters of a term that is linear in them
(`optics.linear_term`), act on a ray by a few probes. The chain rule turns the derivatives by the
probes into those by the parameters.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.optics.derivatives import ByName
from calib.optics.linear_term import LinearTerm
from calib.optics.path import Path, Trace
from calib.optics.relief import PROBES


def shared_columns(
    path: Path,
    parameters: Parameters,
    by: ByName,
    trace: Trace,
    terms: Iterable[tuple[LinearTerm, Tensor, Tensor]],
    outputs: int,
) -> Tensor:
    """Return the (M, k, S) derivatives of k `outputs` by the vector of the parameters, from the (k,
    M, ...) derivatives by name; 0 for a parameter that is not named there.

    Args:
        trace: the rays, which left the cover.
        terms: the result of `Path.linear_terms`.
    """
    count = len(trace.rays.failure)
    columns = trace.rays.direction.x.new_empty(count, outputs, parameters.count)
    slices = parameters.slices()
    if parameters.relief:
        assert path.relief
        assert trace.relief_chart
        path.relief.spread(
            torch.stack(
                [
                    factor * by[name]
                    for name, factor in zip(PROBES, trace.relief_factors, strict=True)
                ],
                -1,
            ).transpose(0, 1),
            trace.relief_chart,
            columns[..., : parameters.amplitudes],
        )
    weights = {
        name: (term.probes[name], weight)
        for term, x, y in terms
        for name, weight in term.weights(x, y).items()
    }
    for param in parameters.free:
        place = columns[..., slices[param.name]]
        if param.name in weights:
            probe, weight = weights[param.name]
            torch.mul(param.scale * by[probe].mT.unsqueeze(-1), weight.unsqueeze(-2), out=place)
        elif param.name in by:
            place.copy_(
                param.scale
                * by[param.name].reshape(outputs, count, place.shape[-1]).transpose(0, 1)
            )
        else:
            place.zero_()
    return columns
