"""The variables that organise a residual are found, no others are, and noise is called noise."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import stats

from calib.corners.view import View
from calib.estimation.observations import Observations
from calib.inference.residual_structure import ORGANISERS, ResidualScene, VarianceShare
from calib.session.board import Board
from calib.threads import single_thread

Array = NDArray[np.float64]

WIDTH, HEIGHT = 1640, 1232
BOARD = Board(9, 7, 0.02)
VIEWS = 20
SIGMA = 0.1
"""px, of the noise."""


@cache
def unmoved() -> ResidualScene:
    """Boards of different sizes anywhere in the picture, turned, without any residual."""
    rng = np.random.default_rng(0)
    points = BOARD.points()
    pixels, depths = [], []
    for _ in range(VIEWS):
        depth = rng.uniform(0.25, 1.0)
        turn = rng.uniform(-0.6, 0.6)
        turned = points @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        shown = turned * 900 / depth
        room = np.array([WIDTH, HEIGHT]) / 2 - np.abs(shown).max(0)
        pixels.append(shown + np.array([WIDTH, HEIGHT]) / 2 + rng.uniform(-1, 1, 2) * room)
        depths.append(depth + 0.3 * turned[:, 0])
    views = tuple(View(f"{v}.png", at, np.ones(BOARD.count)) for v, at in enumerate(pixels))
    x, y = (np.concatenate(pixels) - [WIDTH / 2, HEIGHT / 2]).T / WIDTH
    observations = Observations.of(views, BOARD)
    return ResidualScene(
        observations,
        np.zeros((VIEWS * BOARD.count, 2)),
        np.concatenate(depths),
        1 / np.hypot(1, np.hypot(x, y)),
        WIDTH,
        HEIGHT,
    )


def with_residual(residual: Array) -> ResidualScene:
    unmoved_scene = unmoved()
    return ResidualScene(
        unmoved_scene.observations,
        residual,
        unmoved_scene.distance,
        unmoved_scene.incidence,
        WIDTH,
        HEIGHT,
    )


def noise(seed: int) -> Array:
    """(M, 2) px; some views are three times as noisy as others."""
    rng = np.random.default_rng(seed)
    return np.asarray(
        rng.normal(0, SIGMA, (VIEWS * BOARD.count, 2))
        * rng.uniform(0.5, 1.5, VIEWS).repeat(BOARD.count)[:, None]
    )


def by_name(shares: list[VarianceShare]) -> dict[str, VarianceShare]:
    return {share.organised_by: share for share in shares}


def glass() -> Array:
    """A texture of some 200 px."""
    x, y = unmoved().observations.pixels.numpy().T
    return np.stack(
        [np.sin(2 * np.pi * x / 410) * np.cos(2 * np.pi * y / 410), np.cos(2 * np.pi * x / 410)], -1
    )


def print_() -> Array:
    """Every corner of the print is off by itself."""
    return np.tile(np.random.default_rng(1).normal(0, 1, (BOARD.count, 2)), (VIEWS, 1))


def shutter() -> Array:
    """Every view's rows are shifted along, in a direction of its own."""
    row = unmoved().observations.pixels.numpy()[:, 1].reshape(VIEWS, -1)
    row = (row - row.mean(1, keepdims=True)) / HEIGHT
    motion = np.random.default_rng(2).normal(0, 1, (VIEWS, 1, 2))
    return np.asarray((row[..., None] * motion).reshape(-1, 2))


def drift() -> Array:
    """The focal length grows steadily."""
    when = np.linspace(-0.5, 0.5, VIEWS).repeat(BOARD.count)[:, None]
    return np.asarray(
        when * (unmoved().observations.pixels.numpy() - [WIDTH / 2, HEIGHT / 2]) / WIDTH
    )


def parallax() -> Array:
    """Return the shifts by a wrong glass: outwards by incidence, near boards against far ones."""
    unmoved_scene = unmoved()
    outwards = (unmoved_scene.observations.pixels.numpy() - [WIDTH / 2, HEIGHT / 2]) / WIDTH
    near = 1 / unmoved_scene.distance
    return np.asarray(
        (1 - unmoved_scene.incidence)[:, None] * (near - near.mean())[:, None] * outwards
    )


def detector() -> Array:
    """Corners are drawn to the middle of a pixel."""
    return np.sin(2 * np.pi * unmoved().observations.pixels.numpy())


