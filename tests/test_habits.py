"""The checks before a commit and on GitHub are those of the README's test command."""

import re
from pathlib import Path

import yaml

from tests.__main__ import STYLE

ROOT = Path(__file__).parents[1]


def test_the_hooks_are_the_checks() -> None:
    (repository,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))[
        "repos"
    ]
    assert repository["repo"] == "local"
    assert [hook["entry"] for hook in repository["hooks"]] == [
        " ".join([".venv/bin/python -m", *check]) for check in STYLE
    ]


def test_github_runs_the_test_command_of_the_readme() -> None:
    command = re.search(
        r"Checks:.*?```\n(.*?)\n```",
        (ROOT / "README.md").read_text(encoding="utf-8"),
        re.DOTALL,
    )
    job = yaml.safe_load(
        (ROOT / ".github" / "workflows" / "checks.yml").read_text(encoding="utf-8")
    )["jobs"]["checks"]
    assert command
    assert command[1] in [step.get("run") for step in job["steps"]]


def test_the_top_level_has_the_agreed_files_only() -> None:
    """Folders whose name begins with a dot, and those that builds leave, do not count."""
    left_by_builds = {"out", "refracal-demo", "build", "dist", "refracal.egg-info"}
    agreed = {
        "pyproject.toml",
        "calib",
        "capture",
        "tests",
        "fixtures",
        "benchmarks",
        "docs",
        "README.md",
        "CONTRIBUTING.md",
        "CITATION.cff",
    }
    names = {path.name for path in ROOT.iterdir() if not path.name.startswith(".")} - left_by_builds
    assert names == agreed | {"CHANGELOG.md", "LICENSE"}
