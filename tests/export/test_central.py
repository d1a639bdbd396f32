"""The central camera that comes nearest to a covered one."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from calib.calibration import Calibration
from calib.errors import InputError
from calib.export import central
from calib.export.central import best_central
from calib.export.formats import FORMATS, OPENCV, SPLINED, ExportLens
from calib.export.lens_fit import fit_export_lens, project_slopes
from calib.export.sampled_rays import FIT_GRID, SampledRays
from calib.export.spline_fit import project_spline
from tests.export.truth import LENS, distorted, fisheye, seen

FOUR, FIVE, EIGHT, TWELVE, FISHEYE = OPENCV
TANGENTS = np.stack(
    np.meshgrid(np.linspace(-0.6, 0.6, 30), np.linspace(-0.45, 0.45, 22)), -1
).reshape(-1, 2)


@pytest.mark.parametrize(
    ("lens", "written_out"), [(FIVE, distorted), (EIGHT, distorted), (FISHEYE, fisheye)]
)
def test_a_lens_comes_back_from_its_own_picture(lens: ExportLens, written_out: object) -> None:
    """Made by formulas of the test's own; found in pixels, as a rational lens's coefficients are
    not unique.
    """
    assert callable(written_out)
    coefficients = [-0.21, 0.11, 0.003, -0.002, 0.01, 0.05, 0.02, -0.01][: lens.coefficients]
    pixels = written_out(TANGENTS, coefficients) * [900, 910] + [640, 480]
    fitted = fit_export_lens(TANGENTS, pixels, [800.0, 800.0, 600.0, 500.0], lens)
    assert np.abs(project_slopes(fitted, TANGENTS, lens.fisheye)[0] - pixels).max() < 0.01


@pytest.mark.parametrize("lens", [FOUR, TWELVE, FISHEYE])
def test_derivatives_are_central_differences(lens: ExportLens) -> None:
    parameters = np.append(
        [900.0, 910.0, 640.0, 480.0], np.linspace(-0.05, 0.05, lens.coefficients)
    )
    exact = project_slopes(parameters, TANGENTS, lens.fisheye)[1]
    for i, size in enumerate([1.0] * 4 + [1e-4] * lens.coefficients):
        step = np.zeros(len(parameters))
        step[i] = size
        forward = project_slopes(parameters + step, TANGENTS, lens.fisheye)[0]
        backward = project_slopes(parameters - step, TANGENTS, lens.fisheye)[0]
        assert (
            np.abs((forward - backward).ravel() / (2 * size) - exact[:, i]).max()
            < 1e-5 * np.abs(exact[:, i]).max()
        )


def test_without_a_cover_the_lens_is_the_calibration_s_own(bare: Calibration) -> None:
    model = best_central(bare, 1.0, OPENCV)
    assert model.lens == FIVE, (
        "four coefficients are not enough for this lens, and more than five not worth having"
    )
    assert model.distortion == tuple(number.value for number in LENS.distortion)
    assert model.centre == (0, 0, 0)
    assert (
        max(
            misfit.worst_px
            for misfit in (
                model.misfit_at_half_depth,
                model.misfit_at_depth,
                model.misfit_at_double_depth,
            )
        )
        < 1e-6
    )
    assert list(model.remarks()) == []


def test_a_lens_is_fitted_on_one_thread(
    covered: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two threads of BLAS took 6 to 10 s beside busy processes, and one thread takes 1 s."""
    seen_threads: list[int] = []

    def watched(*arguments: object) -> np.ndarray:
        seen_threads.extend(
            pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"
        )
        seen_threads.append(torch.get_num_threads())
        return fit_export_lens(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(central, "fit_export_lens", watched)
    with threadpool_limits(2, user_api="blas"):
        best_central(covered, 1.0, (FOUR,))
    assert len(seen_threads) >= 2
    assert set(seen_threads) == {1}


def test_the_rays_nearly_intersect_where_the_model_stands(covered: Calibration) -> None:
    """Any other point makes half and double depth worse, by far in z; at its own depth a model
    hardly cares.
    """
    sight = SampledRays.sample(covered, FIT_GRID)
    best = sight.nearly_intersect()

    def passing(point: np.ndarray) -> float:
        """m RMS between the rays and the point, in its plane z = const."""
        return float(
            np.sqrt(((sight.foot + sight.tangent * point[2] - point[:2]) ** 2).sum(-1).mean())
        )

    assert 3e-4 < best[2] < 2e-3, (
        "glass of 3 mm brings the apparent pinhole nearer by about a third of that"
    )
    for axis in range(3):
        for step in (-1e-5, 1e-5):
            assert passing(best + step * np.eye(3)[axis]) > passing(best)
    assert passing(best) < 0.5 * passing(np.zeros(3))


def test_more_coefficients_are_used_only_if_they_reduce_the_misfit(covered: Calibration) -> None:
    models = {lens.name: best_central(covered, 0.5, [lens]) for lens in OPENCV}
    errors = [models[name].misfit_at_depth.rms_px for name in ("4", "5", "8", "12")]
    assert all(extra < smaller / 0.98 for smaller, extra in pairwise(errors))
    smallest = min(model.misfit_at_depth.rms_px for model in models.values())
    chosen = best_central(covered, 0.5, OPENCV)
    assert chosen.misfit_at_depth.rms_px <= smallest / 0.98
    assert all(
        models[lens.name].misfit_at_depth.rms_px > smallest / 0.98
        for lens in OPENCV[: OPENCV.index(chosen.lens)]
    )


@pytest.mark.parametrize(
    "lens", [lens for form in FORMATS for lens in form.lenses], ids=lambda lens: lens.name
)
def test_every_lens_has_its_stated_number_of_coefficients(
    covered: Calibration, lens: ExportLens
) -> None:
    model = best_central(covered, 0.5, [lens])
    assert len(model.distortion) == model.lens.coefficients
    assert model.lens.name.startswith(lens.name)


def test_a_spline_follows_uneven_glass_at_its_depth_where_no_polynomial_does(
    covered: Calibration,
) -> None:
    """Away from its depth it is wrong by what no central model can follow: least with the rays'
    nearest point as centre.
    """
    spline = best_central(covered, 1.0, [SPLINED])
    polynomial = best_central(covered, 1.0, [TWELVE])
    assert spline.misfit_at_depth.rms_px < 0.002 < 0.2 < polynomial.misfit_at_depth.rms_px
    assert (
        spline.misfit_at_depth.rms_px
        < spline.misfit_at_double_depth.rms_px
        < spline.misfit_at_half_depth.rms_px
    )


def test_a_spline_is_the_formula_of_its_knots() -> None:
    """One control point moved: a cubic B-spline's weights, (1/6, 4/6, 1/6), at its knot and the two
    beside it.
    """
    lens = ExportLens("", 0, knots=(9, 7, 0.1))
    parameters = np.zeros(4 + 9 * 7 * 2)
    parameters[:4] = 1000, 1000, 0, 0
    unmoved = parameters.copy()
    parameters[4 + 2 * (3 * 9 + 4)] = 0.06  # x of the middle one
    u = np.column_stack([[-0.2, -0.1, 0, 0.1, 0.2], np.zeros(5)])
    tangents = u / (1 - (u**2).sum(-1, keepdims=True) / 4)  # of u = 2 tan(angle / 2)
    moved = project_spline(lens, parameters, tangents) - project_spline(lens, unmoved, tangents)
    assert np.abs(project_spline(lens, unmoved, tangents) - 1000 * u).max() < 1e-9
    assert np.abs(moved[:, 0] - 60 * np.array([0, 1, 4, 1, 0]) / 6 * 4 / 6).max() < 1e-9
    assert not moved[:, 1].any()


def test_remarks_name_the_depth_where_the_model_goes_wrong(covered: Calibration) -> None:
    """The test computes the difference between the errors at the depth and at half the depth from
    its own pixels.
    """
    model = best_central(covered, 0.2, [SPLINED])
    assert model.misfit_at_depth.worst_px < 0.1
    pixels, points = seen(covered, 0.1)
    tangents = (points - model.centre)[:, :2] / (points - model.centre)[:, 2:]
    parameters = np.array([*model.focal, *model.principal, *model.distortion])
    worst = np.linalg.norm(project_spline(model.lens, parameters, tangents) - pixels, axis=-1).max()
    assert worst == pytest.approx(model.misfit_at_half_depth.drift_px, rel=0.1)
    assert worst > 0.5
    (remark,) = model.remarks()
    drift = model.misfit_at_half_depth.drift_px
    assert f"At 0.1 m its error changes by up to {drift:.2f} px" in remark


def test_no_remark_is_made_if_depth_hardly_matters(covered: Calibration) -> None:
    model = best_central(covered, 20.0, [SPLINED])
    assert max(model.misfit_at_half_depth.drift_px, model.misfit_at_double_depth.drift_px) < 0.5
    assert list(model.remarks()) == []


def test_infinity_is_no_distance_to_fit_a_central_camera_at(covered: Calibration) -> None:
    """The misfits at half and at twice infinity would be those of infinity itself."""
    with pytest.raises(InputError, match="at a finite distance: write metres, such as 1000"):
        best_central(covered, float("inf"), [FIVE])


def test_a_depth_within_the_cover_is_refused(covered: Calibration) -> None:
    with pytest.raises(InputError, match=r"depth 0\.02 m is too near: write 0\.0\d+ or more"):
        best_central(covered, 0.02, [FIVE])
