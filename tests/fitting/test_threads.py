"""The same views give the same numbers, however many threads there are."""

import cv2
import pytest

from calib.intrinsics.calibrate import calibrate_bare
from calib.progress import Silent
from fixtures.degenerate import bare_session


@pytest.mark.slow
def test_a_poorly_determined_lens_is_the_same_in_every_run() -> None:
    """Steps that differ by what is rounded end at other focal lengths: threads of
    cv2.calibrateCamera add up as they come.
    """
    shown = bare_session("line", 5021)
    thread_count = cv2.getNumThreads()
    cv2.setNumThreads(4)
    try:
        results = {
            calibrate_bare(shown.views, shown.board, shown.camera, Silent()).intrinsics.fx.value
            for _ in range(4)
        }
        assert cv2.getNumThreads() == 4
    finally:
        cv2.setNumThreads(thread_count)
    assert len(results) == 1
