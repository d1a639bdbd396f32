"""Held-out quality through the command and its pieces."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from calib.cli import main
from calib.commands.console import print_evaluation
from calib.fitting.evaluate import Evaluation
from fixtures.synthetic import HEIGHT, WIDTH, scene
from tests.test_calibration import write_session


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_session(tmp_path_factory.mktemp("evaluate"), scene(12, views=12, noise=0.1))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.report.write.DRAWINGS", ())  # no test here looks at the report
        assert main(["fit", str(folder), "--grid", "6x6", "--free", "none", "--json"]) == 0
    return folder


def test_json_keeps_the_contract(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held_out_session = write_session(tmp_path, scene(12, views=6, noise=0.1, depths=(0.45, 1.2)))
    capsys.readouterr()
    assert main(["evaluate", str(fitted / "calibration"), str(held_out_session), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert list(answer) == [
        "rms_px",
        "rmse_cm",
        "frames_used",
        "by_depth",
        "near_m",
        "far_m",
        "bad_views",
        "other_views_rms_px",
        "fitted_views",
        "camera",
        "cover",
        "board",
        "calibration",
        "verdict",
        "written",
    ]
    assert (
        answer["by_depth"][0]["from_m"]
        <= answer["near_m"]
        < answer["far_m"]
        <= answer["by_depth"][-1]["to_m"]
    )
    assert answer["frames_used"] == 6
    assert answer["fitted_views"] == 0
    assert all(
        set(band) == {"from_m", "to_m", "rms_px", "rmse_cm", "corners"}
        for band in answer["by_depth"]
    )
    assert sum(band["corners"] for band in answer["by_depth"]) == 6 * 81
    assert answer["rms_px"] < 0.17  # noise alone leaves 0.14
    squares = sum(band["corners"] * band["rms_px"] ** 2 for band in answer["by_depth"]) / (6 * 81)
    assert squares**0.5 == pytest.approx(answer["rms_px"], rel=1e-9)


def test_a_bad_view_is_named_and_the_others_judged_by_themselves(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = scene(12, views=6, noise=0.1, depths=(0.45, 1.2))
    view = made.views[3]
    bent = view.corners + [0, 4.0] * (made.board.points()[:, :1] / made.board.half[0]) ** 2
    views = (*made.views[:3], replace(view, corners=bent), *made.views[4:])
    folder = write_session(tmp_path, made, views)
    assert main(["evaluate", str(fitted / "calibration"), str(folder), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    (bad,) = answer["bad_views"]
    assert bad["file"] == view.name
    assert bad["rms_px"] > 5 * answer["other_views_rms_px"]
    assert answer["other_views_rms_px"] < 0.17 < answer["rms_px"]
    assert f"{view.name} ({bad['rms_px']:.3f} px) does not fit" in answer["verdict"]["reasons"][0]
    assert not any("model lacks" in reason for reason in answer["verdict"]["reasons"])
    assert main(["evaluate", str(fitted / "calibration"), str(folder)]) == 0
    assert f"Does not fit: {view.name}: {bad['rms_px']:.3f} px" in capsys.readouterr().out


def test_the_table_names_every_band(fitted: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(fitted / "calibration"), str(fitted)]) == 0
    out = capsys.readouterr().out
    assert "0.5 to 1 m" in out
    assert "12 views: only the poses of the board were fitted to them." in out
    assert "The error on the fitted views is " in out
    assert "held-out" not in out
    assert "fitted to all of these views, so their error is no test" in " ".join(out.split())


def test_another_camera_mode_is_refused(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held_out_session = write_session(tmp_path, scene(12, views=3))
    text = (
        (held_out_session / "session.yaml")
        .read_text()
        .replace(f"width: {WIDTH}", "width: 1640")
        .replace(f"height: {HEIGHT}", "height: 1232")
    )
    (held_out_session / "session.yaml").write_text(text)
    assert main(["evaluate", str(fitted / "calibration"), str(held_out_session)]) == 2
    assert "evaluate with a session of the calibrated camera mode" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("held_out_px", "fitted_views", "agrees"), [(0.11, 0, True), (0.13, 0, False), (0.11, 5, False)]
)
def test_held_out_views_that_fit_as_well_are_said_to(
    held_out_px: float, fitted_views: int, agrees: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluation = Evaluation(held_out_px, 0.0, 5, (), 0.4, 1.0, (), fitted_views=fitted_views)
    print_evaluation(evaluation, 0.1, wide=False)
    assert (
        "the pictures that were not fitted fit equally well" in capsys.readouterr().out
    ) == agrees
