"""Who may import whom, checked in fresh interpreters: a Pi captures without torch, and calib never needs capture."""

import subprocess
import sys

import pytest

FORBIDDEN = {
    "calib": {"torch", "cv2", "numpy"},
    "calib.cli": {"torch", "cv2", "numpy", "rich", "matplotlib"},
    "calib.commands.command_line": {"torch", "cv2", "numpy", "rich", "capture"},
    "calib.session.session": {"torch", "rich", "capture"},
    "calib.session.board": {"torch", "cv2"},
    "calib.corners.detect": {"torch", "rich", "capture"},
    "calib.corners.detect_all": {"torch", "rich", "capture"},
    "calib.corners.corners_file": {"torch", "cv2"},
    "calib.fitting.intrinsics": {"torch", "capture"},
    "calib.optics.path": {"cv2", "rich", "textual", "calib.session.session", "calib.estimation.levenberg_marquardt", "capture"},
    "calib.optics.build": {"cv2", "rich", "calib.estimation.levenberg_marquardt", "calib.fitting.fit", "capture"},
    "calib.estimation.levenberg_marquardt": {"cv2", "calib.optics.path", "calib.session.session", "capture"},
    "calib.estimation.surface_prior": {"cv2", "calib.estimation.levenberg_marquardt", "calib.session.session", "capture"},
    "calib.estimation.residual_blocks": {"cv2", "rich", "calib.session.session", "calib.calibration", "capture"},
    "calib.estimation.objective": {"cv2", "rich", "calib.session.session", "calib.calibration", "capture"},
    "calib.estimation.joint_fit": {"cv2", "rich", "calib.session.session", "calib.calibration", "capture"},
    "calib.fitting.evaluate": {"rich", "calib.fitting.fit", "calib.estimation.gradient_fit", "capture"},
    "calib.undistortion.depth_map": {"torch", "cv2", "rich", "calib.undistortion.ray_field", "capture"},
    "calib.calibration": {"rich", "calib.fitting.fit", "calib.estimation.levenberg_marquardt", "capture"},
    "calib.fitting.fit": {"rich", "textual", "matplotlib", "capture"},
    "calib.planning.design": {"torch", "cv2", "capture"},
    "calib.planning.information": {"rich", "calib.fitting.fit", "capture"},
    "calib.effects.registry": {
        "cv2",
        "rich",
        "calib.session.session",
        "calib.estimation.levenberg_marquardt",
        "calib.fitting.fit",
        "capture",
    },
    "calib.estimation.camera_model": {"rich", "calib.calibration", "calib.session.session", "capture"},
    "calib.diagnosis.diagnose": {"rich", "textual", "matplotlib", "capture"},
    "calib.importing.from_mrcal": {"torch", "rich", "capture"},
    "calib.importing.from_ros": {"torch", "rich", "capture"},
    "calib.importing.from_kalibr": {"torch", "rich", "capture"},
    "calib.importing.from_pictures": {"torch", "rich", "capture"},
    "calib.fitting.provenance": {"rich", "textual", "matplotlib", "capture"},
    "calib.report.write": {"textual", "calib.fitting.fit", "capture"},
    "capture.cli": {"torch", "cv2", "numpy", "rich", "textual", "matplotlib"},
    "capture.frames": {"torch", "cv2"},
    "capture.finder": {"torch", "rich", "textual", "capture.recorder", "capture.reader", "capture.sources"},
    "capture.gate": {"torch", "rich", "textual", "capture.recorder", "capture.reader", "capture.sources"},
    "capture.recording_loop": {"torch", "rich", "textual", "matplotlib"},
    "capture.coverage": {"torch", "rich", "textual"},
    "capture.guidance": {"torch", "rich", "textual"},
    "capture.process": {"torch", "cv2", "numpy", "rich", "textual"},
    "capture.tui.fitting": {"torch", "cv2", "numpy", "rich", "textual"},
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


def test_reading_a_session_by_the_librarys_face_loads_no_torch() -> None:
    code = "import sys, calib; calib.read_session; print('\\n'.join(sys.modules))"
    loaded = set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())
    assert not loaded & {"torch", "rich", "capture"}
