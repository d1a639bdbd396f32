"""Kills fit, diagnose, export and report, and looks at what is left in the folder that they write
to: the old set or the new one, beside a stranger's files.

python -m tests.fuzz.kills --kills 200. Every second kill is at a moment of the command's work, one
in each of as many equal parts of it; the others are at a change of the folder, from the first to
the last. Each folder is judged twice: by a reader that is not calib, which opens the files by their
names, and again after calib has tidied up; both must see the same whole set. A line says how many
left the old set and how many the new one, how many had links that calib had to replace, and how
many ended before their kill.

--without-links judges a disk without symbolic links, where only calib is promised a whole set: the
number of mixed sets that another reader sees is printed, and is no failure.
"""

import argparse
import errno
import os
import random
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch

from calib.calibration import Calibration
from calib.cli import main as calib_main
from calib.io.file_set import HIDDEN, finish_change
from fixtures.synthetic import scene
from tests.io.killed import kill_at, on_change
from tests.test_calibration import write_session

FOREIGN = {"notes.txt": b"mine", "map_of_room.npz": b"mine", "map_backup_2024m.npz": b"mine"}
"""Files in every folder that no command made, with names that calib's own patterns match."""
SAID_EVERY_S = 10.0
Contents = dict[str, bytes]


@dataclass(frozen=True)
class Command:
    """A command, and the folder that it changes, as it was before."""

    name: str
    arguments: Sequence[str]
    initial_folder: Path
    digest: str
    """The digest of the calibration whose files it writes; empty if the command makes the
    calibration.
    """


@dataclass(frozen=True)
class Whole:
    """The outcome of a run that nobody kills."""

    names: frozenset[str]
    written: frozenset[str]
    """The names of files that changed."""
    changes: int
    work_s: float
    """Seconds of the processor: on a busy machine, the same moment by the clock is another one in
    each run.
    """


def commands(place: Path) -> list[Command]:
    """Return commands over a folder with all files of an earlier calibration. Each writes to its
    last argument.
    """
    sessions = [
        write_session(place / name, scene(seed, views=10, amplitude=1e-5, noise=0.05))
        for name, seed in (("a", 7), ("b", 8))
    ]
    small = ["--grid", "4x4", "--depth", "0.6", "1"]
    fits = [place / "fit a", place / "fit b"]
    for session, out in zip(sessions, fits, strict=True):
        if run(["fit", str(session), *small, "-o", str(out)]) != 0:
            raise SystemExit("the session cannot be fitted")
    first_fit, second_fit = map(str, fits)
    exported = place / "export a"
    run(["export", first_fit, "--format", "npz", "--depth", "0.6", "2", "-o", str(exported)])
    for folder in (*fits, exported):
        for name, data in FOREIGN.items():
            (folder / name).write_bytes(data)
    digest = Calibration.load(second_fit).digest
    return [
        Command("fit", ["fit", str(sessions[1]), *small, "-o"], fits[0], ""),
        Command("diagnose", ["diagnose", second_fit, "-o"], fits[0], ""),
        Command(
            "export",
            ["export", second_fit, "--format", "npz", "--depth", "0.6", "1", "3", "-o"],
            exported,
            digest,
        ),
        Command("report", ["report", "--no-open", "--depth", "0.6", "--"], fits[1], digest),
    ]


