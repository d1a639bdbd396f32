"""The laws that hold for every effect.

Every effect of the registry is tested here.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from torch import Tensor

from calib.calibration import Calibration
from calib.calibration_content import AddedEffect
from calib.commands.effect_names import effects_help
from calib.effects.cover_offset import CoverOffset
from calib.effects.cover_tilt import CoverTilt
from calib.effects.description import describe_effect
from calib.effects.effect import Effect
from calib.effects.fine_surface import FineSurface
from calib.effects.focal import Focal
from calib.effects.free_field import FreeField
from calib.effects.principal_point import PrincipalPoint
from calib.effects.registry import KINDS
from calib.effects.serialise import Estimated, effect_from_yaml, effect_to_yaml
from calib.estimation.parameters import Parameters
from calib.estimation.priors import NONE
from calib.estimation.residual_blocks import ResidualBlock, make_residual_blocks
from calib.optics.params import Values
from calib.optics.relief import Relief
from calib.optics.view_blocks import POSE, VIEW_BLOCKS
from tests.effects.forms import FORMS, SITUATIONS, Form, Situation, each_form

SMALLEST = 1e-9
"""m, on the board: what a change of one scale moves at least somewhere."""
MOST = 12
"""Numbers of one effect that meet central differences; of reliefs and fields, evenly chosen ones.
"""

each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
each_situation = pytest.mark.parametrize(
    "situation", SITUATIONS, ids=lambda situation: situation.cover.shape
)


def land(form: Form, values: dict[str, Tensor], poses: Tensor) -> Tensor:
    observations = form.situation.observations
    landed, failure = form.model.path.land(
        observations.pixels, values, poses[observations.view], observations.exposure
    )
    assert not failure.any()
    return landed


def land_without(situation: Situation) -> Tensor:
    observations = situation.observations
    landed, failure = situation.path.land(
        observations.pixels,
        situation.values,
        situation.poses[observations.view],
        observations.exposure,
    )
    assert not failure.any()
    return landed


@each_kind
def test_every_effect_is_possible_somewhere(kind: type[Effect]) -> None:
    assert any(isinstance(form.effect, kind) for form in FORMS)


@each_kind
def test_every_effect_has_a_plain_description(kind: type[Effect]) -> None:
    """The description is one sentence, which the diagnosis and the help of the commands print."""
    assert re.fullmatch(r"[A-Z][^.]{15,}\.", describe_effect(kind.name))
    assert f"{kind.name} " in effects_help()
    assert kind.description.removesuffix(".") in effects_help()


@each_form
def test_neutral_parameters_change_no_landing(form: Form) -> None:
    model = form.model
    neutral = {**form.situation.values, **model.neutral_values(form.effect)}
    assert (
        land(form, neutral, model.pad_poses(form.situation.poses)) - land_without(form.situation)
    ).abs().max() < 1e-14  # m


@each_form
def test_the_path_reads_the_effect_s_parameters(form: Form) -> None:
    """A fit estimates only the parameters that a path names."""
    read = {param.name: param for param in form.model.path.params}
    assert form.effect.effect_parameters or form.effect.per_view
    for unknown in form.effect.effect_parameters:
        assert read[unknown.param.name] == unknown.param
        assert unknown.param.name.startswith(f"{form.effect.name}.")
        assert unknown.sigma > 0


@each_form
def test_increments_do_what_the_declared_numbers_would(form: Form) -> None:
    """The path uses the sum that is shown as declared + increment. Turns about different axes add
    up to first order only: the largest stated tilt, some hundredths of a radian, bounds what is
    left of them.
    """
    values, poses = form.present()
    for unknown in form.effect.effect_parameters:
        if unknown.shifts:
            name = unknown.param.name
            other_values = {**form.situation.values, **form.model.neutral_values(form.effect)}
            by_effect = land(form, {**other_values, name: values[name]}, poses)
            change = values[name]
            moved = {
                s: other_values[s] * (1 + change) if unknown.relative else other_values[s] + change
                for s in unknown.shifts
            }
            declared = land(form, {**other_values, **moved}, poses)
            size = (by_effect - land(form, other_values, poses)).abs().max()
            assert size > SMALLEST
            assert (by_effect - declared).abs().max() < (
                0.1 * size if form.effect.name == "cover_tilt" else 1e-12
            ), name


def test_effects_on_declared_numbers_name_them() -> None:
    saying = {
        form.effect.name
        for form in FORMS
        for unknown in form.effect.effect_parameters
        if unknown.shifts
    }
    assert saying == {
        "principal_point",
        "focal",
        "cover_tilt",
        "cover_offset",
        "cover_radius",
        "thickness",
        "refractive_index",
    }


@each_form
def test_derivatives_agree_with_central_differences(form: Form) -> None:
    """The derivatives are those of a fit, by every number of the effect and of the views, and every
    one of these moves some landing point.
    """
    values, poses = form.present()
    landing = _landing(form, values, poses)
    scales = [
        (u.param.name, u.param.scale, entry)
        for u in form.effect.effect_parameters
        for entry in np.ndindex(u.param.shape)
    ]
    at = landing.linearise(values, poses)
    assert (
        at.residual - _residual(landing, values, poses)[0]
    ).abs().max() < 1e-15  # m; sums in another order
    moved = at.jacobian_shared.abs().amax((0, 1))
    idle = [
        f"{name}{list(entry)}"
        for (name, _, entry), size in zip(scales, moved, strict=True)
        if size < SMALLEST
    ]
    assert len(idle) <= 0.1 * len(scales), idle  # of a patch of glass, corners may miss the rim
    for column, (name, scale, entry) in [
        item for item in enumerate(scales) if moved[item[0]] >= SMALLEST
    ][:: len(scales) // MOST + 1]:
        step = torch.zeros_like(values[name])
        step[entry] = 1e-3 * scale
        forward = _residual(landing, {**values, name: values[name] + step}, poses)[0]
        backward = _residual(landing, {**values, name: values[name] - step}, poses)[0]
        _compare(
            at.jacobian_shared[..., column], (forward - backward) / 2e-3, f"{name}{list(entry)}"
        )
    for column in range(poses.shape[1]):
        step = torch.zeros_like(poses)
        step[:, column] = 1e-5
        near = _difference(landing, values, poses, step)
        far = _difference(landing, values, poses, 2 * step)
        is_pose = column < VIEW_BLOCKS[POSE]
        _compare(
            at.jacobian_block[..., column],
            # Fine bends need the fourth order. A pose moves corners over the board's rim.
            near / 2e-5 if is_pose else (8 * near - far) / 12e-5,
            f"number {column} of a view",
        )


@each_form
def test_the_relief_s_derivatives_hold_beside_it(form: Form) -> None:
    """The relief's derivatives go through probes and the chart of the glass, which an effect may
    move.
    """
    if not form.situation.relief:
        return
    values, poses = form.present()
    landing = _landing(form, values, poses, relief_moves=True)
    at = landing.linearise(values, poses)
    direction = torch.from_numpy(
        np.random.default_rng(6).normal(0, 1, values["relief.amplitudes"].shape)
    )
    forward = _residual(
        landing,
        {**values, "relief.amplitudes": values["relief.amplitudes"] + 1e-8 * direction},
        poses,
    )[0]
    backward = _residual(
        landing,
        {**values, "relief.amplitudes": values["relief.amplitudes"] - 1e-8 * direction},
        poses,
    )[0]
    _compare(
        at.jacobian_shared[..., : direction.numel()] @ direction.flatten(),
        (forward - backward) / 2e-8,
        "relief",
    )


@each_form
def test_an_effect_is_read_as_it_was_written(form: Form) -> None:
    values, _ = form.present()
    parameters = _estimated(form, values)
    text = yaml.safe_dump(effect_to_yaml(form.effect, parameters))
    effect, read_back = effect_from_yaml(yaml.safe_load(text))
    assert effect == form.effect
    assert read_back.keys() == parameters.keys()
    for name, arrays in parameters.items():
        assert all(
            np.array_equal(written_array, read_array)
            for written_array, read_array in zip(arrays, read_back[name], strict=True)
        )


@each_form
def test_a_calibration_keeps_it(form: Form, tmp_path: Path) -> None:
    values, poses = form.present()
    made = form.situation.calibration([AddedEffect(form.effect, _estimated(form, values))], poses)
    read_back = Calibration.load(made.save(tmp_path))
    observations = read_back.observations
    for written_rays, read_rays in zip(
        made.rays(observations.pixels.numpy()),
        read_back.rays(observations.pixels.numpy()),
        strict=True,
    ):
        assert np.array_equal(written_rays, read_rays)
    path, read = read_back.model()
    landed, _ = path.land(
        observations.pixels,
        read,
        torch.from_numpy(read_back.poses)[observations.view],
        observations.exposure,
    )
    assert torch.equal(landed, land(form, values, poses))
    assert (landed - land_without(form.situation)).abs().max() > 1e-7, "it is there"


@each_situation
def test_estimated_numbers_are_not_proposed_again(situation: Situation) -> None:
    names = [param.name for param in situation.path.params]
    kinds: tuple[type[Effect], ...] = (PrincipalPoint, Focal, CoverOffset, CoverTilt)
    assert not [effect for kind in kinds for effect in kind.propose(situation.surroundings(names))]


@each_situation
def test_finer_glass_needs_a_place_that_asks_for_it(situation: Situation) -> None:
    assert not FineSurface.propose(situation.surroundings(placed=False))
    proposed = FineSurface.propose(situation.surroundings())
    assert [effect.form for effect in proposed] == (["", "bump"] if situation.relief else [])
    for effect in proposed[:1]:
        assert situation.relief
        assert isinstance(effect.relief, Relief)
        assert effect.relief.spacing == pytest.approx(
            [step / 7 for step in situation.relief.spacing]
        )


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"name": "phlogiston"}, "phlogiston"),
        ({"form": {"high": 1}}, "form.high of free_field is not of the right type"),
        ({"parameters": {}}, "free_field.board.x"),
        (
            {
                "parameters": {
                    f"free_field.board.{axis}": {"value": [1.0], "sigma": [1.0]} for axis in "xy"
                }
            },
            "is not a number of its shape",
        ),
    ],
    ids=["unknown name", "wrong form", "missing number", "wrong shape"],
)
def test_a_file_without_a_known_effect_is_refused(change: dict[str, object], reason: str) -> None:
    form = next(form for form in FORMS if isinstance(form.effect, FreeField))
    entry = effect_to_yaml(form.effect, _estimated(form, form.present()[0]))
    with pytest.raises((LookupError, TypeError, ValueError), match=reason):
        effect_from_yaml(entry | change)


def _difference(landing: ResidualBlock, values: Values, poses: Tensor, step: Tensor) -> Tensor:
    forward = _residual(landing, values, poses + step)[0]
    return forward - _residual(landing, values, poses - step)[0]


def _landing(
    form: Form, values: dict[str, Tensor], poses: Tensor, *, relief_moves: bool = False
) -> ResidualBlock:
    observations = form.situation.observations
    weights = torch.eye(2, dtype=torch.float64).expand(len(observations.pixels), 2, 2)
    relief = form.model.path.relief if relief_moves else None
    parameters = Parameters(
        values, relief, tuple(u.param for u in form.effect.effect_parameters), NONE
    )
    (landing,) = make_residual_blocks(form.model.path, parameters, observations, weights)
    assert _residual(landing, values, poses)[1].all()
    return landing


def _compare(analytic: Tensor, numeric: Tensor, name: str) -> None:
    size = numeric.abs().max()
    assert size > SMALLEST, f"{name} moves no landing"
    worst = (analytic - numeric).abs().max() / size
    loose = name.startswith("fine_surface")
    assert worst < (1e-4 if loose else 1e-6), f"{name}: off by {worst:.1e} of its own size"


def _estimated(form: Form, values: dict[str, Tensor]) -> Estimated:
    return {
        u.param.name: (values[u.param.name].numpy(), np.full(u.param.shape, u.sigma))
        for u in form.effect.effect_parameters
    }


def _residual(landing: ResidualBlock, values: Values, poses: Tensor) -> tuple[Tensor, Tensor]:
    return landing.residual(landing.rays(values, poses), values, poses)
