"""`calib fit PICTURES` on rendered photographs of which somebody does not know the cover, or its
numbers.
"""

import shutil
from pathlib import Path

import pytest

from calib.calibration import Calibration
from calib.cli import main
from calib.fitting.declared import comparisons
from calib.session.schema import Number


def photographs(fixture: str, folder: Path) -> Path:
    """Return a folder with the pictures of a fixture, without its session.yaml."""
    frames = Path(__file__).parents[2] / "fixtures" / fixture / "frames"
    return Path(shutil.copytree(frames, folder / "photos"))


@pytest.mark.slow
def test_a_shape_whose_fit_is_stuck_is_not_chosen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eight pictures through a dome under water, of which nothing is known, show no cover."""
    photos = photographs("wet-dome/water", tmp_path)
    words = ["--board", "9x9", "--square-mm", "20", "--cover", "unknown"]
    assert main(["fit", str(photos), *words, "--outside-index", "1.333"]) == 0
    assert Calibration.load(photos / "calibration").cover.shape == "none"
    assert "do not show a cover: a dome explains them as well" in " ".join(
        capsys.readouterr().out.split()
    )


def focal_length(folder: Path) -> Number:
    intrinsics = Calibration.load(folder).camera.intrinsics
    assert intrinsics
    return intrinsics.fx


@pytest.mark.slow
def test_the_same_ignorance_gives_about_the_same_sigma(tmp_path: Path) -> None:
    """Where the dome is, these pictures hardly tell: unknown, it has a wide prior of 30 mm, as if
    that was declared. By the covariance at the optimum, the two sigmas of fx differ by 13 times. A
    diagnosis that finds nothing changes neither.
    """
    sigmas = []
    for name, centre in (("unknown", []), ("declared", ["--centre", "0+-30,0+-30,0+-30"])):
        photos = photographs("rig-dome/middle", tmp_path / name)
        words = ["--board", "9x9", "--square-mm", "20", "--cover", "dome", "--radius", "50+-3"]
        words += ["--thickness", "4", "--index", "1.49", *centre]
        assert main(["fit", str(photos), *words]) == 0
        fx = focal_length(photos / "calibration")
        assert abs(fx.value - 639.59) < 2.5 * fx.sigma
        sigmas.append(fx.sigma)
    assert max(sigmas) < 4 * min(sigmas)
    given = tmp_path / "unknown" / "photos" / "calibration"
    assert main(["diagnose", str(given)]) == 0
    diagnosed = Calibration.load(given / "diagnosed")
    assert not diagnosed.effects
    assert focal_length(given / "diagnosed") == focal_length(given)


@pytest.mark.slow
def test_sigma_is_for_every_shape_that_fits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A dome around a lens that nobody knows looks like no cover: without one, fx is off by 2.6 px,
    which is 38 of that fit's sigmas.
    """
    photos = photographs("rig-dome/middle", tmp_path)
    words = ["--board", "9x9", "--square-mm", "20", "--cover", "unknown"]
    assert main(["fit", str(photos), *words]) == 0
    calibration = Calibration.load(photos / "calibration")
    assert {"none", "dome"} <= {*calibration.outcome.probable_shapes}
    fx = next(n for n in comparisons(calibration) if n.name == "camera.fx")
    assert fx.alternatives
    assert abs(fx.estimate - 639.59) < 2.5 * fx.sigma
    assert fx.sigma < 10
    printed = " ".join(capsys.readouterr().out.split())
    assert "no cover or a flat window or a dome" in printed
    assert "With another the maps change by up to 0." in printed


@pytest.mark.slow
def test_bumps_do_not_pull_a_cone_to_its_apex(tmp_path: Path) -> None:
    """A lens, a slope and a place that nobody knows: even glass imitates the bumps of the real one
    by a cone whose radius is zero.
    """
    photos = photographs("bumps", tmp_path)
    words = ["--board", "9x9", "--square-mm", "20", "--cover", "cone", "--radius", "42"]
    assert main(["fit", str(photos), *words, "--thickness", "3"]) == 0
    cover = Calibration.load(photos / "calibration").cover
    radius = cover.parameters["inner_radius"]
    assert abs(radius.value - 0.04195) < 2.5 * radius.sigma
