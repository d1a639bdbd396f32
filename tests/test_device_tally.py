"""The tally of a run on devices: a group that ran nothing, though it could have, is a failure."""

import sys
from pathlib import Path

import pytest

from tests.device.skipped import SKIPPED
from tests.device.tally import Tally

PASSES = "def test_a():\n    pass\n\n\ndef test_b():\n    pass\n"
SKIPS = "import pytest\n\n\ndef test_a():\n    pytest.skip('no camera')\n"
FAILS = "def test_a():\n    assert False\n"
BREAKS = (
    "import pytest\n\n\n@pytest.fixture\ndef guest():\n    raise OSError\n\n\ndef test_a(guest):\n "
    "   pass\n"
)


def run(folder: Path, missing: dict[str, str], **checks: str) -> Tally:
    """Checks with these contents, in a pytest of their own."""
    tally = Tally((*checks, *missing))
    tally.missing.update(missing)
    files = [folder / f"check_{name}.py" for name in checks]
    for file, text in zip(files, checks.values(), strict=True):
        file.write_text(text)
        sys.modules.pop(file.stem, None)  # of the test before
    pytest.main(
        [
            "-q",
            "-p",
            "no:cacheprovider",
            "--import-mode=importlib",
            f"--rootdir={folder}",
            "-c",
            "/dev/null",
            *map(str, files),
        ],
        plugins=[tally],
    )
    return tally


def test_all_groups_ran(tmp_path: Path) -> None:
    tally = run(tmp_path, {}, loopback=PASSES, vivid=PASSES)
    assert tally.code == 0
    assert str(tally).splitlines() == [
        f"Device checks, {group}: 2 ran, 0 failed, 0 skipped" for group in ("loopback", "vivid")
    ]


def test_a_group_that_cannot_run_here_is_named_with_its_reason(tmp_path: Path) -> None:
    tally = run(tmp_path, {"libcamera": "pip reaches no package index."}, vivid=PASSES)
    assert tally.code == SKIPPED
    assert "Device checks, libcamera: SKIPPED: pip reaches no package index." in str(tally)


@pytest.mark.parametrize("text", [SKIPS, ""], ids=("skipped", "empty"))
def test_a_whole_group_that_ran_nothing_fails(tmp_path: Path, text: str) -> None:
    tally = run(tmp_path, {}, loopback=PASSES, vivid=text)
    assert tally.code == 1
    assert "vivid: 0 ran" in str(tally)
    assert "FAILED, as this machine has all that they need" in str(tally)


@pytest.mark.parametrize("text", [FAILS, BREAKS], ids=("fails", "breaks before"))
def test_a_check_that_fails_is_never_a_skip(tmp_path: Path, text: str) -> None:
    tally = run(tmp_path, {"libcamera": "no network"}, vivid=text)
    assert tally.code == 1
    assert "1 failed" in str(tally)
