"""A command imports slow libraries without the garbage collector, which then leaves them alone."""

import gc
import subprocess
import sys

from calib.commands.loading import fast_imports

CODE = """
import gc
from calib.commands.loading import fast_imports
with fast_imports():
    assert not gc.isenabled()
    import yaml
print(gc.isenabled(), gc.get_freeze_count() > 1000)
"""


def test_the_collector_waits_and_is_back_afterwards() -> None:
    printed = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True
    ).stdout
    assert printed == "True True\n"


def test_a_collector_that_is_off_stays_off() -> None:
    gc.disable()
    try:
        with fast_imports():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
