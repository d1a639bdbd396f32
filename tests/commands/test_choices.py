"""The choices of a fit on the command line: --free, --grid auto, --folds, --effects; and `calib
diagnose`.
"""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.cli import main
from fixtures.synthetic import scene
from tests.diagnosis.hide import hidden
from tests.diagnosis.test_diagnose import BOW, TRUTH
from tests.test_calibration import write_session

pytestmark = pytest.mark.usefixtures("without_figures")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve views through the paper's glass, as corners."""
    return write_session(tmp_path_factory.mktemp("choices"), scene(8, views=12, noise=0.05))


def fit(session: Path, out: Path, *options: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["fit", str(session), "-o", str(out), "--grid", "5x4", *options]) == 0
    return capsys.readouterr().out


def estimated(printed: str) -> list[str]:
    """Return the numbers with a sigma and a tolerance in the table of what was calibrated."""
    return re.findall(r"^  (\S+) +\S+ ± \S+.*  \S+ ± \S+", printed, re.MULTILINE)


def test_free_estimates_numbers_near_what_the_session_states(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = fit(session, tmp_path / "out", "--free", "thickness,intrinsics", capsys=capsys)
    assert estimated(printed) == [
        "camera.fx",
        "camera.fy",
        "camera.cx",
        "camera.cy",
        "cover.thickness",
    ]
    assert "\ncamera alone: the lens as given or as first estimated, with no" in printed
    assert "\nfitted cover: lens and cover as fitted, with uneven glass if" in printed


@pytest.mark.slow
def test_free_all_estimates_every_number_that_is_not_exact(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The cone has nine numbers and the camera four; only the index outside has no tolerance."""
    copy = shutil.copytree(session, tmp_path / "s")
    all_estimated = estimated(fit(copy, tmp_path / "out", "--free", "all", capsys=capsys))
    assert len(all_estimated) == 12
    described = (copy / "session.yaml").read_text()
    exact = re.sub(r"thickness_mm: (.*)", r"thickness_mm: {value: \1, exact: true}", described)
    exact = re.sub(r"inner_radius_mm: (.*)", r"inner_radius_mm: {value: \1, sigma: 0}", exact)
    (copy / "session.yaml").write_text(exact)
    not_exact = estimated(fit(copy, tmp_path / "out", "--free", "all", capsys=capsys))
    assert set(all_estimated) - set(not_exact) == {"cover.thickness", "cover.inner_radius"}
    calibration = Calibration.load(tmp_path / "out")
    assert (
        calibration.cover.parameters["thickness"]
        == calibration.declared.cover.parameters["thickness"]
    )
    assert calibration.cover.parameters["thickness"].exact
    assert "cover.thickness" in estimated(
        fit(copy, tmp_path / "out", "--free", "all,thickness", capsys=capsys)
    )


@pytest.mark.slow
def test_a_wrong_number_is_corrected_and_contradicted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three millimetres of glass, declared as 1 mm give or take 0.2: the views say otherwise, and
    so does the fit.
    """
    copy = write_session(tmp_path / "s", scene(8, views=24, noise=0.02, depths=(0.3, 1.0)))
    described = (copy / "session.yaml").read_text()
    (copy / "session.yaml").write_text(
        re.sub(r"thickness_mm: .*", "thickness_mm: {value: 1.0, sigma: 0.2}", described)
    )
    printed = fit(copy, tmp_path / "out", capsys=capsys)
    value, sigma = re.findall(
        r"cover.thickness +([\d.]+) ± ([\d.]+) mm +1.00 ± 0.20 mm +contradicted", printed
    )[0]
    assert float(value) - 1 > 3 * float(sigma)
    assert "standard deviations apart: measure it again, and correct session.yaml." in " ".join(
        printed.split()
    )
    calibration = Calibration.load(tmp_path / "out")
    assert calibration.declared.cover.parameters["thickness"].value == pytest.approx(1e-3)
    assert calibration.cover.parameters["thickness"].value == pytest.approx(
        float(value) * 1e-3, abs=0.1e-3 * float(sigma)
    )  # to the second digit of sigma


@pytest.mark.slow
def test_folds_are_printed_and_in_the_json(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = json.loads(fit(session, tmp_path / "out", "--folds", "3", "--json", capsys=capsys))
    assert set(answer["cross_validation"]) == {
        "folds",
        "held_out_px",
        "held_out_sigma_px",
        "fitted_px",
    }
    assert answer["cross_validation"]["folds"] == 3
    fitted = answer["cross_validation"]["fitted_px"] / (0.05 * 2**0.5)
    held_out = answer["cross_validation"]["held_out_px"] / (0.05 * 2**0.5)
    assert (
        0.95 < fitted < 1.03 < held_out < 1.1
    )  # of the noise: 0.99 and 1.05; of 1944 coordinates, chance is 0.016


@pytest.mark.slow
def test_grid_auto_keeps_the_coarsest_grid_that_no_finer_one_beats(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["fit", str(session), "-o", str(tmp_path / "out"), "--grid", "auto", "--free", "none"])
        == 0
    )
    capsys.readouterr()
    calibration = Calibration.load(tmp_path / "out")
    tried = calibration.outcome.grid_held_out_px
    assert tried
    assert next(iter(tried)) == "6x6"
    assert len(tried) >= 2
    settings = calibration.request.settings
    assert settings
    assert settings.grid
    chosen = "x".join(map(str, settings.grid))
    assert all(tried[chosen] < error / 0.99 for error in tried.values())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--free", "colour"], "colour"),
        (["--free", "all,none"], "write none alone"),
        (["--free", "centre"], "has no centre"),
        (["--folds", "1"], "1"),
        (["--grid", "7"], "such as 8x8, or auto"),
        (["--effects", "ghost"], "ghost"),
        (["--effects", "board_shape,board_shape"], "each once"),
        (["--effects", "flat_port"], "flat_port"),
    ],
)
def test_a_wrong_choice_gets_a_sentence(
    session: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    words: str,
) -> None:
    try:
        code = main(["fit", str(session), "-o", str(tmp_path / "out"), "--grid", "5x4", *options])
    except SystemExit as stop:  # argparse's own way
        code = int(stop.code or 0)
    assert code == 2
    errors = capsys.readouterr().err
    assert words in errors
    assert "Traceback" not in errors


