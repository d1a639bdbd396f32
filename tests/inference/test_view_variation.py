"""What differs from view to view, by the evidence: against dense algebra, and on simulated sessions
whose numbers differ in a known way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.corners.view import View
from calib.effects.board_scale import BoardScale
from calib.effects.effect import EffectContext
from calib.effects.flat_port import FlatPort
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.estimation.priors import Priors
from calib.fit_record.request import Settings
from calib.fitting.differing import Differing
from calib.fitting.setup import Setup
from calib.inference.fitted_model import FittedModel
from calib.inference.variation import Variation
from calib.inference.variation_equations import VariationEquations
from calib.inference.variation_rows import VariationRows
from calib.inference.varying_numbers import (
    DISTORTION,
    VariationKind,
    groups_of,
    time_patterns,
)
from calib.inference.view_variation import (
    find_variations,
    largest_gain,
    nameless_variation,
)
from calib.optics.build import covered_path, pinhole_path
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.projection import project
from calib.session.board import Board
from calib.session.parameter_names import CAMERA
from calib.session.shutter import Shutter
from calib.threads import single_thread
from fixtures.calibrated import CAMERA as SIMULATED
from fixtures.synthetic import COVERS, HEIGHT, INTRINSICS, WIDTH, Scene, bare_views, scene
from fixtures.view_variation import CAUSES

Array = NDArray[np.float64]
VIEWS = 20
FREE = {
    **dict.fromkeys(CAMERA.focal, 50.0),
    **dict.fromkeys(CAMERA.centre, 20.0),
    "cover.thickness": 5e-4,
    "cover.refractive_index": 0.02,
}
FLAT = 1e5
"""The standard deviation of a prior that is as good as none."""


def optimum(made: Scene) -> FittedModel:
    """Return a fit of the camera and of some numbers of the glass."""
    priors = Priors({name: sigma for name, sigma in FREE.items() if name in made.values})
    model = CameraModel(made.path, made.values, priors)
    with single_thread():
        return FittedModel(model, made.observations, model.fit(made.observations, made.poses))


def context_of(made: Scene, shutter: Shutter | None = None) -> EffectContext:
    return EffectContext(
        made.board, WIDTH, HEIGHT, made.path, made.values, frozenset(FREE), shutter
    )


def session(seed: int, cover: str, noise: float = 0.1) -> Scene:
    return scene(seed, VIEWS, amplitude=0.0, noise=noise, depths=(0.4, 1.2), cover=COVERS[cover][0])


def varied(made: Scene, change: Callable[[int], Values]) -> Scene:
    """Return the scene with other values in each view, and with its own noise."""
    points = torch.from_numpy(made.board.points())
    views: list[View] = []
    for index, (view, pose) in enumerate(zip(made.views, made.poses, strict=True)):
        at = made.path.place(points, made.values, pose, MIDDLE)
        values = {**made.values, **change(index)}
        shift = project(made.path, values, at, MIDDLE) - project(made.path, made.values, at, MIDDLE)
        views.append(replace(view, corners=view.corners + shift.numpy()))
    return replace(made, views=tuple(views))


def refocused(made: Scene, sizes: Sequence[float] | Array) -> Scene:
    """Return the scene with focal lengths that differ by (V,) fractions."""
    return varied(
        made, lambda view: {name: made.values[name] * (1 + sizes[view]) for name in CAMERA.focal}
    )


def dense_log_evidence(rows: VariationRows, added: Array | None = None) -> float:
    """Return the log evidence, up to a constant, with the covariance of all residuals written out.

    Args:
        added: (M, k) columns of deviations with standard deviation 1, over the noise.
    """
    ends = np.cumsum([len(view) for view in rows.views])
    count = int(ends[-1])
    stacked = np.concatenate([view[:, rows.own :] for view in rows.views])
    shared = stacked[:, rows.shared]
    covariance = np.eye(count) + shared @ np.linalg.solve(rows.precision, shared.T)
    for view, end in zip(rows.views, ends.tolist(), strict=True):
        place = slice(end - len(view), end)
        block = FLAT * view[:, : rows.own] / np.linalg.norm(view[:, : rows.own], axis=0)
        covariance[place, place] += block @ block.T
    if added is not None:
        covariance += added @ added.T
    residual = stacked[:, -1]
    freedom = count - rows.own * len(rows.views)
    square = residual @ np.linalg.solve(covariance, residual)
    return -float(np.linalg.slogdet(covariance)[1] + freedom * np.log(square)) / 2


@pytest.mark.parametrize("kind", [VariationKind.EACH, VariationKind.DRIFT])
def test_the_gain_is_that_of_dense_algebra(kind: VariationKind) -> None:
    """Another focal length in each of five views of 81 corners behind a thick cone."""
    made = session(3, "thick-cone")
    made = replace(made, views=made.views[:5], poses=made.poses[:5])
    made = refocused(made, np.random.default_rng(0).normal(0, 0.04, 5))
    rows = VariationRows.of(optimum(made), context_of(made))
    group = groups_of(context_of(made))[0]
    assert group.name == "focal"
    equations = VariationEquations.of(rows).group(group)
    variation = (
        equations.in_every_view
        if kind is VariationKind.EACH
        else equations.variation_along(kind, time_patterns(np.linspace(0, 1, 5))[kind][0])
    )
    assert variation.gain > 1
    columns = rows.columns(group) * variation.scales
    by_view = [view[:, rows.own :] @ columns for view in rows.views]
    if kind is VariationKind.EACH:
        added = np.zeros((sum(map(len, by_view)), 5))
        first = 0
        for index, column in enumerate(by_view):
            added[first : first + len(column), index] = column[:, 0]
            first += len(column)
    else:
        added = np.concatenate(
            [size * column for size, column in zip(variation.pattern, by_view, strict=True)]
        )
    gain = dense_log_evidence(rows, added) - dense_log_evidence(rows)
    assert variation.gain == pytest.approx(gain, abs=1e-3)


def test_deviations_are_those_that_the_views_have() -> None:
    sizes = np.random.default_rng(1).normal(0, 0.01, VIEWS)
    made = refocused(session(4, "wet-flat", noise=0.02), sizes)
    fitted = optimum(made)
    variation = find_variations(fitted, context_of(made))[0]
    assert (variation.group.name, variation.kind) == ("focal", VariationKind.EACH)
    (number,) = variation.group.numbers
    estimated = number.sigma * variation.deviations[:, 0]
    wanted = sizes - sizes.mean()
    assert np.corrcoef(estimated, wanted)[0, 1] > 0.99
    assert estimated.std() == pytest.approx(wanted.std(), rel=0.1)


@pytest.mark.parametrize("cover", ["dome", "thick-cone", "wet-flat"])
def test_nothing_differs_in_a_clean_session(cover: str) -> None:
    made = session(7, cover)
    assert not find_variations(optimum(made), context_of(made))


def test_a_window_that_an_effect_added_has_no_numbers_that_differ() -> None:
    board = Board(9, 9, 0.020)
    path, values = pinhole_path(INTRINSICS)
    observations = Observations.of(bare_views(3, VIEWS, 0.1, board=board), board)
    poses = pinhole_poses(path, values, observations)
    model = CameraModel(path, values, Priors(dict.fromkeys(CAMERA.focal, 50.0)))
    extended = model.with_effect(FlatPort("air"))
    joint = extended.fit(observations, poses)
    context = EffectContext(board, WIDTH, HEIGHT, extended.path, joint.values)
    assert not {"thickness", "index"} & {group.name for group in groups_of(context)}
    assert largest_gain(FittedModel(extended, observations, joint), context) < 7


@pytest.mark.parametrize(
    ("cover", "moves"),
    [
        ("thick-cone", {"cover_offset", "cover_tilt", "cover_radius"}),
        ("cylinder", {"cover_offset", "cover_tilt", "cover_radius"}),
        ("wet-flat", {"cover_offset", "cover_tilt"}),
        ("dome", {"cover_offset", "cover_radius"}),
    ],
)
def test_every_number_of_a_cover_may_differ(cover: str, moves: set[str]) -> None:
    setup = Setup(Board(9, 9, 0.020), SIMULATED, INTRINSICS, COVERS[cover][0])
    setup = setup.with_tolerances(Settings())
    path, values = covered_path(setup.intrinsics, setup.cover)
    context = EffectContext(setup.board, WIDTH, HEIGHT, path, values)
    names = {group.name for group in groups_of(context)}
    assert {name for name in names if name.startswith("cover_")} == moves
    assert {"thickness", "refractive_index"} <= names


def test_few_views_are_not_asked() -> None:
    made = session(3, "dome")
    made = replace(made, views=made.views[:5], poses=made.poses[:5])
    assert not find_variations(optimum(made), context_of(made))


FIRST = 12
PATTERNS: dict[str, tuple[Array, VariationKind]] = {
    "step": (np.where(np.arange(VIEWS) < FIRST, -0.01, 0.0), VariationKind.STEP),
    "alternating": (np.where(np.arange(VIEWS) % 2, 0.01, 0.0), VariationKind.ALTERNATING),
    "warm-up": (-0.02 * np.exp(-np.arange(VIEWS) / 3), VariationKind.WARM_UP),
}


@pytest.mark.parametrize(
    "name",
    ["step", *(pytest.param(name, marks=pytest.mark.slow) for name in ("alternating", "warm-up"))],
)
def test_a_focal_length_that_differs_is_named_with_its_kind(name: str) -> None:
    sizes, kind = PATTERNS[name]
    made = refocused(session(5, "wet-flat"), sizes)
    differing = Differing.of(optimum(made), context_of(made))
    assert differing
    assert (differing.first.group.name, differing.first.kind) == ("focal", kind)
    assert "focal length" in str(differing)


@pytest.mark.slow
def test_a_step_is_told_with_its_first_picture_and_what_to_do() -> None:
    made = refocused(session(5, "wet-flat"), PATTERNS["step"][0])
    differing = Differing.of(optimum(made), context_of(made))
    assert differing
    text = str(differing)
    assert f"changes at {made.views[FIRST].name}" in text
    assert f"calibrate from {made.views[FIRST].name} on" in text
    assert differing.as_json()["members"]["focal"] > 0.5


def test_two_cameras_in_one_session_are_a_lens_of_two_kinds() -> None:
    """The views of the two cameras follow no order."""
    made = session(6, "thin-cone")
    second = np.random.default_rng(2).permutation(VIEWS) < VIEWS // 2

    def change(view: int) -> Values:
        size = 1.0 if second[view] else -1.0
        focal = {name: made.values[name] * (1 + 0.01 * size) for name in CAMERA.focal}
        return focal | {name: made.values[name] + 8 * size for name in CAMERA.centre}

    first = find_variations(optimum(varied(made, change)), context_of(made))[0]
    assert (first.group.name, first.kind) == ("lens", VariationKind.TWO_KINDS)
    assert abs(np.corrcoef(first.pattern, second)[0, 1]) > 0.85  # a view or two tell little


def test_a_print_without_a_shear_may_have_one_in_single_views() -> None:
    made = session(4, "dome")
    rows = VariationRows.of(optimum(made).with_neutral([BoardScale()]), context_of(made))
    groups = {group.name: group for group in groups_of(context_of(made))}
    columns = rows.columns(groups["board_scale"])
    moved = np.concatenate([view[:, rows.own :] @ columns for view in rows.views])
    assert (np.linalg.norm(moved, axis=0) > 1).all()  # over the noise


def test_a_global_shutter_s_board_does_not_move() -> None:
    made = session(4, "dome")
    names = [group.name for group in groups_of(context_of(made, Shutter(rolling=False)))]
    assert "rolling_shutter" not in names


@pytest.mark.slow
def test_what_is_smooth_in_single_views_and_of_no_cause_has_no_name() -> None:
    """A displacement of 0.1 px over the board, of third degree and another in each view."""
    made = session(8, "dome")
    rng = np.random.default_rng(3)
    u, v = (made.board.points() / np.abs(made.board.points()).max(0)).T
    waves = np.stack([np.sin(3 * u) * v, np.cos(3 * v) * u, u * u * v, np.sin(4 * u + 4 * v)], 1)
    views = [
        replace(view, corners=view.corners + waves @ rng.normal(0, 0.1, (4, 2)))
        for view in made.views
    ]
    made = replace(made, views=tuple(views))
    differing = Differing.of(optimum(made), context_of(made))
    assert differing is None or not differing.named
    assert INTRINSICS.fx.value == float(made.values[CAMERA.fx])


def test_what_no_view_determines_ends_no_question() -> None:
    """Rounding errors make the information about it indefinite."""
    made = session(8, "wet-flat")
    rows = VariationRows.of(optimum(made), context_of(made))
    values, axes = np.linalg.eigh(VariationEquations.of(rows)._shared_products[:-1, :-1])
    lost = (values[0] + 1e-14 * values[-1]) * np.outer(axes[:, 0], axes[:, 0])
    indefinite = replace(rows, precision=rows.precision - lost)
    assert np.isfinite(VariationEquations.of(indefinite).solution).all()


@pytest.mark.slow
def test_a_cause_beside_something_smaller_of_no_cause_has_its_name() -> None:
    """A board that bends, and a smooth field of each view's own: as measured boards are."""
    made = session(8, "wet-flat")
    for name, factor in (("board_flex/each", 1.0), ("smooth-field/each", 0.5)):
        cause = next(cause for cause in CAUSES if cause.name == name)
        made = cause.applied(made, factor * cause.deviations(made, np.random.default_rng(4)))
    differing = Differing.of(optimum(made), context_of(made))
    assert differing
    assert differing.first.group.name == "board_flex"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vibration/each", "smooth-field/each", "edge-pull/near"])
