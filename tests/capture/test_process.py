"""A function in a separate process: what it inherits, what stays hidden, and what is left after its
end.
"""

import os
import signal
import subprocess
import sys
import time
from multiprocessing.connection import Connection
from threading import Thread

import pytest

from capture.process import NICENESS, Process, prepare_processes


def echo(connection: Connection) -> None:
    while True:
        connection.send(connection.recv())


def tell(connection: Connection) -> None:
    connection.send((os.nice(0), "torch" in sys.modules))


def shout(connection: Connection) -> None:
    print("a print")
    print("a complaint", file=sys.stderr)
    os.write(1, b"a library's print\n")
    os.write(2, b"a library's complaint\n")
    connection.send("done")


def die(_: Connection) -> None:
    raise ValueError("odd")


def linger(connection: Connection) -> None:
    connection.send("ready")
    time.sleep(600)


def test_messages_go_both_ways() -> None:
    with Process(echo) as process:
        for message in (
            "one",
            {"two": [2.0]},
            b"3" * 10_000_000,
        ):  # the last is more than a pipe holds
            process.send(message)
            assert process.receive() == message


def test_it_gives_way_to_the_screen_and_has_nothing_loaded() -> None:
    """The child loads no torch even if this test process has it."""
    pytest.importorskip("torch")
    with Process(tell) as process:
        assert process.receive() == (min(os.nice(0) + NICENESS, 19), False)


def test_nothing_that_it_prints_reaches_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    with Process(shout) as process:
        assert process.receive() == "done"
        with pytest.raises(EOFError):
            process.receive()
        assert process.end().reason == "a library's complaint"
    assert capfd.readouterr() == ("", "")


def test_the_cause_of_a_process_s_death_is_reported(capfd: pytest.CaptureFixture[str]) -> None:
    with Process(die) as process:
        with pytest.raises(EOFError):
            process.receive()
        ending = process.end()
    assert (ending.by_signal, ending.reason) == (False, "ValueError: odd")
    assert capfd.readouterr() == ("", "")


def test_killed_while_another_thread_waits_it_leaves_no_zombie() -> None:
    with Process(linger) as process:
        assert process.receive() == "ready"
        Thread(target=process.kill).start()
        with pytest.raises(EOFError):
            process.receive()
        ending = process.end()
        assert ending.by_signal
        assert ending.reason.startswith("SIGKILL")
        process.kill()  # which is too late, and does no harm
    assert not runs(process.pid)


def test_one_that_was_killed_from_outside_takes_messages_until_its_end_is_read() -> None:
    with Process(linger) as process:
        assert process.receive() == "ready"
        os.kill(process.pid, signal.SIGTERM)
        time.sleep(0.5)
        process.send("a question" * 100_000)
        with pytest.raises(EOFError):
            process.receive()
        assert process.end().reason == "SIGTERM"


class Screen:
    """A replacement like the sys.stderr of a Textual app: there is no file behind it."""

    def write(self, text: str) -> int:
        return len(text)

    def flush(self) -> None:
        pass

    def fileno(self) -> int:
        return -1


def one_behind_a_screen() -> None:
    """Run in a fresh interpreter, because the effect of `prepare_processes` lasts as long as the
    process.
    """
    prepare_processes()
    sys.stderr = Screen()
    with Process(tell) as process:
        process.receive()
    sys.stdout.write("told")


def test_a_process_starts_behind_a_screen() -> None:
    code = f"from {__name__} import one_behind_a_screen; one_behind_a_screen()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "told", "")


def leave_one_behind() -> None:
    process = Process(linger)
    process.receive()
    print(process.pid)


def test_the_process_ends_with_the_program() -> None:
    code = f"from {__name__} import leave_one_behind; leave_one_behind()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=600
    )
    assert not runs(int(done.stdout))


def runs(pid: int) -> bool:
    """Return True if the process has ended, perhaps as a zombie that waits to be collected."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
