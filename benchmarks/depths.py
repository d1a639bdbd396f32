"""The errors of a calibration nearer than it was trained, and its time: `python -m
benchmarks.depths`.

45 views at 0.6-1.2 m through 1.15 mm of uneven glass, 0.1 px of noise per axis, 8x8 centres, tested
on 20 views at 0.17-0.3 m with poses refitted, beside the paper's procedure (1000 steps) and what
the true glass leaves on the same corners.
"""

import time

import torch
from rich.console import Console
from rich.table import Table

from calib.estimation.gradient_fit import descend
from calib.estimation.joint_fit import fit_joint
from calib.estimation.poses import pinhole_poses, refine_poses, refit_poses
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.relief import Relief
from calib.threads import single_thread
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, paper_cone, scene

GLASS = paper_cone(thickness=0.00115)
NOISE = 0.1  # px per axis
CENTRES = (12, 12)


def row(seed: int, bumps: int) -> list[str]:
    """One line of the table."""
    made = scene(seed, 45, (bumps, bumps), 1e-5, NOISE, cover=GLASS)
    near = scene(seed, 20, (bumps, bumps), 1e-5, NOISE, depths=(0.17, 0.3), cover=GLASS)
    smooth, values = covered_path(INTRINSICS, GLASS)
    poses = refine_poses(
        smooth, values, made.observations, pinhole_poses(smooth, values, made.observations)
    ).blocks
    path = with_relief(smooth, Relief(*footprint(smooth, values, WIDTH, HEIGHT), CENTRES))
    flat = {**values, "relief.amplitudes": torch.zeros(CENTRES, dtype=torch.float64)}
    start_time = time.perf_counter()
    joint = fit_joint(path, flat, made.observations, poses)
    between = time.perf_counter()
    paper = {**flat, "relief.amplitudes": descend(path, flat, made.observations, poses, steps=1000)}
    ended = time.perf_counter()
    floor = refit_poses(near.path, near.values, near.observations, near.poses)[1].rms_px
    ours = refit_poses(path, joint.values, near.observations, near.poses)[1].rms_px
    theirs = refit_poses(path, paper, near.observations, near.poses)[1].rms_px
    spent = (
        f"{between - start_time:.1f} s",
        f"{ended - between:.1f} s",
        f"{(ended - between) / (between - start_time):.0f}",
    )
    return [
        f"{bumps}x{bumps}, seed {seed}",
        f"{floor:.3f}",
        f"{ours:.3f}",
        f"{100 * (ours / floor - 1):+.0f} %",
        f"{theirs:.3f}",
        *spent,
    ]


def main() -> None:
    table = Table(
        "bumps", "true glass, px", "joint, px", "over it", "paper, px", "joint", "paper", "ratio"
    )
    with single_thread():
        for bumps in (4, 10):
            for seed in (1, 2):
                table.add_row(*row(seed, bumps))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
