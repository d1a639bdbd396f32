"""A calibration in another medium: its rays are those that Mitsuba traces there, and its sigma is
what the change makes visible.
"""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.apply.change_medium import DEPTHS, Immersion, immerse, replace_medium
from calib.apply.dominant_uncertainty import MAX_SIGMA_PX
from calib.apply.map_uncertainty import predicted_sigma
from calib.apply.water import index_of_water
from calib.calibration import Calibration
from calib.calibration_content import AddedEffect
from calib.cli import main
from calib.diagnosis.all_free import all_free
from calib.effects.cover_offset import CoverOffset
from calib.effects.effect import EffectContext
from calib.effects.flat_port import FlatPort
from calib.effects.free_field import FreeField
from calib.effects.refractive_index import RefractiveIndex
from calib.errors import InputError
from calib.fit_record.history import MediumChange
from calib.fit_record.request import FitRequest, Settings
from calib.fitting.corner_range import corners_at
from calib.fitting.evaluate import evaluate
from calib.fitting.fit import fit
from calib.fitting.setup import Setup
from calib.optics.exposure import MIDDLE
from calib.optics.relief import Relief
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.freeing import AUTO, NONE
from calib.session.schema import Number
from calib.session.session import read_session
from fixtures.calibrated import CAMERA, calibrated, tolerant
from fixtures.housing import INDEX, WINDOW
from fixtures.known import known, lens_alone
from fixtures.rays import FIXTURES, map_error
from fixtures.synthetic import INTRINSICS, paper_cone, scene
from fixtures.wet import GLASS

Array = NDArray[np.float64]

WATER = Number(1.34)
each_shape = pytest.mark.parametrize("shape", GLASS)


def true_calibration(shape: str) -> Calibration:
    """In air, with the numbers that the glass of wet-SHAPE was rendered with."""
    with np.load(FIXTURES / f"wet-{shape}" / "truth.npz") as truth:
        fx, fy, cx, cy = map(Number, truth["intrinsics"].tolist())
        amplitudes, centres = truth["amplitudes"], truth["centres"]
    numbers = {
        name: Number(value) for name, value in {**GLASS[shape], "outside_index": 1.0}.items()
    }
    base = known(scene(1, views=1), 820, 616)
    relief = None
    if amplitudes.size:
        (low, high), (rows, columns) = (
            (tuple(map(float, edge)) for edge in (centres.min(0), centres.max(0))),
            amplitudes.shape,
        )
        relief = Relief((low[0], low[1]), (high[0], high[1]), (rows, columns))
    camera = Camera(820, 616, intrinsics=Intrinsics(fx, fy, cx, cy))
    return replace(
        base, camera=camera, cover=Cover(shape, numbers), relief=relief, amplitudes=amplitudes
    )


@each_shape
@pytest.mark.parametrize("folder", ["", "water"])
def test_rays_are_those_of_light_that_mitsuba_traced(shape: str, folder: str) -> None:
    """Under water, from the numbers in air; and in air again, from the calibration for water."""
    dry = true_calibration(shape)
    wet = replace_medium(dry, WATER)
    calibration_tried = wet if folder else replace_medium(wet, Number(1.0))
    with np.load(FIXTURES / f"wet-{shape}" / folder / "truth.npz") as truth:
        pixels = truth["pixels"]
        origins = truth["origins"]
        directions = truth["directions"]
    ours, towards = calibration_tried.rays(pixels)
    visible = np.isfinite(origins).all(-1) & np.isfinite(ours).all(-1)
    assert visible.mean() > 0.99
    for depth in DEPTHS:
        at = [
            o[:, :2] + d[:, :2] * ((depth - o[:, 2]) / d[:, 2])[:, None]
            for o, d in ((origins, directions), (ours, towards))
        ]
        error = np.linalg.norm(at[0] - at[1], axis=-1)[visible] * 640 / depth
        assert np.sqrt((error**2).mean()) < 0.002
        assert error.max() < 0.02  # float32 and facets


@pytest.fixture(scope="module")
def dry() -> Calibration:
    """Return the calibration of a scene in air, with cover and camera near their stated numbers."""
    made = scene(5, views=12, noise=0.1)
    return tolerant(made, Setup(made.board, CAMERA, INTRINSICS, made.cover), Settings(grid=(4, 4)))


