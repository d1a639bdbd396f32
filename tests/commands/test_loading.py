"""A command that did not load torch can load it at once. The tests run in separate processes,
because torch is loaded here.
"""

import subprocess
import sys
from importlib.metadata import version

import pytest

from calib.commands.loading import TESTED_VERSIONS

pytestmark = pytest.mark.skipif(
    not version("torch").startswith(TESTED_VERSIONS), reason="this torch is loaded as it comes"
)

BEGIN = """
import gc, sys
from calib.commands.loading import DEFERRED, fast_imports
with fast_imports():
    import torch
assert gc.isenabled() and gc.get_freeze_count() > 100_000
"""


def said(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", BEGIN + code], capture_output=True, text=True, check=True
    ).stdout


def test_computing_and_differentiating_do_not_load_the_deferred_modules() -> None:
    code = """
x = torch.arange(6.0).reshape(2, 3).requires_grad_()
(x @ x.T).logdet().backward()
torch.linalg.solve_ex(torch.eye(2), torch.ones(2, 1))
read = {name for name in DEFERRED if type(sys.modules.get(name)).__name__ == "module"}
print(*sorted(read))
"""
    assert set(said(code).split()) <= {"torch.hub"}  # of which another part takes a name


def test_the_deferred_modules_work_once_requested() -> None:
    code = """
print(float(torch.distributions.Normal(0.0, 1.0).cdf(torch.tensor(0.0))))
print(torch.ao.nn.quantized.Linear.__module__.startswith("torch.ao."))
print(type(sys.modules["torch.ao"]).__name__, hasattr(torch.masked, "nothing"))
"""
    assert said(code).split("\n") == ["0.5", "True", "module False", ""]
