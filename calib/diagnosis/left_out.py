"""Fits without some of the views, from the fit to all of them.

A fit's equations are the sums of its views' own, so what is left without some is known, and one step of Gauss and Newton from the fit to
all leads where a fit without them ends, to first order. Where that step does not do what it promises, they are fitted.

Source: K. R. Rad, A. Maleki, A scalable estimate of the out-of-sample prediction error via approximate leave-one-out cross-validation
(2020).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.diagnosis.linearised import columns_of, schur_factors
from calib.diagnosis.score_test import Optimum
from calib.estimation.elimination import problem_at
from calib.estimation.joint_fit import JointFit, inverse
from calib.estimation.objective import view_precision

AMISS = 0.1
"""Of the noise's square for each shared parameter, a third of its sigma: a step may do so much more or less than it promises."""


def without_each(at: Optimum, part: NDArray[np.int64]) -> list[JointFit]:
    """The fits without each part of the views, with the noise and the prior of the fit to all; the poses of all views stay with them.

    Args:
        part: (V,) from 0 on.
    """
    parts, parameters = int(part.max()) + 1, at.model.parameters
    known = view_precision(at.model.path, at.joint.poses)
    sums = torch.zeros(parts, parameters.count + 1, parameters.count + 1, dtype=torch.float64)
    moves = []
    for one, columns in zip(part, columns_of(at), strict=True):
        own, others = columns[:, : len(known)], columns[:, len(known) :]
        through, factor = (found[0] for found in schur_factors((own.mT @ columns)[None], known))
        sums[one] += others.mT @ others - through.mT @ through
        moves.append(torch.linalg.solve_triangular(factor.mT, through, upper=True))
    whole, precision = sums.sum(0), torch.from_numpy(at.prior_precision())
    here = torch.from_numpy(at.deviation)
    problem = problem_at(at.model.path, at.parameters(), at.observations, at.joint.poses, at.joint.sigma)
    before = problem.by_view(torch.zeros_like(here), at.joint.poses)
    found = []
    for index in range(parts):
        left, out = whole - sums[index], torch.from_numpy(part == index)
        hessian = left[:-1, :-1] + precision
        covariance = inverse(hessian)
        vector = -covariance @ left[:-1, -1]
        values = parameters.values(vector)
        values |= {param.name: values[param.name].clamp_min(param.least) for param in parameters.free}
        poses = at.joint.poses * (known == 0) - torch.stack(moves) @ torch.cat([vector, vector.new_ones(1)])
        step = replace(at.joint, values=values, poses=torch.where(out[:, None], at.joint.poses, poses), covariance=covariance)
        promised = float((vector - here) @ hessian @ (vector - here))
        gained = float((before - problem.by_view(problem.parameters.vector(values), step.poses))[~out].sum())
        gained += float(here @ precision @ here - vector @ precision @ vector)
        if not abs(gained - promised) <= AMISS * parameters.count:  # true of what is not a number
            step = _fitted(at, step if gained > 0 else at.joint, out)
        found.append(step)
    return found


def _fitted(at: Optimum, begin: JointFit, out: Tensor) -> JointFit:
    rest = at.model.fitted(at.observations.without(out), begin.poses[~out], begin.start)
    poses = at.joint.poses.clone()
    poses[~out] = rest.poses
    return replace(rest, poses=poses)
