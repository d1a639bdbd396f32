"""Who may import whom, checked in fresh interpreters: a Pi captures without torch, and calib never needs capture."""

import subprocess
import sys

import pytest

FORBIDDEN = {
    "calib": {"torch", "cv2", "numpy"},
    "calib.cli": {"torch", "cv2", "numpy", "rich", "matplotlib"},
    "calib.command_line": {"torch", "cv2", "numpy", "rich", "capture"},
    "calib.session": {"torch", "rich", "capture"},
    "calib.board": {"torch", "cv2"},
    "calib.detect": {"torch", "rich", "capture"},
    "calib.detections": {"torch", "rich", "capture"},
    "calib.vnlog": {"torch", "cv2"},
    "calib.intrinsics": {"torch", "capture"},
    "calib.optics.path": {"cv2", "rich", "textual", "calib.session", "calib.solve", "capture"},
    "calib.optics.build": {"cv2", "rich", "calib.solve", "calib.fit", "capture"},
    "calib.solve": {"cv2", "calib.optics.path", "calib.session", "capture"},
    "calib.prior": {"cv2", "calib.solve", "calib.session", "capture"},
    "calib.landing": {"cv2", "rich", "calib.session", "calib.calibration", "capture"},
    "calib.problem": {"cv2", "rich", "calib.session", "calib.calibration", "capture"},
    "calib.joint": {"cv2", "rich", "calib.session", "calib.calibration", "capture"},
    "calib.evaluate": {"rich", "calib.fit", "calib.paper", "capture"},
    "calib.calibration": {"rich", "calib.fit", "calib.solve", "capture"},
    "calib.fit": {"rich", "textual", "matplotlib", "capture"},
    "calib.design": {"torch", "cv2", "capture"},
    "calib.information": {"rich", "calib.fit", "capture"},
    "calib.effects.registry": {"cv2", "rich", "calib.session", "calib.solve", "calib.fit", "capture"},
    "calib.model": {"rich", "calib.calibration", "calib.session", "capture"},
    "calib.diagnosis.diagnose": {"rich", "textual", "matplotlib", "capture"},
    "calib.importing.mrcal": {"torch", "rich", "capture"},
    "calib.importing.ros": {"torch", "rich", "capture"},
    "calib.importing.kalibr": {"torch", "rich", "capture"},
    "calib.importing.pictures": {"torch", "rich", "capture"},
    "calib.report.origin": {"rich", "textual", "matplotlib", "capture"},
    "calib.report.write": {"textual", "calib.fit", "capture"},
    "capture.cli": {"torch", "cv2", "numpy", "rich", "textual", "matplotlib"},
    "capture.frames": {"torch", "cv2"},
    "capture.finder": {"torch", "rich", "textual", "capture.recorder", "capture.reader", "capture.sources"},
    "capture.gate": {"torch", "rich", "textual", "capture.recorder", "capture.reader", "capture.sources"},
    "capture.record": {"torch", "rich", "textual", "matplotlib"},
    "capture.coverage": {"torch", "rich", "textual"},
    "capture.guidance_process": {"torch", "rich", "textual"},
    "capture.tui.app": {"torch", "matplotlib"},
    "capture.sources.registry": {"torch", "cv2"},
    "capture.sources.libcamera": {"torch", "cv2", "libcamera"},
}
"""The module, and what importing it must not load."""


@pytest.mark.parametrize("module", FORBIDDEN)
def test_importing(module: str) -> None:
    code = f"import sys, {module}; print('\\n'.join(sys.modules))"
    loaded = set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())
    assert not loaded & FORBIDDEN[module]
