"""Tests of the choice between even and uneven glass, and of the relief that a fit estimates."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.polynomial.legendre import legval2d

from calib.errors import InputError
from calib.estimation.surface_prior import figure_heights, relief_basis
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting.declared import comparisons
from calib.fitting.fit import fit
from calib.fitting.setup import Setup
from calib.optics.relief import Relief
from calib.progress import Silent
from calib.session.cover import EVEN, UNEVEN
from calib.session.numbers import numbers_of
from calib.session.session import read_session
from fixtures.calibrated import CAMERA, calibrated
from fixtures.rays import FIXTURES
from fixtures.synthetic import COVERS, INTRINSICS, PATCH, Scene, measured, scene
from tests.test_fixtures import MEASURED, copied

LOW, HIGH = PATCH


@pytest.mark.parametrize("name", [name for name in COVERS if name != "uneven-cone"])
def test_even_glass_gets_no_relief(name: str) -> None:
    made = behind(name, 6, 12)
    result = calibrated(made, drawn(made, 6), Settings())
    assert result.relief is None
    assert [stage.name for stage in result.stages] == ["pinhole", "cover", "cover+rbf"]


def test_uneven_glass_gets_one() -> None:
    made = behind("uneven-cone", 6, 12)
    assert calibrated(made, drawn(made, 6), Settings()).relief


@pytest.mark.slow
def test_the_session_and_the_grid_may_decide() -> None:
    """Glass that is even and uneven, as told otherwise."""
    even, uneven = behind("thick-cone", 6, 12), behind("uneven-cone", 6, 12)
    setup = drawn(uneven, 6)
    assert calibrated(uneven, setup, Settings(grid=EVEN_GRID)).relief is None
    stated = replace(setup, cover=setup.cover.with_surface(EVEN))
    assert calibrated(uneven, stated, Settings()).relief is None
    setup = drawn(even, 6)
    stated = replace(setup, cover=setup.cover.with_surface(UNEVEN))
    assert calibrated(even, stated, Settings(grid=(6, 6))).relief


def test_the_surface_is_read_and_written(tmp_path: Path) -> None:
    text = (FIXTURES / "clean" / "session.yaml").read_text().replace("corners:", "#")
    for name in ("frames", "bare"):
        if (FIXTURES / "clean" / name).is_dir():
            (tmp_path / name).symlink_to(FIXTURES / "clean" / name)
    file = tmp_path / "session.yaml"
    file.write_text(text.replace("cover:\n", "cover:\n  surface: even\n"))
    assert read_session(tmp_path).cover.surface == EVEN
    file.write_text(text.replace("cover:\n", "cover:\n  surface: flat\n"))
    with pytest.raises(InputError, match=r"cover\.surface.*one of auto, even, uneven"):
        read_session(tmp_path)


@pytest.mark.slow
def test_the_numbers_behind_uneven_glass_hold() -> None:
    """Twelve sessions as somebody with a calliper declares them: errors over their sigmas have a
    root mean square of 1.1, and no true declaration is called contradicted. The bars leave a
    quarter for chance: 150 numbers, of which one session's hang together.
    """
    deviations = []
    for seed in range(400, 412):
        made = behind("uneven-cone", seed, 24)
        truth = numbers_of(INTRINSICS, made.cover)
        for row in comparisons(calibrated(made, drawn(made, seed), Settings())):
            assert not row.contradicted, (seed, str(row))
            if row.sigma > 0 and row.tolerance > 0:
                true = truth[row.name].value * row.per_si
                deviations.append((row.estimate - true) / row.sigma)
    assert 0.8 < np.sqrt(np.mean(np.square(deviations))) < 1.35


@pytest.mark.parametrize("grid", [(12, 12), (12, 24), (40, 40)])
def test_a_parabola_is_right_between_the_points_of_the_prior(grid: tuple[int, int]) -> None:
    """The heights at the prior's points determine the amplitudes. Where the picture sees it, the
    relief between them is the polynomial, to a nanometre of 10 um, and its amplitudes are as small
    with many centres as with few. Oracle: numpy's Legendre series.
    """
    relief = Relief.around(LOW, HIGH, grid)
    assert np.allclose(relief.region, PATCH)
    coefficients = np.array([0.0, 0.0, 1e-5, 0.0, 1e-5, 0.0])  # of P_2(v), and of u v
    heights = figure_heights(relief, LOW, HIGH, 2) @ coefficients
    amplitudes = np.linalg.solve(relief_basis(relief), heights).reshape(grid)
    assert np.abs(amplitudes).max() < 1e-4
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 40), np.linspace(-0.7, 0.7, 40), indexing="ij")
    chart = [
        torch.from_numpy((high + low) / 2 + coordinate * (high - low) / 2)
        for coordinate, low, high in zip((u, v), LOW, HIGH, strict=True)
    ]
    values = {"relief.amplitudes": torch.from_numpy(amplitudes)}
    ours = relief.height((chart[0], chart[1]), values)[0].numpy()
    table = np.zeros((3, 3))
    table[0, 2], table[1, 1] = 1e-5, 1e-5
    assert np.abs(ours - legval2d(u, v, table)).max() < 2e-9


def test_a_fit_describes_its_relief_where_it_is() -> None:
    """The saved relief needs no correction for the numbers that moved."""
    result = fit(read_session(FIXTURES / "clean"), Settings(grid=(6, 6)), Silent())
    path, values = result.model()
    assert result.relief
    assert result.relief.anchor
    view = path.cover[-1].relief_view(values)
    assert view.anchor == pytest.approx(result.relief.anchor, abs=1e-12)
    assert result.relief.size
    assert view.size[:2] == pytest.approx(result.relief.size[:2], rel=1e-12)


def behind(name: str, seed: int, views: int) -> Scene:
    """Return the views of a camera behind a cover of this name."""
    cover, amplitude = COVERS[name]
    return scene(seed, views, amplitude=amplitude, noise=0.1, depths=(0.4, 1.2), cover=cover)


def drawn(made: Scene, seed: int) -> Setup:
    """Return the setup that somebody with a calliper declares."""
    stated = measured(np.random.default_rng(seed), INTRINSICS, made.cover, 0.25)
    return Setup(made.board, CAMERA, *stated)


@pytest.mark.slow
def test_numbers_behind_uneven_cones_keep_to_their_sigma(tmp_path: Path) -> None:
    """Four cameras behind cones of 1.15 mm with bumps of 10 µm, rendered elsewhere."""
    scores: list[float] = []
    for pair in ("11", "12"):
        folder = copied(MEASURED / "cone-pairs" / pair, tmp_path / pair)
        for side, camera in json.loads((folder / "truth.json").read_text())["cameras"].items():
            calibration = fit(read_session(folder / side), Settings(), Silent())
            glass = camera["cover"]
            thickness, index = glass["layers"][0]
            truth = {f"camera.{name}": camera[name] for name in ("fx", "fy", "cx", "cy")} | {
                "cover.inner_radius": glass["R"],
                "cover.radius_slope": glass["slope"],
                "cover.axis_offset.x": glass["origin"][0],
                "cover.axis_offset.z": glass["origin"][2],
                "cover.tilt.x": glass["rotvec"][0],
                "cover.tilt.z": glass["rotvec"][2],
                "cover.thickness": thickness,
                "cover.refractive_index": index,
            }
            rows = [row for row in comparisons(calibration) if row.name in truth]
            assert not any(row.contradicted for row in rows)
            scores += [(row.estimate - truth[row.name] * row.per_si) / row.sigma for row in rows]
    spread = float(np.sqrt(np.mean(np.square(scores))))
    print(f"error over sigma of {len(scores)} numbers, root mean square: {spread:.2f}")
    assert len(scores) == 48
    assert spread < 1.25  # measured: 1.09; with a relief that keeps its size 1.31
