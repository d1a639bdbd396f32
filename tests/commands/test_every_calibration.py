"""Every command takes every kind of calibration that another command writes, or says in one
sentence why not.
"""

from pathlib import Path

import pytest

from calib.cli import main
from fixtures.rays import FIXTURES

SESSION = FIXTURES / "wet-dome"
POOL = SESSION / "water"
FORMATS = (
    *("npz", "opencv", "opencv-xml", "ros", "kalibr", "colmap", "mrcal"),
    *("windshield", "depthai", "generic", "calibmar", "ray-image", "stmap"),
    *("nerfstudio", "photonvision", "mitsuba", "blender", "gsplat"),
)
KINDS = (
    "fitted",
    "paper",
    "flexing",
    "immersed",
    "immersed and updated",
    "immersed flexing and updated",
    "updated",
    "back in air",
)
ALLOWED = {0, 2, 3, 5}
"""Done; wrong input; not enough good data; a calibration that is not valid any more. 1 is a bug."""


def pictures(session: Path) -> list[str]:
    return sorted(str(path) for path in (session / "frames").glob("*.jpg"))[:3]


@pytest.fixture(scope="module")
def calibrations(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return one calibration of each kind, as the commands write them."""
    folder = tmp_path_factory.mktemp("calibrations")
    places = {kind: folder / kind.replace(" ", "-") for kind in KINDS}
    fitted = str(places["fitted"])
    wet = str(places["immersed"])
    pool = str(places["immersed and updated"])
    for command in (
        ["fit", str(SESSION), "-o", fitted],
        ["fit", str(SESSION), "--method", "paper", "-o", str(places["paper"])],
        ["fit", str(SESSION), "--effects", "board_flex", "-o", str(places["flexing"])],
        ["immerse", fitted, "--outside-index", "1.34", "-o", wet],
        ["check", wet, *pictures(POOL), "--update", "-o", pool],
        ["check", fitted, *pictures(SESSION), "--update", "-o", str(places["updated"])],
        ["immerse", wet, "--outside-index", "1", "-o", str(places["back in air"])],
        [
            "immerse",
            str(places["flexing"]),
            "--outside-index",
            "1.34",
            "-o",
            str(folder / "wet-flexing"),
        ],
        [
            "check",
            str(folder / "wet-flexing"),
            *pictures(POOL),
            "--update",
            "-o",
            str(places["immersed flexing and updated"]),
        ],
    ):
        assert main(command) == 0, command
    return places


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_command_accepts_the_calibration(
    calibrations: dict[str, Path], kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    estimate, session = str(calibrations[kind]), POOL if kind.startswith("immersed") else SESSION
    for number, command in enumerate(
        (
            ["report", "--no-open", estimate],
            ["evaluate", estimate, str(session)],
            ["diagnose", estimate],
            ["check", estimate, *pictures(session)],
            ["check", estimate, str(session), "--json"],
            ["check", estimate, *pictures(session), "--update"],
            ["immerse", estimate, "--outside-index", "1.33"],
            ["undistort", estimate, pictures(session)[0], "--depth", "0.5"],
            ["pose", estimate, pictures(session)[0], "--tags", "tag36h11", "--size-mm", "20"],
            *(["export", estimate, "--format", form, "--depth", "0.5"] for form in FORMATS),
        )
    ):
        writes = (
            command[0] not in ("report", "evaluate")
            and "--json" not in command
            and (command[0] != "check" or "--update" in command)
        )
        words = [*command, "-o", str(tmp_path / str(number))] if writes else command
        try:
            code = main(words)
        except SystemExit as stopped:  # argparse
            code = int(stopped.code or 0)
        errors = capsys.readouterr().err
        assert code in ALLOWED, (words, errors)
        assert code == 0 or "calib: error: " in errors or "check" in words, (words, errors)