def test_everything_but_the_medium_outside_is_kept(dry: Calibration) -> None:
    wet = replace_medium(dry, Number(1.34, 0.001))
    assert wet.camera == dry.camera
    assert wet.cover.parameters["outside_index"] == Number(1.34, 0.001)
    alternatives = {
        name: number.value
        for name, number in wet.cover.parameters.items()
        if name != "outside_index"
    }
    assert alternatives == {
        name: number.value
        for name, number in dry.cover.parameters.items()
        if name != "outside_index"
    }
    assert wet.declared.cover.parameters["outside_index"] == Number(1.34, 0.001)
    assert np.array_equal(wet.amplitudes, dry.amplitudes)
    assert (wet.views, wet.stages, wet.poses.shape) == ((), (), (0, 6))
    assert np.array_equal(wet.corners_at, corners_at(dry))
    assert wet.history.medium_change == MediumChange(
        from_index=1.0, to_index=1.34, sigma=0.001, calibration=dry.digest
    )


def test_the_covariance_is_carried_there_and_back(dry: Calibration) -> None:
    wet = replace_medium(dry, Number(1.34, 0.002))
    parameters = wet.camera_model().parameters
    assert len(wet.covariance) == parameters.count == len(dry.covariance) + 1
    (at,) = parameters.entries(["cover.outside_index"])
    alternatives = np.arange(parameters.count) != at
    assert (
        np.linalg.eigvalsh(
            wet.covariance[np.ix_(alternatives, alternatives)] - dry.covariance
        ).min()
        > -1e-9 * np.abs(wet.covariance).max()
    )
    assert np.isclose(wet.covariance[at, at], (0.002 / 0.01) ** 2)
    assert not wet.covariance[at, alternatives].any()
    back_in_air = replace_medium(wet, Number(1.0))
    assert np.allclose(
        back_in_air.covariance, wet.covariance[np.ix_(alternatives, alternatives)], rtol=1e-9
    )
    pixels = np.random.default_rng(1).uniform(100, 2300, (50, 2))
    assert all(
        np.array_equal(a, b)
        for a, b in zip(back_in_air.rays(pixels), dry.rays(pixels), strict=True)
    )
    assert np.array_equal(back_in_air.corners_at, wet.corners_at)


def test_sigma_is_the_spread_of_calibrations_drawn_from_the_covariance(dry: Calibration) -> None:
    """The test traces rays: numbers are drawn from the covariance in air, put under water, and the
    best rigid motion is taken off.
    """
    wet = replace_medium(dry, Number(1.34, 0.001))
    model, field = wet.camera_model(), predicted_sigma(wet)
    assert field
    rng, corners = np.random.default_rng(2), wet.corners_at
    subset = corners[rng.permutation(len(corners))[:150]]
    pixels, depth = subset[:, :2], subset[:, 2]
    small = 0.05  # of a sigma: so far it is linear
    roots = np.linalg.cholesky(wet.covariance + 1e-18 * np.eye(len(wet.covariance)))
    focal = float(model.means["camera.fx"])

    def seen(vector: Array, metres: Array) -> tuple[Array, Array, Array]:
        rays = model.path.trace(
            torch.from_numpy(pixels), model.parameters.values(torch.from_numpy(vector)), MIDDLE
        )
        origin, direction = rays.origin.stacked().numpy(), rays.direction.stacked().numpy()
        return origin, direction, at(origin, direction, metres)

    def at(origin: Array, direction: Array, metres: Array) -> Array:
        return np.asarray(
            focal
            * (origin + direction * ((metres - origin[:, 2]) / direction[:, 2])[:, None])[:, :2]
            / metres[:, None]
        )

    zero = np.zeros(len(roots))
    origin, direction, at_rest = seen(zero, depth)
    item = np.full(len(pixels), 0.5)
    far_pixels = seen(zero, item)[2]
    step, trained, requested_sigmas = 1e-6, [], []
    for axis in np.eye(3) * step:
        for o, d in (
            (origin + np.cross(axis, origin), direction + np.cross(axis, direction)),
            (origin + axis, direction),
        ):
            trained.append((at(o, d, depth) - at_rest).ravel() / step)
            requested_sigmas.append((at(o, d, item) - far_pixels).ravel() / step)
    solve, move = np.linalg.pinv(np.stack(trained, -1)), np.stack(requested_sigmas, -1)
    squares = np.zeros(len(pixels))
    draws = 200
    for _ in range(draws):
        vector = small * roots @ rng.normal(size=len(roots))
        error = (seen(vector, item)[2] - far_pixels).ravel() - move @ (
            solve @ (seen(vector, depth)[2] - at_rest).ravel()
        )
        squares += (error.reshape(-1, 2) ** 2).sum(-1) / small**2
    result = float(np.sqrt(squares.mean() / draws))
    predicted = float(np.sqrt((field.at(pixels[:, :1], pixels[:, 1:], 0.5) ** 2).mean()))
    assert (
        abs(result / predicted - 1) < 0.2
    )  # 200 draws of few numbers, and the motion of 150 of the corners