def test_what_has_no_known_cause_has_no_name(name: str) -> None:
    """A vibration, a field of each view's own, and blur at the picture's edge in near views are
    nearer to a motion of the board or to another lens than to anything else that has a name.
    """
    made = session(9, "dome")
    cause = next(cause for cause in CAUSES if cause.name == name)
    made = cause.applied(made, cause.deviations(made, np.random.default_rng(4)))
    differing = Differing.of(optimum(made), context_of(made))
    print(differing)
    assert not (differing and (differing.named or differing.likely))
    if name == "edge-pull/near":
        assert "the distortion of the picture follows the distance of the board" in str(differing)


def test_a_nameless_variation_is_told_without_a_name() -> None:
    structure = nameless_variation(50.0, 3)
    differing = Differing((structure,), (1.0,), ("a", "b", "c"))
    assert not differing.named
    assert not differing.likely
    assert "no number of the camera, the cover or the board explains it" in str(differing)
    assert differing.as_json()["number"] == ""


def test_the_best_name_is_tried_with_what_forbids_it_to_stand_alone() -> None:
    made = session(5, "wet-flat")
    groups = {group.name: group for group in groups_of(context_of(made))}
    deviations = np.zeros((VIEWS, 1))
    names = ("focal", "principal_point", "thickness")
    variations = tuple(
        Variation(groups[name], VariationKind.EACH, 20.0, np.ones(1), deviations, np.zeros(0))
        for name in names
    )
    view_names = tuple(view.name for view in made.views)
    differing = Differing(variations, (0.6, 0.37, 0.03), view_names)
    assert [variation.group.name for variation in differing.likely] == ["focal", "principal_point"]
    nameless = replace(variations[0], group=groups[DISTORTION])
    differing = Differing((nameless, variations[1]), (0.9, 0.1), view_names)
    assert not differing.named
    assert not differing.likely
    assert "else the principal point" in str(differing)