PLANTED: dict[str, tuple[Callable[[], Array], float]] = {
    "image": (glass, 0.05),
    "board": (print_, 0.45),
    "row x motion": (shutter, 0.4),
    "view and time": (drift, 0.25),
    "incidence x depth": (parallax, 0.25),
    "sub-pixel phase": (detector, 0.45),
}
"""Fields, and what is explained of their half of the variance at least: the image's cells are half
a wave of the texture, and a view that an effect makes worse weighs less.
"""
UNTOUCHED: dict[str, set[str]] = {
    "image": {"board", "sub-pixel phase"},
    "board": set(ORGANISERS) - {"board"},
    "row x motion": {"board", "view and time", "sub-pixel phase"},
    "view and time": {"board"},
    "incidence x depth": {"board", "sub-pixel phase"},
    "sub-pixel phase": {"board", "view and time"},
}
"""The variables that have no part in a field. The other ones are smooth over the picture as the
field is, and share some of it.
"""


def test_every_variable_is_planted_once() -> None:
    assert set(PLANTED) == set(UNTOUCHED) == set(ORGANISERS)


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_variable_is_named_first_and_no_untouched_one(name: str) -> None:
    """The planted field is as large as the noise. A diagnosis reports p-values below 0.001."""
    plant, minimum = PLANTED[name]
    field = plant()
    with single_thread():
        shares = with_residual(noise(5) + field * SIGMA / np.sqrt((field**2).mean())).split()
    assert shares[0].organised_by == name
    assert shares[0].p_value < 1e-10
    assert shares[0].fraction - shares[0].chance > minimum
    result = by_name(shares)
    assert result.keys() == ORGANISERS.keys()
    assert all(result[untouched].p_value > 1e-3 for untouched in UNTOUCHED[name]), result


def test_a_board_s_share_is_the_field_s_part_of_the_variance() -> None:
    """Equal parts, of views that scatter alike: the board explains its half, and of the noise what
    chance gives.
    """
    field = print_()
    white_noise = np.random.default_rng(3).normal(0, 1, field.shape)
    with single_thread():
        share = by_name(
            with_residual(
                white_noise / np.sqrt((white_noise**2).mean()) + field / np.sqrt((field**2).mean())
            ).split()
        )["board"]
    assert share.chance == pytest.approx(1 / VIEWS)
    assert share.fraction == pytest.approx(
        1 / 2 + share.chance / 2, abs=0.03
    )  # of 2520 entries: 0.02 is a standard deviation


def test_p_values_of_noise_are_uniform() -> None:
    """Sixty residuals of noise, whose views scatter differently: as often as six independent tests
    of a thousandth fail by chance.
    """
    with single_thread():
        splits = [by_name(with_residual(noise(seed)).split()) for seed in range(60)]
    for name in ORGANISERS:
        p_values = [results[name].p_value for results in splits]
        assert stats.kstest(p_values, "uniform").pvalue > 1e-3, (name, p_values)
        excess = np.mean([results[name].fraction - results[name].chance for results in splits])
        assert (
            abs(excess) < 0.005
            # of fractions that scatter by 0.01 at most: four standard deviations of a mean of sixty
        ), name


def test_noisy_views_do_not_outweigh_the_others() -> None:
    """A print that is off, and two views with fifty times the noise: weighed by their own scatter,
    they hide nothing.
    """
    field = print_()
    residual = noise(6) + field * SIGMA / np.sqrt((field**2).mean())
    residual[: 2 * BOARD.count] *= 50
    with single_thread():
        assert with_residual(residual).split()[0].organised_by == "board"


def test_a_residual_that_repeats_in_every_view_is_organised_by_the_board() -> None:
    """Copies of one picture: the board explains all of it, and nothing is left to compare with."""
    pattern = np.random.default_rng(1).normal(0, SIGMA, (BOARD.count, 2))
    scene = replace(unmoved(), residual=np.tile(pattern, (VIEWS, 1)))
    first = scene.split()[0]
    assert (first.organised_by, first.p_value) == ("board", 0.0)
    assert first.fraction == pytest.approx(1.0)


def test_a_zero_residual_has_no_structure() -> None:
    shares = unmoved().split()
    assert {share.organised_by for share in shares} == set(ORGANISERS)
    assert all(share.fraction == 0.0 and share.p_value == 1.0 for share in shares)


def test_columns_without_remaining_freedom_give_no_test() -> None:
    """One picture of five corners: a mean for each corner explains all, by chance as well."""
    unmoved_scene = unmoved()
    residual = np.random.default_rng(2).normal(0, SIGMA, (5, 2))
    item = unmoved_scene.observations.view_range(range(1)).select_rows(
        torch.arange(BOARD.count) < 5
    )
    scene = ResidualScene(
        item, residual, unmoved_scene.distance[:5], unmoved_scene.incidence[:5], WIDTH, HEIGHT
    )
    board = next(share for share in scene.split() if share.organised_by == "board")
    assert board.fraction == pytest.approx(1.0)
    assert (board.chance, board.p_value) == (1.0, 1.0)
