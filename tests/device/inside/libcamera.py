"""In the guest: libcamera's virtual camera shows a session's pictures in turn, as fast as they are
taken, while `capture record` runs.

Usage: python3 -m tests.device.inside.libcamera FIXTURE SHARED
"""

import json
import shutil
import sys
from pathlib import Path

from calib.io.images import list_images
from tests.device.inside.recording import PATIENCE, Recording

VIRTUAL = """\
%YAML 1.1
---
"Virtual0":
  supported_formats:
  - width: 1640
    height: 1232
    frame_rates: [30]
  frames:
    path: "/shown"
    scale_mode: "fill"
  location: "CameraLocationFront"
  model: "Virtual Video Device"
...
"""

fixture, shared = Path(sys.argv[1]), Path(sys.argv[2])
shown, session = Path("/shown"), Path("/tmp/session")
shown.mkdir()
for picture in list_images(
    fixture / "frames"
):  # libcamera would take any other file for a picture, too
    shutil.copy(picture, shown)
described = Path("/usr/share/libcamera/pipeline/virtual/virtual.yaml")
described.parent.mkdir(parents=True, exist_ok=True)
described.write_text(VIRTUAL)
cover = ("--cover-from", str(fixture / "session.yaml"), "--board", "9x9", "--square-mm", "20")
recording = Recording(
    session, f"libcamera:0?patience_s={PATIENCE:.0f}", *cover, "--all", "--views", "24"
)
(shared / "result.json").write_text(json.dumps(recording.ended()))
if session.exists():
    shutil.copytree(session, shared / "session")