def run(arguments: Sequence[str]) -> int:
    """In a fork that says nothing; the exit code, or minus the signal."""
    child = _fork(arguments)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _fork(
    arguments: Sequence[str],
    change: int | None = None,
    work_s: float = 0.0,
    counted: Path | None = None,
) -> int:
    """A process with the command, which is killed at that change of its folder, or after so much
    work.
    """
    child = os.fork()
    if child:
        return child
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nowhere, standard)
    folder = Path(arguments[-1])
    if change is not None:
        kill_at(change, folder)
    if work_s:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)  # ends the process at once, as SIGKILL does
        signal.setitimer(signal.ITIMER_PROF, work_s)
    if counted:
        tally = os.open(counted, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
        on_change(folder, lambda: os.write(tally, b"."))
    os._exit(calib_main(list(arguments)))


def contents(folder: Path) -> Contents:
    """Return what any program reads in a folder: the files that can be opened, by name. Hidden ones
    are not looked at.
    """
    return {
        path.name: path.read_bytes()
        for path in folder.iterdir()
        if path.is_file() and not path.name.startswith(".")
    }


def measured(command: Command, place: Path) -> Whole:
    out = place / "whole"
    shutil.copytree(command.initial_folder, out)
    tally = place / "tally"
    _, status, used = os.wait4(_fork([*command.arguments, str(out)], counted=tally), 0)
    code = os.waitstatus_to_exitcode(status)
    complete = Whole(
        frozenset(contents(out)),
        written(out, command),
        tally.stat().st_size,
        used.ru_utime + used.ru_stime,
    )
    if code or (wrong := unlike_one_set(out, complete, command)):
        raise SystemExit(f"{command.name} ends with {code}{f'; {wrong}' if code == 0 else ''}")
    shutil.rmtree(out)
    tally.unlink()
    return complete


def written(folder: Path, command: Command) -> frozenset[str]:
    initial = contents(command.initial_folder)
    return frozenset(name for name, data in contents(folder).items() if data != initial.get(name))


def unlike_one_set(folder: Path, complete: Whole, command: Command) -> str:
    """Return what speaks against these being the files of one set, without any code of calib that
    tidies up; empty where nothing does.
    """
    files = contents(folder)
    if files.keys() != complete.names or written(folder, command) != complete.written:
        return f"of {sorted(files)}, it wrote {sorted(written(folder, command))}"
    if any(files[name] != data for name, data in FOREIGN.items()):
        return "a stranger's file has changed"
    digest = sha256(files["calibration.npz"]).hexdigest() if "calibration.npz" in files else ""
    if digest and f"arrays_sha256: {digest}".encode() not in files["calibration.yaml"]:
        return "calibration.yaml is of another calibration.npz"
    digest = command.digest or digest
    for name in complete.written:
        path = folder / name
        if path.name == "report.html" and not (
            digest in (text := path.read_text()) and text.rstrip().endswith("</html>")
        ):
            return "report.html is of another calibration"
        if (
            path.suffix == ".npz"
            and path.name != "calibration.npz"
            and str(np.load(path)["calibration"]) != digest
        ):
            return f"{path.name} is of another calibration"
    return ""


def judged(out: Path, command: Command, complete: Whole) -> str:
    """Return old, new, or what is wrong."""
    if contents(out) == contents(command.initial_folder):
        return "old"
    return unlike_one_set(out, complete, command) or "new"


def judged_after(out: Path, command: Command, complete: Whole) -> str:
    """Return the judgement after calib has tidied up; it leaves nothing behind."""
    finish_change(out)
    if (out / HIDDEN).exists() or any(path.is_symlink() for path in out.iterdir()):
        return "links are left"
    return judged(out, command, complete)


def take_links_away() -> None:
    """Make this process and its forks believe that the disk has no symbolic links."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    os.symlink = refuse


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--without-links", action="store_true")
    args = parser.parse_args()
    if args.without_links:
        take_links_away()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    draw = random.Random(args.seed)
    tally: Counter[tuple[str, str]] = Counter()
    counts: Counter[tuple[str, str]] = Counter()
    settled = unfinished = ended = 0
    spoken = time.monotonic()
    with TemporaryDirectory() as folder:
        place = Path(folder)
        tried = commands(place)
        wholes = {command.name: measured(command, place) for command in tried}
        for number in range(args.kills):
            command = tried[number % len(tried)]
            complete, turn = wholes[command.name], number // len(tried)
            out = place / "out"
            shutil.copytree(command.initial_folder, out)
            progress = (turn // 2 + draw.random() * (turn % 2)) / -(-args.kills // (2 * len(tried)))
            at = (
                {"work_s": progress * complete.work_s}
                if turn % 2
                else {"change": int(progress * complete.changes)}
            )
            child = _fork([*command.arguments, str(out)], **at)
            ended += os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) >= 0
            unfinished += any(path.name.endswith(".tmp") for path in out.rglob("*"))
            settled += any(path.is_symlink() for path in out.iterdir())
            anybody = judged(out, command, complete)
            verdict = judged_after(out, command, complete)
            if not args.without_links and anybody != verdict:
                verdict = f"calib sees {verdict} where another reader sees {anybody}"
            tally[command.name, verdict] += 1
            counts[command.name, anybody] += 1
            shutil.rmtree(out)
            if time.monotonic() - spoken > SAID_EVERY_S:
                spoken = time.monotonic()
                print(f"{number + 1} of {args.kills}", file=sys.stderr, flush=True)
    for (name, verdict), count in sorted(tally.items()):
        print(f"{name:10}{count:5}  {verdict}")
    bad = sum(count for (_, verdict), count in tally.items() if verdict not in ("old", "new"))
    mixed = sum(count for (_, verdict), count in counts.items() if verdict not in ("old", "new"))
    print(
        f"seed {args.seed}, {args.kills} kills: {bad} left neither the old set nor the new one to"
        f" calib, {mixed} to another reader; {settled} left links; {unfinished} left a .tmp;"
        f" {ended} ended before the kill"
    )
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main())