def test_numbers_that_move_no_ray_in_air_are_uncertain_under_water() -> None:
    """The centre of a dome hardly matters to views in air, and matters most under water. With the
    requested sigma, it is known well enough.
    """
    session = read_session(FIXTURES / "wet-dome")

    def stated(sigma: float) -> Immersion:
        numbers = {
            name: replace(n, sigma=sigma) if name.startswith("centre") else n
            for name, n in session.cover.parameters.items()
        }
        return immerse(fit(replace(session, cover=Cover("dome", numbers))), WATER)

    wide = stated(0.002)
    assert max(wide.before_px) < 0.02
    assert wide.unknown
    loose = wide.dominant[0]
    assert loose.name == "centre"
    assert max(loose.sigma_px) < 0.35 * min(wide.after_px)
    assert loose.measured_to is not None
    assert loose.unit == "mm"
    tight = stated(1e-3 * loose.measured_to)
    assert max(tight.after_px) == pytest.approx(MAX_SIGMA_PX, rel=0.3)
    assert max(wide.after_px) > 1.4 * max(tight.after_px)


def test_no_number_of_an_uneven_cover_gets_less_than_its_declared_sigma(dry: Calibration) -> None:
    wet = replace_medium(dry, WATER)
    declared = {
        name: number.sigma for name, number in dry.declared.cover.parameters.items() if number.sigma
    }
    assert declared
    for name, sigma in declared.items():
        assert wet.cover.parameters[name].sigma == pytest.approx(sigma)
        assert dry.cover.parameters[name].sigma <= sigma * 1.01
    smooth = replace(dry, relief=None, amplitudes=np.zeros((0, 0)))
    count = smooth.camera_model().parameters.count
    alone = replace(smooth, covariance=dry.covariance[-count:, -count:])
    assert np.array_equal(replace_medium(alone, WATER).covariance, alone.covariance)


def test_a_held_number_gets_the_tolerance_of_its_kind() -> None:
    """Not as sure as exact: it was declared without a sigma, and held since the views say nothing
    against it.
    """
    numbers = {
        name: Number(number.value, exact=name == "thickness")
        for name, number in paper_cone().parameters.items()
    }
    made = scene(5, views=12, noise=0.1)
    setup = Setup(made.board, CAMERA, INTRINSICS, Cover("cone", numbers))
    held = calibrated(made, setup, Settings(grid=(4, 4), free=(NONE,)))
    assert not any(number.sigma for number in held.cover.parameters.values())
    assert all_free(held) is held
    freed = all_free(replace(held, request=FitRequest(Settings(free=(AUTO,)))))
    held_names = {name for name, number in freed.cover.parameters.items() if not number.sigma}
    assert held_names == {"thickness", "outside_index"}
    assert max(immerse(freed, WATER).after_px) > 3 * max(immerse(held, WATER).after_px)
    assert all_free(freed) is freed


@pytest.mark.slow
@each_shape
def test_errors_under_water_agree_with_their_predicted_sigma(shape: str) -> None:
    """`python -m benchmarks.immerse` prints these, and the figures of docs/immersing.md."""
    folder = FIXTURES / f"wet-{shape}"
    dry = fit(read_session(folder))
    put = immerse(dry, WATER)
    error = map_error(put.calibration, folder / "water" / "truth.npz", near=40.0)
    for depth, px in error.by_depth.items():
        print(f"{shape}: {px:.3f} px at {depth:g} m, {error.predicted[depth]:.3f} expected")
        assert px < 1.7 * error.predicted[depth]
    water = read_session(folder / "water")
    initial = evaluate(dry, water).rms_px
    final = evaluate(put.calibration, water).rms_px
    assert final < 0.1
    assert final < initial / 5


