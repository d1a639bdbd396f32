"""The project itself as a peer: the joint fit or the paper's procedure, with the camera and the
smooth cover known.
"""

import time
from functools import partial

import torch

from benchmarks.peers.case import Case
from benchmarks.peers.child import Fitted, main
from benchmarks.peers.scenes import left, observed
from calib.estimation.gradient_fit import descend
from calib.estimation.joint_fit import fit_joint
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.relief import Relief
from calib.threads import single_thread
from fixtures.synthetic import INTRINSICS, paper_cone

STEPS = 1000


def fit(case: Case, which: str) -> Fitted:
    method, centres, device = which.split()
    grid = int(centres), int(centres)
    observations = observed(case.train)
    start_time = time.perf_counter()
    smooth, values = covered_path(INTRINSICS, paper_cone(case.thickness))
    start = pinhole_poses(smooth, values, observations)
    poses = refine_poses(smooth, values, observations, start).blocks
    path = with_relief(smooth, Relief(*footprint(smooth, values, *case.size), grid))
    values["relief.amplitudes"] = torch.zeros(grid, dtype=torch.float64)
    if method == "joint":
        device_values = {name: value.to(device) for name, value in values.items()}
        fitted = fit_joint(path, device_values, observations.to(device), poses.to(device))
        values, iterations = (
            {name: value.cpu() for name, value in fitted.values.items()},
            fitted.iterations,
        )
    else:
        values["relief.amplitudes"] = descend(path, values, observations, poses, steps=STEPS)
        iterations = STEPS
    seconds = time.perf_counter() - start_time
    return Fitted(f"torch {torch.__version__}", seconds, iterations, partial(left, path, values))


if __name__ == "__main__":
    with single_thread():
        main(fit)
