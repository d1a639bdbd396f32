"""Whether two folders with what `capture record --json` and `calib fit --json` printed agree:
python -m tests.device.compare A B.
"""

import json
import sys
from pathlib import Path
from typing import Any

CLOSE = 5e-3
"""Relative: five times what other vector instructions and another torch came to."""

counts, errors = [], []
for folder in map(Path, sys.argv[1:]):
    recorded = json.loads((folder / "record.json").read_text())
    fitted = json.loads((folder / "fit.json").read_text())
    stages: list[dict[str, Any]] = fitted["stages"]
    counts.append(
        [recorded["pictures"], recorded["frames_judged"], fitted["frames_used"], fitted["corners"]]
    )
    errors.append(
        {"noise": fitted["noise_px"], **{stage["name"]: stage["rms_px"] for stage in stages}}
    )
    print(
        f"{folder.name}: {recorded['views']} views kept of {recorded['frames_judged']}, fitted in"
        f" {fitted['seconds']:.1f} s;",
        errors[-1],
    )
same = counts[0] == counts[1] and errors[0].keys() == errors[1].keys()
if not same or any(
    abs(errors[0][name] - errors[1][name]) > CLOSE * errors[1][name] for name in errors[0]
):
    sys.exit("They differ.")
