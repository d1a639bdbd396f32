"""Debian packages without installing anything: an apt of our own in the cache folder, which knows
one suite and finds nothing installed.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

DEADLINE = (
    time.monotonic() + 480.0
)  # s: everything that one command fetches is there by then, or it is not to be had
KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
SOURCES = """\
deb [signed-by={keyring}] http://deb.debian.org/debian {suite} main
deb [signed-by={keyring}] http://deb.debian.org/debian-security {suite}-security main
"""
OPTIONS = """\
APT::Architecture "{architecture}";
APT::Architectures {{ "{architecture}"; }};
APT::Sandbox::User "{user}";
Acquire::Languages "none";
Acquire::Retries "3";
Acquire::http::Timeout "30";
Debug::NoLocking "true";
Dir::State "{folder}/state";
Dir::State::status "{folder}/status";
Dir::Cache "{folder}/cache";
Dir::Etc::SourceList "{folder}/sources.list";
Dir::Etc::SourceParts "/dev/null";
Dir::Etc::PreferencesParts "/dev/null";
"""


class MissingError(Exception):
    """Something that these tests need and that this machine cannot get; the message says what."""


def cache() -> Path:
    """The folder of all downloads."""
    return (
        Path(os.environ.get("REFRACAL_DEVICE_CACHE") or "~/.cache/refracal-device")
        .expanduser()
        .absolute()
    )


def seconds_left() -> float:
    """For fetching, before the deadline."""
    return max(DEADLINE - time.monotonic(), 1.0)


def versioned(name: str, contents: Sequence[str]) -> str:
    """The name of a folder that is made anew when other contents are asked for."""
    return f"{name}-{crc32(' '.join(contents).encode()):08x}"


@dataclass(frozen=True, slots=True)
class Apt:
    suite: str
    architecture: str = "amd64"

    @property
    def folder(self) -> Path:
        return cache() / "apt" / f"{self.suite}-{self.architecture}"

    @property
    def _environment(self) -> Mapping[str, str]:
        return {
            **os.environ,
            "LC_ALL": "C",
            "DEBIAN_FRONTEND": "noninteractive",
            "APT_CONFIG": str(self.folder / "apt.conf"),
        }

    def newest(self, pattern: str) -> str:
        """The package of the highest number among those whose names match a regular expression."""
        self._prepare()
        command = ("apt-cache", "search", "--names-only", pattern)
        outcome = subprocess.run(
            command, env=self._environment, capture_output=True, text=True, check=True
        ).stdout
        names = [line.split()[0] for line in outcome.splitlines()]
        if not names:
            raise LookupError(
                f"Debian {self.suite} has no package like {pattern}: correct the pattern."
            )
        return max(names, key=lambda name: [int(digits) for digits in re.findall(r"[0-9]+", name)])

    def unpacked(self, name: str, packages: Sequence[str] = (), alone: Sequence[str] = ()) -> Path:
        """A folder with the contents of `packages` and all that they depend on, and of those
        `alone`; made once.
        """
        tree = cache() / versioned(name, (*packages, *alone))
        if tree.exists():
            return tree
        print(
            f"Fetching {' '.join((*packages, *alone))} of Debian {self.suite} ...", file=sys.stderr
        )
        self._prepare()
        debs = self.folder / f"debs-{tree.name}"
        (debs / "partial").mkdir(parents=True, exist_ok=True)
        if packages:
            self._fetch(
                *(
                    "apt-get",
                    "install",
                    "--download-only",
                    "--yes",
                    "--no-install-recommends",
                    "-o",
                    f"Dir::Cache::archives={debs}",
                ),
                *packages,
            )
        if alone:
            self._fetch("apt-get", "download", *alone, cwd=debs)
        partial = tree.with_name(f"{tree.name}.partial")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        for folder in (
            "bin",
            "lib",
            "sbin",
            "lib64",
        ):  # as Debian has merged them, where packages still use the old names
            (partial / "usr" / folder).mkdir(parents=True)
            (partial / folder).symlink_to(f"usr/{folder}")
        for deb in sorted(debs.glob("*.deb")):
            files = subprocess.Popen(["dpkg-deb", "--fsys-tarfile", deb], stdout=subprocess.PIPE)
            subprocess.run(
                ["tar", "-x", "--keep-directory-symlink", "--no-same-owner", "-C", partial],
                stdin=files.stdout,
                check=True,
            )
            if files.wait():
                raise MissingError(
                    f"{deb} cannot be unpacked: remove it, and run the same command again."
                )
        shutil.rmtree(debs)
        return partial.rename(tree)

    def _prepare(self) -> None:
        """Have the suite's lists; made once."""
        if (self.folder / "ready").exists():
            return
        for program in ("apt-get", "apt-cache", "dpkg-deb"):
            if not shutil.which(program):
                raise MissingError(
                    f"{program} is missing: fetching a guest's packages needs Debian's or Ubuntu's"
                    " apt."
                )
        if not KEYRING.exists():
            raise MissingError(
                f"{KEYRING} is missing: run sudo apt install debian-archive-keyring."
            )
        for folder in ("state/lists/partial", "cache/archives/partial"):
            (self.folder / folder).mkdir(parents=True, exist_ok=True)
        (self.folder / "status").touch()
        (self.folder / "sources.list").write_text(SOURCES.format(keyring=KEYRING, suite=self.suite))
        user = "root" if os.geteuid() == 0 else "_apt"
        (self.folder / "apt.conf").write_text(
            OPTIONS.format(architecture=self.architecture, user=user, folder=self.folder)
        )
        self._fetch("apt-get", "update", "--error-on=any")
        (self.folder / "ready").touch()

    def _fetch(self, *command: str, cwd: Path | None = None) -> None:
        """Run an apt-get that downloads; MissingError if it cannot."""
        name = " ".join(command[:2])
        try:
            done = subprocess.run(
                command,
                cwd=cwd,
                env=self._environment,
                capture_output=True,
                text=True,
                timeout=seconds_left(),
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise MissingError(
                f"{name} for Debian {self.suite} took too long: run the same command on a faster"
                " connection."
            ) from None
        if done.returncode == 0:
            return
        reason = next(
            (line for line in done.stderr.splitlines() if line.startswith("E:")),
            done.stderr.strip(),
        )
        if "update" not in command and "fetch" not in reason.lower():
            raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr}")
        if (
            "404" in reason
        ):  # the lists are older than the servers: next time they are fetched again
            (self.folder / "ready").unlink(missing_ok=True)
        raise MissingError(
            f"{name} failed ({reason}): these tests need Debian's package servers or a filled"
            " cache."
        )