def test_an_effect_that_cannot_be_is_refused_before_the_fit(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Even its corners are not read, which would be refused."""
    copy = shutil.copytree(session, tmp_path / "s")
    (copy / "corners.vnl").write_text("nothing of this is read\n")
    assert main(["fit", str(copy), "--effects", "board_shape,flat_port"]) == 2
    errors = capsys.readouterr().err
    assert (
        errors
        == "calib: error: --effects flat_port: with cover.shape: cone there can be no flat_port:"
        " leave it out.\n"
    )
    assert not (copy / "calibration").exists()
    assert main(["fit", str(copy), "--effects", "board_shape"]) == 2
    assert "corners.vnl" in capsys.readouterr().err


@pytest.mark.slow
def test_effects_auto_and_diagnose_say_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_session(tmp_path, hidden(BOW, TRUTH, views=12))
    assert (
        main(
            [
                "fit",
                str(folder),
                "--grid",
                "8x8",
                "-o",
                str(tmp_path / "auto"),
                "--effects",
                "auto",
                "--json",
            ]
        )
        == 0
    )
    answer = json.loads(capsys.readouterr().out)
    assert answer["effects"] == ["board_shape"]
    assert answer["stages"][-1]["name"] == "cover+rbf+effects"
    assert main(["fit", str(folder), "--grid", "8x8", "-o", str(tmp_path / "plain")]) == 0
    assert (
        main(["diagnose", str(tmp_path / "plain"), "-o", str(tmp_path / "better"), "--json"]) == 0
    )
    capsys.readouterr()
    with (
        np.load(tmp_path / "better" / "calibration.npz") as ours,
        np.load(tmp_path / "auto" / "calibration.npz") as theirs,
    ):
        assert np.allclose(ours["amplitudes"], theirs["amplitudes"], atol=1e-7)
    assert main(["diagnose", str(tmp_path / "plain"), "-o", str(tmp_path / "better")]) == 0
    printed = capsys.readouterr().out
    assert "Found: board_shape" in printed
    assert "Wrote" in printed


@pytest.mark.slow
def test_effects_by_name_are_added_and_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_session(tmp_path, hidden(BOW, TRUTH, views=6))
    assert (
        main(
            [
                "fit",
                str(folder),
                "--grid",
                "4x4",
                "-o",
                str(tmp_path / "named"),
                "--effects",
                "board_shape",
            ]
        )
        == 0
    )
    printed = capsys.readouterr().out
    message = re.findall(r"board_shape\.(?:xx|xy|yy) +(-?[\d.]+) ± ([\d.]+) mm", printed)
    assert len(message) == 3
    for (value, sigma), true in zip(message, TRUTH.values(), strict=True):
        assert (
            abs(float(value) - 1e3 * true) < 4 * float(sigma) + 0.1
        )  # mm; a relief of 4x4 does not follow this glass


@pytest.mark.slow
def test_diagnose_shows_the_figure_of_evaluate_under_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The fit has the board's bend, which a diagnosis takes out before it begins, so that the error
    without effects is another one.
    """
    folder = write_session(tmp_path / "s", hidden(BOW, TRUTH, views=6))
    other = write_session(tmp_path / "other", hidden(BOW, TRUTH, views=5, seed=3))
    out = tmp_path / "out"
    fit(folder, out, capsys=capsys)
    assert main(["evaluate", str(out), str(other), "--json"]) == 0
    evaluated = json.loads(capsys.readouterr().out)
    command = ["diagnose", str(out), "--holdout", str(other), "-o", str(tmp_path / "better")]
    assert main([*command, "--json"]) == 0
    diagnosed = json.loads(capsys.readouterr().out)
    assert diagnosed["given"]["held_out_px"] == evaluated["rms_px"]
    assert diagnosed["calibration"] == str(tmp_path / "better" / "calibration.yaml")
    assert evaluated["calibration"] == str(out / "calibration.yaml")
    assert set(diagnosed["camera"]) == set(evaluated["camera"])


def test_unknown_numbers_are_said_in_the_table_the_json_and_the_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = write_session(tmp_path, scene(8, views=12, noise=0.05, amplitude=0.0))
    file = copy / "session.yaml"
    document = yaml.safe_load(file.read_text())
    document["cover"]["inner_radius_mm"] = "unknown"
    del document["cover"]["thickness_mm"]
    file.write_text(yaml.safe_dump(document))
    printed = fit(copy, tmp_path / "out", "--effects", "none", capsys=capsys)
    for name in ("cover.inner_radius", "cover.thickness"):
        assert re.search(rf"^  {name} +\S+ ± \S+ mm +unknown", printed, re.MULTILINE), printed
    written = yaml.safe_load((tmp_path / "out" / "calibration.yaml").read_text())
    assert written["declared"]["cover"]["inner_radius_mm"] == "unknown"
    assert written["declared"]["cover"]["thickness_mm"] == "unknown"
    calibration = Calibration.load(tmp_path / "out")
    assert calibration.declared.cover.parameters["inner_radius"].unknown
    for name, true in (("inner_radius", 0.04195), ("thickness", 0.003)):
        number = calibration.cover.parameters[name]
        assert abs(number.value - true) < 2.5 * number.sigma
