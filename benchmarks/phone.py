"""The cost of a page for a thumb: the app's processor time with one and with a terminal, and what
goes over the network.

    python -m benchmarks.phone [--seconds 20]

The app is served on this machine and collects from a recording of 20 frames a second, 1640x1232, of
one of a fixture's pictures. A window of the one kind, then of the other, takes what it is sent;
that of the page says of each picture that it was drawn.
"""

import argparse
import asyncio
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType

FIXTURE = Path(__file__).parents[1] / "fixtures" / "bumps"
RATE = 20.0  # frames a second
BEGIN_S = 8.0  # for the app to have begun to collect


def recording(folder: Path, count: int) -> Path:
    """A session's frames, hard links of one picture, with their times."""
    frames = folder / "frames"
    frames.mkdir(parents=True)
    first = frames / "00000.jpg"
    shutil.copy(sorted((FIXTURE / "frames").glob("*.jpg"))[0], first)
    rows = ["file,time_s"]
    for index in range(count):
        if index:
            os.link(first, frames / f"{index:05d}.jpg")
        rows.append(f"{index:05d}.jpg,{index / RATE}")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    return folder


def used_s(server: int) -> float:
    """s of processor time of the app that this process serves."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        words = stat.read_text().rpartition(")")[2].split()
        if int(words[1]) == server:
            return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    raise SystemExit("The app has ended.")


def resident_mb(server: int) -> float:
    for status in Path("/proc").glob("[0-9]*/status"):
        status_lines = dict(
            line.split(":", 1) for line in status.read_text().splitlines() if ":" in line
        )
        if int(status_lines["PPid"]) == server:
            return int(status_lines["VmRSS"].split()[0]) / 1024
    raise SystemExit("The app has ended.")


async def start(link: ClientWebSocketResponse) -> None:
    """By ^s, once the set-up has been drawn."""
    await asyncio.sleep(BEGIN_S / 2)
    await link.send_json(["stdin", "\x13"])


async def window(port: int, server: int, seconds: float, *, phone: bool) -> str:
    pictures: list[int] = []
    sizes = 0
    async with (
        ClientSession() as session,
        session.ws_connect(
            f"http://127.0.0.1:{port}/ws?width=120&height=40", max_msg_size=0
        ) as link,
    ):
        if phone:
            await link.send_json(["phone", {"view": True}])
        started = asyncio.get_running_loop().time()
        start_time, used = 0.0, 0.0
        starting = asyncio.create_task(start(link))
        while (current := asyncio.get_running_loop().time()) < started + BEGIN_S + seconds:
            if not start_time and current > started + BEGIN_S:
                start_time, used, pictures, sizes = current, used_s(server), [], 0
            message = await link.receive(timeout=30)
            sizes += len(message.data)
            if message.type is WSMsgType.BINARY and message.data[:1] == b"\xff":
                pictures.append(len(message.data))
            elif (
                message.type is WSMsgType.TEXT
                and (answer := json.loads(message.data)[1])
                and "number" in answer
            ):
                await link.send_json(["phone", {"drawn": answer["number"]}])
        await starting
        length, spent, resident = current - start_time, used_s(server) - used, resident_mb(server)
    line = (
        f"{100 * spent / length:.0f} % of a core, {resident:.0f} MB, {sizes / length / 1000:.0f}"
        " kB/s"
    )
    if pictures:
        line += (
            f", {len(pictures) / length:.1f} pictures a second of {np.mean(pictures) / 1000:.0f} kB"
        )
    return line


def encoding_ms() -> float:
    """ms to reduce and encode one picture."""
    from capture.tui.camera import Preview
    from capture.tui.phone import encode_jpeg

    cv2.setNumThreads(1)
    picture = cv2.imread(str(sorted((FIXTURE / "frames").glob("*.jpg"))[0]), cv2.IMREAD_GRAYSCALE)
    taken = []
    for _ in range(50):
        start_time = time.perf_counter()
        encode_jpeg(Preview.of(np.asarray(picture, np.uint8), sharp=True).image)
        taken.append(time.perf_counter() - start_time)
    return 1000 * float(np.median(taken))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds: float = parser.parse_args().seconds
    print(f"reduced and encoded: {encoding_ms():.1f} ms a picture")
    for phone in (False, True):
        with TemporaryDirectory() as name:
            folder = Path(name)
            source = recording(folder / "camera", int(RATE * (seconds + 4 * BEGIN_S)))
            (folder / "session").mkdir()
            shutil.copy(FIXTURE / "session.yaml", folder / "session")
            with socket.socket() as probe:
                probe.bind(("127.0.0.1", 0))
                port = probe.getsockname()[1]
            command = [
                sys.executable,
                "-m",
                "capture",
                str(folder / "session"),
                "--serve",
                "--port",
                str(port),
                "--source",
                f"folder:{source}",
            ]
            with subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            ) as process:
                assert process.stdout
                process.stdout.readline()
                time.sleep(1.0)
                try:
                    answers = asyncio.run(window(port, process.pid, seconds, phone=phone))
                finally:
                    process.terminate()
            print(f"{'page for a thumb' if phone else 'terminal':<17}{answers}", flush=True)


if __name__ == "__main__":
    main()
