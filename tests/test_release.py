"""A release: the tag is the version, the workflows hang together, and each machine and Python gets
one torch.
"""

import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from calib.version import VERSION

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOWS = {
    path.stem: path.read_text(encoding="utf-8")
    for path in (ROOT / ".github" / "workflows").glob("*.yml")
}
PYTHONS = ["3.11", "3.12", "3.13", "3.14"]


def jobs(name: str) -> dict[str, Any]:
    read: dict[str, Any] = yaml.load(
        WORKFLOWS[name], yaml.BaseLoader
    )  # in which `on` is no truth value
    return dict(read["jobs"])


@pytest.mark.parametrize(
    ("tag", "code"), [(f"v{VERSION}", 0), (VERSION, 1), ("v99.0.0", 1), ("", 1)]
)
def test_a_tag_is_the_version_or_refused(tag: str, code: int) -> None:
    done = subprocess.run([ROOT / ".ci" / "tag", tag], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert (f"is not v{VERSION}: correct calib/version.py" in done.stderr) is bool(code)


def test_a_release_is_checked_before_it_is_published() -> None:
    release = jobs("release")
    assert release["version"]["steps"][-1]["run"] == '.ci/tag "$GITHUB_REF_NAME"'
    assert release["checks"] == {"needs": "version", "uses": "./.github/workflows/checks.yml"}
    assert release["publish"]["needs"] == "checks"
    assert release["publish"]["permissions"] == {"id-token": "write"}
    download, publish = release["publish"]["steps"]
    assert publish == {"uses": "pypa/gh-action-pypi-publish@release/v1"}, (
        "no password: trusted publishing"
    )
    uploads = [
        step
        for step in jobs("checks")["wheel"]["steps"]
        if "upload-artifact" in step.get("uses", "")
    ]
    (upload,) = uploads
    assert upload["with"]["name"] == download["with"]["name"]
    assert yaml.load(WORKFLOWS["release"], yaml.BaseLoader)["on"] == {"push": {"tags": ["v*"]}}
    assert "workflow_call" in yaml.load(WORKFLOWS["checks"], yaml.BaseLoader)["on"]


def test_both_machines_and_every_python_run_the_checks_and_the_wheel() -> None:
    for name in ("checks", "smoke"):
        assert jobs("checks")[name]["strategy"]["matrix"] == {
            "os": ["ubuntu-24.04", "ubuntu-24.04-arm"],
            "python": PYTHONS,
        }
    assert jobs("checks")["smoke"]["steps"][-1]["run"] == ".ci/smoke dist/*.whl"


@pytest.mark.parametrize("name", WORKFLOWS)
def test_a_workflow_is_well_formed(name: str) -> None:
    """The steps of a workflow name an action with its version or run something. The jobs that they
    need exist, and the files that they run are in the tree.
    """
    for job, described in jobs(name).items():
        needed = described.get("needs", [])
        assert {needed} if isinstance(needed, str) else set(needed) <= jobs(name).keys()
        if "uses" in described:
            assert (ROOT / described["uses"]).is_file()
            continue
        assert {"runs-on", "steps", "timeout-minutes"} <= described.keys(), job
        for step in described["steps"]:
            assert ("run" in step) != ("uses" in step), (job, step)
            assert "@" in step.get("uses", "@")
            for word in step.get("run", "").split():
                assert not word.startswith(".ci/") or (ROOT / word).is_file(), word
            subprocess.run(["bash", "-n", "-c", step.get("run", "")], check=True)


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
@pytest.mark.parametrize("python", [*PYTHONS, "3.15"])
def test_each_machine_and_python_gets_one_torch(machine: str, python: str) -> None:
    """The markers choose a torch below 2.10 on aarch64, where later ones die on a Pi 4 or bring
    CUDA; on Python 3.15 the first that has a wheel.
    """
    names = [Requirement(line) for line in PROJECT["dependencies"] if line.startswith("torch")]
    environment = {"platform_machine": machine, "python_version": python}
    matching = [
        requirement
        for requirement in names
        if requirement.marker is None or requirement.marker.evaluate(environment)
    ]
    (chosen,) = matching
    versions = ["2.7.0", "2.9.1", "2.10.0", "2.13.0", "2.14.1", "2.15.0"]
    expected = "2.15.0" if python == "3.15" else "2.13.0" if machine == "x86_64" else "2.9.1"
    assert max(chosen.specifier.filter(versions), key=versions.index) == expected
    assert SpecifierSet(PROJECT["requires-python"]).contains(python)
