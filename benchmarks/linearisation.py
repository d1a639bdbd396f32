"""Where the time of a linearisation goes, what torch's own derivatives of the same rows take, and
the time of whole fits in this process: `python -m benchmarks.linearisation`.

45 views of 81 corners behind a cone with 12x12 amplitudes, every number of camera and cover free,
on one thread. Each line is the processor's time, the least of several runs: other programs on the
machine only add to it. torch differentiates by the numbers and poses alone; a relief's amplitudes
would come on top. The fits have 45 views too, and numbers declared with a calliper's tolerances.
"""

import time
from collections.abc import Callable

import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from torch import Tensor

from benchmarks.peers.case import BOARD
from benchmarks.peers.scenes import GLASSES, make, observed
from calib.estimation.normal_equations import normal_equations
from calib.estimation.residual_blocks import ResidualBlock, make_residual_blocks, pixel_weights
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.placement import Placement
from calib.progress import Silent
from calib.session.camera import Camera
from calib.threads import single_thread
from fixtures.calibrated import CAMERA, calibrated
from fixtures.synthetic import COVERS, INTRINSICS, measured, paper_cone, scene

RUNS, CALLS = 12, 5
SIGMA = 0.1
"""px"""
DEPTHS = (0.4, 1.2)
"""m"""
CALLIPER = 0.3
"""The tolerances of a person who measured, over those of a person who did not."""


def least_ms(function: Callable[[], object]) -> float:
    """The processor's ms of a call: the least of some runs."""
    function()
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        for _ in range(CALLS):
            function()
        times.append((time.process_time() - start) / CALLS)
    return 1e3 * min(times)


def by_torch(block: ResidualBlock, values: Values, poses: Tensor) -> list[Tensor]:
    """The derivatives of the residuals by every number and pose, in two reverse passes."""
    observations = block.observations
    rows = len(observations.pixels)
    leaves = {
        name: values[name].expand(rows).clone().requires_grad_()
        for name in block.parameters.slices()
        if not values[name].ndim
    }
    placed = poses[observations.view].clone().requires_grad_()
    rays = block.path.trace(observations.pixels, {**values, **leaves}, MIDDLE)
    landed, _ = block.path.target(rays, Placement.of(placed), values)
    residual = (block.weights @ (landed - observations.corners).unsqueeze(-1)).squeeze(-1)
    inputs = [placed, *leaves.values()]
    passes = [
        torch.autograd.grad(residual[:, axis].sum(), inputs, retain_graph=axis == 0)
        for axis in range(2)
    ]
    return [torch.stack(columns, 1) for columns in zip(*passes, strict=True)]


def fit_table() -> Table:
    """The processor's time of a second fit through each cover."""
    table = Table("cover", "CPU s", "glass", title="calib.fit of 45 views, one thread")
    for name, (cover, amplitude) in COVERS.items():
        made = scene(5, 45, amplitude=amplitude, noise=SIGMA, depths=DEPTHS, cover=cover)
        declared = measured(np.random.default_rng(3), INTRINSICS, cover, CALLIPER)
        setup = Setup(made.board, CAMERA, *declared)
        calibrated(made, setup, Settings())
        start = time.process_time()
        result = calibrated(made, setup, Settings())
        seconds = time.process_time() - start
        table.add_row(name, f"{seconds:.2f}", "uneven" if result.relief else "even")
    return table


def main() -> None:
    case, _ = make(GLASSES[0], 0)
    camera = Camera(*case.size, intrinsics=INTRINSICS)
    setup = Setup(BOARD, camera, INTRINSICS, paper_cone(case.thickness))
    settings = Settings(grid=(12, 12))
    observations = observed(case.train)
    with single_thread():
        fitted = fit_stages(setup.with_tolerances(settings), observations, settings, Silent())
        assert fitted.model
        assert fitted.joint
        path, parameters = fitted.model.path, fitted.model.parameters
        values, poses = fitted.joint.values, fitted.joint.poses
        weights = pixel_weights(path, values, observations, poses, SIGMA)
        (block,) = make_residual_blocks(path, parameters, observations, weights, values)
        piece = block.linearise(values, poses)
        rays = block.rays(values, poses)
        error = (piece.jacobian_block - by_torch(block, values, poses)[0]).abs().max()
        agreement = float(error / piece.jacobian_block.abs().max())
        closed = least_ms(lambda: block.linearise(values, poses))
        torch_ms = least_ms(lambda: by_torch(block, values, poses))
        lines = [
            ("rays through the cover", least_ms(lambda: block.rays(values, poses))),
            ("residuals of rays", least_ms(lambda: block.residual(rays, values, poses))),
            ("linearisation: all derivatives", closed),
            ("its normal equations", least_ms(lambda: normal_equations([piece]))),
            ("torch: numbers and poses", torch_ms),
        ]
    table = Table(
        title=f"{len(observations.pixels)} corners, {parameters.count} shared numbers, one thread"
    )
    table.add_column("step")
    table.add_column("ms", justify="right")
    for name, ms in lines:
        table.add_row(name, f"{ms:.1f}")
    console = Console()
    console.print(table)
    console.print(f"closed form over torch: {closed / torch_ms:.2f}; agreement {agreement:.0e}")
    with single_thread():
        console.print(fit_table())


if __name__ == "__main__":
    main()
