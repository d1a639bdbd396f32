"""Files of calibrations that are damaged, edited, of an earlier version, or cannot be written."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.calibration_file import _with_all_bend_terms
from calib.errors import InputError, NotEnoughDataError
from calib.fitting.fit import fit
from calib.optics.view_blocks import FLEX, FOCAL, POSE
from calib.progress import Silent
from calib.session.schema import Number
from calib.session.session import read_session
from fixtures.synthetic import scene
from tests.test_calibration import BARE, SHORT, edit_yaml, rewrite_npz, write_session


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    made = scene(7, views=8, amplitude=1e-5, noise=0.05)
    folder = write_session(tmp_path_factory.mktemp("session"), made)
    return fit(read_session(folder), SHORT, Silent())


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (
            lambda folder: (folder / "calibration.npz").unlink(),
            "keep calibration.yaml and calibration.npz in one folder",
        ),
        (lambda folder: (folder / "calibration.npz").write_bytes(b"PK\x03\x04 cut"), "is damaged"),
        (lambda folder: (folder / "calibration.yaml").write_text("format: 7\n"), "format is 7"),
        (
            lambda folder: (folder / "calibration.yaml").write_text("format: 2\n"),
            "is not a whole calibration",
        ),
        (lambda folder: (folder / "calibration.yaml").unlink(), "does not exist"),
    ],
)
def test_a_damaged_calibration_gets_its_sentence(
    calibration: Calibration, tmp_path: Path, spoil: object, says: str
) -> None:
    calibration.save(tmp_path)
    spoil(tmp_path)  # type: ignore[operator]
    with pytest.raises(InputError, match=says):
        Calibration.load(tmp_path)


def test_a_file_in_place_of_a_calibration_gets_its_sentence(
    calibration: Calibration, tmp_path: Path
) -> None:
    camera = tmp_path / "left"
    calibration.save(camera)
    with pytest.raises(InputError, match=r"npz is not a calibration.yaml: give that file, or the"):
        Calibration.load(camera / "calibration.npz")
    (tmp_path / "rig_calibration.yaml").touch()
    with pytest.raises(InputError, match=r"is a rig, .*: name the calibration of .*/left\.$"):
        Calibration.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda message: message["relief"].update(grid=[5, 6]), "amplitudes are float64 of shape"),
        (lambda message: message["relief"].update(grid=["a", 5]), "relief.grid is not two numbers"),
        (
            lambda message: message["relief"].update(grid=[1, 64]),
            "relief.grid is not two whole numbers of 2 or more",
        ),
        (
            lambda message: message["relief"].update(grid=[5.5, 5]),
            "relief.grid is not two whole numbers",
        ),
        (lambda message: message["relief"].update(low=[1]), "relief.low is not two numbers"),
        (lambda message: message["relief"].update(low="ab"), "relief.low is not two numbers"),
        (
            lambda message: message["relief"].update(low=message["relief"]["high"]),
            "relief.low is not below relief.high",
        ),
        (lambda message: message["relief"].update(beta="wide"), "relief.beta is not a number"),
        (
            lambda message: message["settings"].update(made_by=[1]),
            "settings.made_by is not a mapping",
        ),
        (
            lambda message: message["settings"].update(made_by={"session": 5}),
            "settings.made_by.session is not a text",
        ),
        (
            lambda message: message["settings"].update(diagnosis="all"),
            "settings.diagnosis is not a mapping",
        ),
        (
            lambda message: message["settings"].update(
                diagnosis={"candidates": [{"effect": "lens"}]}
            ),
            r"candidates\[0\]\.accepted is missing",
        ),
        (lambda message: message["settings"].update(free="all"), "settings.free is not a list"),
        (lambda message: message["settings"].update(grid={"a": 1}), "settings.grid is not a list"),
        (
            lambda message: message["settings"].update(grid=[True, 5]),
            "settings.grid is not a list of 0",
        ),
        (
            lambda message: message["settings"].update(cross_validation={"folds": 5}),
            "settings.cross_validation.held_out_px is missing",
        ),
        (
            lambda message: message["settings"].update(sigma_px=0),
            "settings.sigma_px is not a number above 0",
        ),
        (
            lambda message: message["settings"].update(
                relief_prior={"height_m": 1e300, "length_of_patch": 1}
            ),
            "height_m is not a number that a fit",
        ),
        (
            lambda message: message.update(
                effects=[{"name": "board_shape", "form": {"degree": "x"}, "parameters": {}}]
            ),
            "form.degree of board_shape",
        ),
        (lambda message: message.update(relief=[]), "is not a whole calibration"),
        (lambda message: message.update(relief=None), "amplitudes are float64 of shape"),
        (lambda message: message["camera"].pop("intrinsics"), "camera.intrinsics is missing"),
        (lambda message: message.update(cover={"shape": "none"}), "there is a relief and no cover"),
        (lambda message: message["board"].update(columns=8), "corners are float64 of shape"),
        (lambda message: message.update(settings=3), "is not a whole calibration"),
        (lambda message: message.update(stages=[3]), "is not a whole calibration"),
        (
            lambda message: message["stages"][0].update(name="x"),
            r"stages\[0\].name is not one of pinhole",
        ),
        (lambda message: message["stages"].reverse(), "stages are not some of pinhole, cover"),
        (lambda message: message["stages"].pop(0), "stages are not some of pinhole, cover"),
        (lambda message: message["stages"].clear(), "stages are missing"),
        (lambda message: message.update(settings={}), "settings.sigma_px is missing"),
        (
            lambda message: message["settings"].pop("relief_prior"),
            "settings.relief_prior is missing",
        ),
        (
            lambda message: message["settings"].update(method="x"),
            "settings.method is not one of joint",
        ),
        (
            lambda message: message["settings"].update(free=["x"]),
            r"settings.free\[0\] is not one of",
        ),
        (
            lambda message: message["settings"].update(steps=-1),
            "settings.steps is not a whole number of",
        ),
        (lambda message: message.update(noise_px="loud"), "is not a whole calibration"),
        (lambda message: message.pop("arrays_sha256"), "arrays_sha256"),
        (
            lambda message: message.update(arrays_sha256="0" * 64),
            "calibration.yaml and calibration.npz do not belong together: fit the session again",
        ),
    ],
)
def test_an_edited_calibration_gets_its_sentence(
    calibration: Calibration, tmp_path: Path, change: Callable[[dict[str, Any]], object], says: str
) -> None:
    calibration.save(tmp_path)
    edit_yaml(tmp_path, change)
    with pytest.raises(InputError, match=says):
        Calibration.load(tmp_path)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"amplitudes": np.zeros((2, 3))}, "amplitudes are float64 of shape"),
        ({"amplitudes": np.zeros((5, 5), np.float32)}, "amplitudes are float32"),
        ({"poses": np.zeros((3, 6))}, "poses are float64 of shape"),
        ({"corners": np.zeros((8, 80, 2))}, "corners are float64 of shape"),
        ({"weights": np.zeros((8, 80))}, "weights are float64 of shape"),
        ({"covariance": np.zeros((2, 3))}, "covariance are float64 of shape"),
        ({"names": np.array("one")}, "is not a whole calibration"),
        ({"names": np.arange(8.0)}, "names are not a text for each view"),
        ({"poses": np.full((8, 6), np.nan)}, "poses are not all numbers"),
        ({"amplitudes": np.full((5, 5), 1e300)}, "amplitudes are not all numbers"),
        ({"amplitudes": np.full((5, 5), 140.0)}, "amplitudes are not those of a glass"),
        ({"weights": np.zeros((8, 81))}, "a view has none"),
        ({"weights": np.full((8, 81), -1.0)}, "corners that were seen"),
        ({"corners": np.full((8, 81, 2), np.inf)}, "are not all somewhere"),
        ({"corners": np.zeros((8, 81, 2))}, "corners lie on one line or point of the picture"),
        ({"weights": np.eye(8, 81)}, "only 1 corners are seen"),
        ({"poses": np.zeros((8, 6))}, "do not lie on a board at its pose"),
        ({"blurs": np.ones((8, 81))}, "blurs are float64 of shape"),
        ({"blurs": np.full((8, 81, 2), np.inf)}, "blurs are not all widths in px"),
        ({"blurs": np.zeros((8, 81, 2))}, "blurs are not all widths in px"),
        ({"times_s": np.full(8, 1e12)}, "times_s are not all times in s"),
        ({"covariance": np.eye(3)}, "covariance is of 3 parameters"),
        ({"covariance": -np.eye(3)}, "covariance is not symmetric"),
        ({"covariance": np.arange(9.0).reshape(3, 3)}, "covariance is not symmetric"),
    ],
)
def test_arrays_of_another_shape_get_their_sentence(
    calibration: Calibration, tmp_path: Path, changed: dict[str, np.ndarray], says: str
) -> None:
    calibration.save(tmp_path)
    rewrite_npz(tmp_path, **changed)
    with pytest.raises(InputError, match=says):
        Calibration.load(tmp_path)


def test_entries_near_zero_may_differ_across_the_diagonal_as_their_sigmas_are_rounded(
    calibration: Calibration, tmp_path: Path
) -> None:
    calibration.save(tmp_path)
    uneven = calibration.covariance.copy()
    uneven[0, 1], uneven[1, 0] = 1e-10 * np.sqrt(uneven[0, 0] * uneven[1, 1]), 0.0
    rewrite_npz(tmp_path, covariance=uneven)
    assert Calibration.load(tmp_path).covariance[0, 1] > 0


def test_a_covariance_may_hold_squares_of_large_numbers(
    calibration: Calibration, tmp_path: Path
) -> None:
    """Coefficients of a rational lens that cancel each other have variances of 1e14 of their scale:
    a dome's session of measured views was refused for one.
    """
    largest = calibration.covariance.diagonal().max()
    wide = 1e14 / largest * calibration.covariance
    replace(calibration, covariance=wide).save(tmp_path)
    assert Calibration.load(tmp_path).covariance.max() == pytest.approx(1e14)
    with pytest.raises(NotEnoughDataError, match="covariance are not all numbers"):
        replace(calibration, covariance=1e11 * wide).save(tmp_path)


def test_a_new_npz_beside_an_old_yaml_is_refused(calibration: Calibration, tmp_path: Path) -> None:
    """A fit that is interrupted between its two files leaves such a pair."""
    calibration.save(tmp_path)
    replace(calibration, poses=calibration.poses + 1e-3).save(tmp_path / "new")
    (tmp_path / "new" / "calibration.npz").replace(tmp_path / "calibration.npz")
    with pytest.raises(InputError, match="do not belong together"):
        Calibration.load(tmp_path)


def test_paths_that_cannot_be_looked_up_get_their_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=r"cannot be read \(File name too long\)"):
        Calibration.load(tmp_path / ("x" * 300))
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(InputError, match=r"does not exist|cannot be read"):
        Calibration.load(tmp_path / "loop")

    def locked(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_dir", locked)
    with pytest.raises(InputError, match=r"cannot be read \(Permission denied\)"):
        Calibration.load(tmp_path)


def test_values_that_could_not_be_read_back_are_not_written(
    calibration: Calibration, tmp_path: Path
) -> None:
    """A sigma that is not a number, and correlations that no numbers have."""
    k = calibration.camera.intrinsics
    assert k
    for spoiled in (
        replace(k, fx=Number(k.fx.value, float("nan"))),
        replace(BARE, correlations=((0.99,), (0.99, -0.99), (0.0, 0.0, 0.0))),
    ):
        with pytest.raises(
            NotEnoughDataError, match=r"no calibration is written.*camera.intrinsics"
        ):
            replace(calibration, camera=replace(calibration.camera, intrinsics=spoiled)).save(
                tmp_path / "out"
            )
        assert not (tmp_path / "out" / "calibration.yaml").exists()
        assert not (tmp_path / "out" / "calibration.npz").exists()


def test_an_array_that_could_not_be_read_back_is_not_written(
    calibration: Calibration, tmp_path: Path
) -> None:
    uneven = calibration.covariance.copy()
    uneven[0, 1] += 0.1 * np.sqrt(uneven[0, 0] * uneven[1, 1])
    with pytest.raises(
        NotEnoughDataError, match=r"no calibration is written.*covariance is not symmetric"
    ):
        replace(calibration, covariance=uneven).save(tmp_path / "out")
    assert not list(tmp_path.glob("out/calibration.*"))


def test_bends_of_views_that_an_earlier_version_wrote_are_read() -> None:
    """They were of degree 2. What stands behind them, such as a focal length, stays there."""
    written = np.arange(20.0).reshape(2, 10)
    read = _with_all_bend_terms(written, {POSE, FLEX, FOCAL})
    np.testing.assert_array_equal(read[:, [*range(9), -1]], written)
    np.testing.assert_array_equal(read[:, 9:-1], np.zeros((2, 9)))
    np.testing.assert_array_equal(_with_all_bend_terms(read, {POSE, FLEX, FOCAL}), read)
