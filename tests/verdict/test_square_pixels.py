"""Pixels that are not square are a reason: a print that is stretched makes them, a true one does
not.
"""

from pathlib import Path

import numpy as np
import pytest

from calib.corners.view import View
from calib.fitting.fit import fit
from calib.session.parameter_names import CAMERA
from calib.verdict.square_pixels import square_pixels
from calib.verdict.verdict import Trust
from tests.fitting.test_board_bend import BOARD, SIZE, pictures, session
from tests.verdict.cases import asked


def stretched(view: View, factor: float) -> View:
    """Return the view of a sensor whose pixels are wider than high."""
    corners = (view.corners - np.array(SIZE) / 2) * [factor, 1] + np.array(SIZE) / 2
    return View(view.name, corners, view.weight)


def test_a_stretched_picture_is_a_reason(tmp_path: Path) -> None:
    views = tuple(stretched(view, 0.99) for view in pictures(BOARD, (0, 0, 0)))
    (reason,) = asked(square_pixels, fit(session(tmp_path / "fit", BOARD, views)))
    assert (reason.word, reason.suspects) == (Trust.CARE, CAMERA.focal)
    assert "fx and fy differ by 1.0 %" in reason.sentence
    advice = "the camera looks through a cover (try cover: {shape: unknown} in session.yaml)"
    assert advice in reason.sentence


@pytest.mark.slow
def test_square_pixels_are_none(tmp_path: Path) -> None:
    for seed in range(3):
        made = session(tmp_path / f"{seed}", BOARD, pictures(BOARD, (0, 0, 0), seed=seed))
        assert not asked(square_pixels, fit(made))
