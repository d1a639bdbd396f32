"""A new export format is one file and one line, as docs/architecture.md has them: pasted into a
copy of the project, they work.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

from calib.calibration import Calibration

ROOT = Path(__file__).parents[2]


def test_the_steps_for_a_new_format_work_as_written(covered: Calibration, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    code, line = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    shutil.copytree(
        ROOT / "calib", tmp_path / "calib", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "calib" / "export" / "plain.py").write_text(code, encoding="utf-8")
    formats = tmp_path / "calib" / "export" / "formats.py"
    listed = re.sub(
        r'(    Format\("colmap".*\n)', rf"\1{line}", formats.read_text(encoding="utf-8")
    )
    formats.write_text(listed, encoding="utf-8")
    covered.save(tmp_path / "out")
    output = _calib(tmp_path, "export", "--help")
    assert re.search(r"^  plain +a text of three lines$", output, re.MULTILINE)
    _calib(tmp_path, "export", "out", "--format", "plain", "--depth", "0.5", "-o", "exported")
    rows = [
        row
        for row in (tmp_path / "exported" / "camera_0.5m.txt").read_text().splitlines()
        if not row.startswith("#")
    ]
    assert [row.split()[0] for row in rows] == ["focal", "principal", "brown"]
    assert [len(row.split()) for row in rows] == [3, 3, 6]
    assert covered.camera.intrinsics
    assert (
        abs(float(rows[0].split()[1]) / covered.camera.intrinsics.fx.value - 1) < 0.1
    )  # a cover is no strong lens


def _calib(folder: Path, *words: str) -> str:
    environment = {"PYTHONPATH": str(folder), "COLUMNS": "200"}
    done = subprocess.run(
        [sys.executable, "-m", "calib", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
