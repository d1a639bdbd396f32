"""A fit of a large board: 10 views of 100x100 corners."""

import json
from pathlib import Path

import pytest

from calib.cli import main
from fixtures.large import write_session


@pytest.mark.slow
def test_a_hundred_thousand_corners_are_fitted_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """More than OpenCV's functions for pictures take at once: they count in 16 bits."""
    corners = write_session(tmp_path, 100_000, 10)
    assert main(["fit", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["corners"] == corners == 100_000
    assert main(["report", str(tmp_path / "calibration")]) == 0
    assert (tmp_path / "calibration" / "report.html").stat().st_size > 100_000