def test_accepted_effects_are_carried_over() -> None:
    base = true_calibration("flat")
    numbers = (
        ("cover_offset.distance", CoverOffset(("cover.distance",)), 0.002),
        ("refractive_index.refractive_index", None, 0.01),
    )
    (name, offset, by), (second_name, _, second_offset) = numbers
    assert offset
    effects = (
        AddedEffect(offset, {name: (np.array(by), np.array(0.0))}),
        AddedEffect(
            RefractiveIndex(("cover.refractive_index",)),
            {second_name: (np.array(second_offset), np.array(0.0))},
        ),
    )
    moved = {
        **GLASS["flat"],
        "distance": WINDOW.place + by,
        "refractive_index": INDEX + second_offset,
        "outside_index": 1.34,
    }
    plain = replace(base, cover=Cover("flat", {key: Number(value) for key, value in moved.items()}))
    pixels = np.random.default_rng(1).uniform(0, 600, (50, 2))
    wet = replace_medium(replace(base, effects=effects), WATER).rays(pixels)
    assert all(np.allclose(a, b, atol=1e-14) for a, b in zip(wet, plain.rays(pixels), strict=True))


def test_a_window_found_by_the_diagnosis_must_be_declared_first() -> None:
    base = replace(lens_alone(scene(1, views=1), 820, 616, 640.0, 640.0, 410.0, 308.0))
    effect = AddedEffect(
        FlatPort("air"),
        {
            f"flat_port.{name}": (np.array(0.001), np.array(0.0))
            for name in ("tilt.x", "tilt.y", "thickness")
        },
    )
    with pytest.raises(
        InputError, match=r"describe it under cover in session\.yaml, with its distance_mm"
    ):
        replace_medium(replace(base, effects=(effect,)), WATER)


def test_without_a_cover_there_is_nothing_to_do() -> None:
    with pytest.raises(
        InputError,
        match="this calibration has no cover, and what water does is done at a window or dome",
    ):
        replace_medium(lens_alone(scene(1, views=1), 820, 616, 640.0, 640.0, 410.0, 308.0), WATER)


def test_a_glass_that_lets_no_light_out_is_refused(dry: Calibration) -> None:
    thick = replace(dry.cover.parameters["refractive_index"], value=2.9)
    dense = replace(
        dry,
        cover=replace(
            dry.cover,
            parameters={
                **dry.cover.parameters,
                "refractive_index": thick,
                "inner_radius": Number(1e-3),
            },
        ),
    )
    with pytest.raises(
        InputError, match="no ray of this camera leaves its cover into an index of 1"
    ):
        immerse(dense, Number(1.0))


@pytest.mark.parametrize(
    ("temperature", "index"),
    [
        (14, 1.33348),
        (16, 1.33333),
        (18, 1.33317),
        (20, 1.33299),
        (22, 1.33281),
        (24, 1.33262),
        (26, 1.33241),
        (28, 1.33219),
        (30, 1.33192),
    ],
)
def test_the_index_of_fresh_water(temperature: float, index: float) -> None:
    """CRC Handbook of Chemistry and Physics: index of refraction of water against air, sodium
    light.
    """
    assert abs(index_of_water(0, temperature, 589.3) - index) < 4e-5


def test_the_index_of_sea_water() -> None:
    """35 per mille at 20 degrees C raise it by 0.0064, blue light by more than red."""
    assert abs(index_of_water(35, 20, 589.3) - index_of_water(0, 20, 589.3) - 0.0064) < 1e-4
    assert index_of_water(35, 20, 450) > index_of_water(35, 20, 550) > index_of_water(35, 20, 650)


