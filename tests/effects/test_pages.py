"""The pages of docs/effects: there is one for each effect, and the steps for a new one work as they
are written.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from calib.effects.effect import Effect
from calib.effects.registry import KINDS
from calib.rig.rig_effects import RIG_EFFECTS, RigEffect

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "effects"
ALL: tuple[type[Effect] | RigEffect, ...] = (*KINDS, *RIG_EFFECTS)
LARGEST = 40_000
"""bytes, of a picture"""

FINDS_IT = """
import cv2, numpy as np
from calib.calibration import Calibration
from calib.diagnosis.diagnose import diagnose
from calib.progress import Silent
from calib.corners.view import View
from tests.effects.rays import camera_matrix
from fixtures.known import lens_alone
from fixtures.synthetic import scene
from dataclasses import replace

made = scene(0, views=15)
rng = np.random.default_rng(1)
points = made.board.points()
solid = np.column_stack([points, 0.015 * np.abs(points[:, 0])])
poses = made.poses.numpy()
views = []
for index, pose in enumerate(poses):
    pixels = cv2.projectPoints(solid, pose[:3], pose[3:], camera_matrix(), np.zeros(4))[0].reshape(-1, 2)
    views.append(View(f"{index}.png", pixels + rng.normal(0, 0.1, pixels.shape), np.ones(len(points))))
matrix = camera_matrix()
known = lens_alone(made, 3280, 2464, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
_, finding = diagnose(replace(known, views=tuple(views), poses=poses), Silent())
print(finding.accepted, [c.parameters["board_fold.angle"].value for c in finding.candidates if c.accepted])
"""  # noqa: E501
"""A board that OpenCV shows folded by 0.03 rad; prints what is found."""


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.name)
def test_every_effect_has_its_page_and_its_advice(kind: type[Effect] | RigEffect) -> None:
    page = (PAGES / f"{kind.name}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# `{kind.name}`\n")
    assert f"]({kind.name}.png)" in page
    assert (PAGES / f"{kind.name}.png").stat().st_size <= LARGEST
    assert kind.advice[1:] in page.replace("\n", " ")
    assert f"({kind.name}.md)" in (PAGES / "README.md").read_text(encoding="utf-8")


def test_there_are_no_pages_of_effects_that_do_not_exist() -> None:
    assert {page.stem for page in PAGES.iterdir()} == {"README", *(kind.name for kind in ALL)}


@pytest.mark.slow
def test_the_steps_for_a_new_effect_work_as_written(tmp_path: Path) -> None:
    """One file and one line, pasted from the page into a copy of the project: the laws hold, and a
    diagnosis finds it.
    """
    steps = (PAGES / "README.md").read_text(encoding="utf-8")
    code, line = re.findall(r"```python\n(.*?)```", steps, re.DOTALL)
    place, kind = (
        re.search(r"\*\*One file\*\*, `(.*?)`", steps),
        re.search(r"class (\w+)\(Effect\)", code),
    )
    assert place
    assert kind
    for folder in ("calib", "tests", "fixtures"):
        left_out = shutil.ignore_patterns("device", "tui", "frames", "holdout", "bare")
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=left_out)
    (tmp_path / place[1]).write_text(code, encoding="utf-8")
    registry = tmp_path / "calib" / "effects" / "registry.py"
    module = place[1].removesuffix(".py").replace("/", ".")
    listed = re.sub(r"(    BoardScale,\n)", rf"\1{line}", registry.read_text(encoding="utf-8"))
    registry.write_text(f"from {module} import {kind[1]}\n{listed}", encoding="utf-8")

    laws = _run(
        tmp_path,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "tests/effects/test_laws.py",
        "-k",
        "board_fold",
    )
    assert re.search(r"\n\d\d passed", laws), laws
    outcome = _run(tmp_path, "-c", FINDS_IT)
    accepted = re.match(r"\('board_fold',\) \[(.*)\]", outcome)
    assert accepted, outcome
    assert float(accepted[1]) == pytest.approx(0.03, rel=0.1)


def _run(folder: Path, *words: str) -> str:
    """Return the output of Python in the copy."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
