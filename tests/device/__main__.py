"""Real devices in a small virtual machine: `python -m tests.device [loopback] [vivid] [libcamera]`,
by default all of them.

Fetches what the guests need into ~/.cache/refracal-device (or $REFRACAL_DEVICE_CACHE), and says at
the end how many checks of each group ran. Exit code 1: a check failed, or none of a group ran
although all that it needs is there. 77: this machine cannot get what some of the groups need; those
were skipped, and the others passed.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from tests.device.guest import prepare
from tests.device.kernels import kernel_6_1, kernel_6_12, libcamera_root, v4l2loopback
from tests.device.packages import MissingError
from tests.device.tally import Tally
from tests.device.wheels import capture_wheels

CHECKS: Mapping[str, Sequence[Callable[[], object]]] = {
    "loopback": (prepare, lambda: v4l2loopback(kernel_6_1())),
    "vivid": (prepare, kernel_6_1),
    "libcamera": (prepare, kernel_6_12, libcamera_root, capture_wheels),
}
"""The downloads that each check needs.

The checks are pytest's, in check_NAME.py, so that `python -m tests` does not find them.
"""


def main(names: list[str]) -> int:
    if unknown := set(names) - set(CHECKS):
        print(
            f"There is no check {', '.join(sorted(unknown))}: choose from {', '.join(CHECKS)}.",
            file=sys.stderr,
        )
        return 2
    tally = Tally(tuple(dict.fromkeys(names)) or tuple(CHECKS))
    files = []
    for name in tally.groups:
        try:
            for fetch in CHECKS[name]:
                fetch()
        except MissingError as error:
            tally.missing[name] = str(error)
        else:
            files.append(str(Path(__file__).with_name(f"check_{name}.py")))
    failed = (
        int(pytest.main(["-v", "--durations=0", "--durations-min=1", *files], plugins=[tally]))
        if files
        else 0
    )
    print(tally, flush=True)
    return failed or tally.code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
