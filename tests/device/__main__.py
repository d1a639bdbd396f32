"""Real devices in a small virtual machine: `python -m tests.device [loopback] [vivid] [libcamera]`, by default the first two.

Fetches what the guests need into ~/.cache/refracal-device (or $REFRACAL_DEVICE_CACHE). Exit code 77: this machine cannot get what some
of the checks need; those were skipped, and the others passed.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from tests.device.guest import prepare
from tests.device.kernels import kernel_6_1, kernel_6_12, libcamera_root, v4l2loopback
from tests.device.packages import MissingError
from tests.device.skipped import SKIPPED
from tests.device.wheels import capture_wheels

CHECKS: Mapping[str, Sequence[Callable[[], object]]] = {
    "loopback": (prepare, lambda: v4l2loopback(kernel_6_1())),
    "vivid": (prepare, kernel_6_1),
    "libcamera": (prepare, kernel_6_12, libcamera_root, capture_wheels),
}
"""What each needs to be fetched. The checks are pytest's, in check_NAME.py, so that `python -m tests` does not find them."""


def main(names: list[str]) -> int:
    if unknown := set(names) - set(CHECKS):
        print(f"There is no check {', '.join(sorted(unknown))}: choose from {', '.join(CHECKS)}.", file=sys.stderr)
        return 2
    names = list(dict.fromkeys(names)) or ["loopback", "vivid"]
    files = []
    for name in names:
        try:
            for fetch in CHECKS[name]:
                fetch()
        except MissingError as error:
            print(f"SKIPPED {name}: {error}", file=sys.stderr)
        else:
            files.append(str(Path(__file__).with_name(f"check_{name}.py")))
    failed = int(pytest.main(["-v", "--durations=0", "--durations-min=1", *files])) if files else 0
    return failed or (0 if len(files) == len(names) else SKIPPED)


sys.exit(main(sys.argv[1:]))