@pytest.fixture(scope="module")
def saved(dry: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dry")
    dry.save(folder)
    return folder


@pytest.mark.slow
def test_the_command(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The new calibration has sigma and maps like any other, and refuses uses that need views."""
    assert main(["immerse", str(saved), "--salinity", "35", "--depth", "0.5", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer) == {"outside_index", "maps", "known", "loose", "remarks", "written"}
    assert answer["outside_index"] == {
        "value": pytest.approx(index_of_water(35, 15, 550)),
        "sigma": 0.001,
    }
    (row,) = answer["maps"]
    assert row["depth_m"] == 0.5
    assert row["sigma_px"] > row["sigma_before_px"] > 0
    assert answer["known"] is (row["sigma_px"] <= MAX_SIGMA_PX)
    assert [Path(path).name for path in answer["written"]] == [
        "calibration.yaml",
        "rays.npz",
        "map_0.5m.npz",
    ]
    folder = saved / "immersed"
    wet = Calibration.load(folder)
    assert wet.corners_at.shape == corners_at(Calibration.load(saved)).shape
    with np.load(folder / "map_0.5m.npz") as file:
        assert np.nanmedian(file["sigma"]) > 0
    assert (
        main(["export", str(folder), "--format", "npz", "--depth", "1", "-o", str(folder / "maps")])
        == 0
    )
    assert main(["report", "--no-open", str(folder)]) == 3
    answer = capsys.readouterr().err
    assert "the calibration has no views to report on" in answer
    assert "calib check --update" in answer


@pytest.mark.parametrize(
    ("words", "sigma"),
    [
        (["--outside-index", "1.333"], 0.004),
        (["--outside-index", "1.333+-0.002"], 0.002),
        (["--outside-index", "1.333", "--index-sigma", "0.003"], 0.003),
        (["--outside-index", "1"], 0.0),
        (["--salinity", "35"], 0.001),
    ],
)
def test_a_plain_index_of_water_is_known_as_in_a_fit(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], sigma: float
) -> None:
    assert main(["immerse", str(saved), *words, "--json", "-o", str(tmp_path / "wet")]) == 0
    assert json.loads(capsys.readouterr().out)["outside_index"]["sigma"] == sigma


def test_the_command_prints_sentences_for_people(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(
            [
                "immerse",
                str(saved),
                "--outside-index",
                "1.34",
                "--index-sigma",
                "0.1",
                "-o",
                str(tmp_path / "wet"),
            ]
        )
        == 0
    )
    out, err = capsys.readouterr()
    assert "outside index 1.34 ± 0.10" in " ".join(out.split())
    assert re.search(r"outside 1\.34( +│ +\d+\.\d{3} px){3}", out)
    assert re.search(r"\.\.\. with the index of what is outside exact( +│ +\d+\.\d{3} px){3}", out)
    assert "the views do not determine the index of what is outside" in err
    assert "Or, for the index of what is outside: measure its salinity" in err
    assert "measure its salinity and temperature, and write --index-sigma" in err
    assert (
        main(
            ["immerse", str(tmp_path / "wet"), "--outside-index", "1", "-o", str(tmp_path / "dry")]
        )
        == 0
    )
    pixels = np.random.default_rng(1).uniform(100, 2300, (50, 2))
    back = Calibration.load(tmp_path / "dry").rays(pixels)
    first = Calibration.load(saved).rays(pixels)
    assert all(
        np.array_equal(one_side, second) for one_side, second in zip(back, first, strict=True)
    )


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "the medium outside is not stated: write --outside-index 1.34, or --salinity 35"),
        (
            ["--outside-index", "1.34", "--temperature", "10"],
            "--outside-index already fixes the index",
        ),
        (["--outside-index", "0.9"], "write a number from 1 to 2"),
        (["--outside-index", "1.34+-0.2"], "write a number from 0 to 0.1"),
        (
            ["--outside-index", "1.34+-0.01", "--index-sigma", "0.1"],
            "--outside-index already has a sigma",
        ),
        (["--salinity", "nan"], "write a number from 0 to 35"),
        (["--temperature", "40"], "write a number from 0 to 30"),
        (["--wavelength", "0.55"], "write a number from 400 to 700"),
    ],
)
def test_wrong_options_get_their_sentence(
    saved: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    try:
        code: object = main(["immerse", str(saved), *words])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err


def test_an_effect_without_a_cause_is_reported(dry: Calibration) -> None:
    path, values = dry.model()
    field, *_ = FreeField.propose(
        EffectContext(dry.board, dry.camera.width, dry.camera.height, path, values)
    )
    nothing = {
        unknown.param.name: (np.zeros(unknown.param.shape), np.zeros(unknown.param.shape))
        for unknown in field.effect_parameters
    }
    mended = replace(dry, covariance=np.zeros((0, 0)), effects=(AddedEffect(field, nothing),))
    assert immerse(mended, WATER).unexplained == ("free_field",)
    assert immerse(dry, WATER).unexplained == ()
