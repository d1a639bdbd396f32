"""The cost of a stream over plain cv2.remap: `python -m benchmarks.stream`.

A cone of the paper, uneven by 8x8 bumps of 30 um, and frames in memory, so that no camera and no
decoder counts. Rounds of `calib stream`'s own loop, and of a loop of cv2.remap with the same maps
on the same frames, alternate in one run; figures are medians of rounds. CPU is that of all threads.
The latency is that of a camera which leaves the stream a third of the time.
A new depth image costs its own time, once, in a thread beside the stream: it is read as 16-bit PNG,
two planes, and gives new maps.
The bar is for the loop itself, to a target that takes the picture and does nothing; what the
formats of a pipe, a loopback device and a browser add is printed beside it.
"""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.apply.undistorter import NEAR, Undistorter
from calib.calibration import Calibration
from calib.session.shutter import Shutter
from capture.frames import Frame
from capture.streaming.depth_file import DepthFile
from capture.streaming.depth_maps import DepthMaps
from capture.streaming.pipe import PipeTarget
from capture.streaming.statistics import StreamStatistics
from capture.streaming.straightener import Straightener
from capture.streaming.stream import Stream
from capture.streaming.target import StreamTarget
from capture.streaming.view import StreamView
from capture.streaming.web_target import JPEG
from fixtures.known import known
from fixtures.synthetic import scene

SIZES = {(640, 480): 150, (1640, 1232): 20, (3280, 2464): 6}
"""Width and height, px, and the frames of a round: short, so that a busy moment of the machine
spoils few of them.
"""
ROUNDS = 25
IDLE = 1.5
"""The time from frame to frame over that of a stream that never waits, for the latency of a camera
that the stream keeps up with.
"""
BAR = 1.1
DEPTH = 0.5

Picture = NDArray[np.uint8]


class Cost(NamedTuple):
    """The cost of a frame."""

    wall_ms: float
    """ms a frame"""
    cpu_ms: float
    """ms a frame, of all threads"""
    latency_ms: float
    """ms from frame in to picture out"""


class Frames:
    """A source of frames that are in memory: as fast as they are taken, or every `interval_s` like
    a camera's.
    """

    remarks: Sequence[str] = ()
    shutter: Shutter | None = None

    def __init__(self, pictures: Sequence[Picture], count: int, interval_s: float = 0.0) -> None:
        self.live = interval_s > 0
        self._pictures = pictures
        self._count = count
        self._interval_s = interval_s

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def __iter__(self) -> Iterator[Frame]:
        for number in range(self._count):
            time.sleep(self._interval_s)
            yield Frame(self._pictures[number % len(self._pictures)], number, time.monotonic())

    def close(self) -> None: ...


class Nowhere:
    """A target that does nothing with a picture."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def show(self, picture: Picture) -> None: ...


class Encoder(Nowhere):
    """A target that encodes each picture as the page's viewers get it."""

    def show(self, picture: Picture) -> None:
        cv2.imencode(".jpg", picture, JPEG)


class Silence:
    """A listener that shows nothing."""

    def tell(self, sentence: str) -> None: ...

    def report_silence(self, seconds: float) -> None: ...

    def report_counts(self, statistics: StreamStatistics) -> None: ...


def main() -> int:
    table = Table("", *(f"{w}x{h}" for w, h in SIZES), title="Median of rounds, colour")
    columns = [measure(size, count) for size, count in SIZES.items()]
    for name in columns[0]:
        table.add_row(name, *(column[name] for column in columns))
    Console(width=110).print(table)
    print(
        f"OpenCV {cv2.__version__}, {cv2.getNumThreads()} threads. Load of the machine in the last"
        f" minute: {os.getloadavg()[0]:.1f}."
    )
    return int(any(float(column[RATIO]) > BAR for column in columns))


RATIO = f"CPU of the stream over cv2.remap (bar {BAR:g})"


def measure(size: tuple[int, int], count: int) -> dict[str, str]:
    """Return the figures of one size by their names."""
    calibration = known(scene(1, views=1, grid=(8, 8), amplitude=3e-5), *size)
    spots = np.random.default_rng(0).integers(0, 256, (4, 30, 40, 3), dtype=np.uint8)
    pictures = [np.asarray(cv2.resize(spot, size), np.uint8) for spot in spots]
    straightener = Straightener(calibration, StreamView(DEPTH))
    picture_size = straightener.size
    undistorter = straightener.view.undistorter(calibration)
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - a device

        def pipe() -> StreamTarget:
            stop = threading.Event()
            return PipeTarget(picture_size, stop, lambda _: None, descriptor=nowhere.fileno())

        makers: dict[str, Callable[[], StreamTarget]] = {
            "stream": Nowhere,
            "y4m, or a loopback device": pipe,
            "MJPEG": Encoder,
        }
        plain: list[Cost] = []
        costs: dict[str, list[Cost]] = {name: [] for name in makers}
        straight = np.zeros((*picture_size[::-1], 3), np.uint8)
        for _ in range(ROUNDS):
            plain.append(remap_frames(undistorter, straight, pictures, count))
            for name, make in makers.items():
                costs[name].append(stream_frames(straightener, make(), pictures, count))
        latencies = {}
        for name, make in makers.items():
            interval_s = IDLE * 1e-3 * typical(costs[name]).wall_ms
            cost = stream_frames(straightener, make(), pictures, 3 * count, interval_s)
            latencies[name] = cost.latency_ms
    bare = typical(plain)
    ratios = [a.cpu_ms / b.cpu_ms for a, b in zip(costs["stream"], plain, strict=True)]
    figures = {
        "cv2.remap alone: CPU a frame, ms": f"{bare.cpu_ms:.2f}",
        "cv2.remap alone: frames a second": f"{1e3 / bare.wall_ms:.0f}",
        RATIO: f"{median(ratios):.3f}",
        **depth_image_figures(calibration, undistorter, pictures, count),
    }
    for name, rounds in costs.items():
        cost = typical(rounds)
        if name != "stream":
            added_ms = cost.cpu_ms - typical(costs["stream"]).cpu_ms
            figures[f"{name}: adds CPU a frame, ms"] = f"{added_ms:.2f}"
        figures[f"{name}: frames a second"] = f"{1e3 / cost.wall_ms:.0f}"
        figures[f"{name}: ms from frame in to picture out"] = f"{latencies[name]:.2f}"
    return figures


def remap_frames(
    undistorter: Undistorter, straight: Picture, pictures: Sequence[Picture], count: int
) -> Cost:
    """Return the cost of cv2.remap with the stream's maps, in a loop without anything else."""
    wall = time.perf_counter()
    cpu = time.process_time()
    for number in range(count):
        cv2.remap(pictures[number % len(pictures)], *undistorter.maps, cv2.INTER_LINEAR, straight)
    return Cost(
        1e3 * (time.perf_counter() - wall) / count, 1e3 * (time.process_time() - cpu) / count, 0.0
    )


def stream_frames(
    straightener: Straightener,
    target: StreamTarget,
    pictures: Sequence[Picture],
    count: int,
    interval_s: float = 0.0,
) -> Cost:
    """Return the cost of the stream's loop, with a frame every `interval_s` s."""
    source = Frames(pictures, count, interval_s)
    stream = Stream(lambda: source, straightener, [target], Silence())
    wall = time.perf_counter()
    cpu = time.process_time()
    stream.run()
    return Cost(
        1e3 * (time.perf_counter() - wall) / count,
        1e3 * (time.process_time() - cpu) / count,
        stream.statistics.latency_ms(50),
    )


def depth_image_figures(
    calibration: Calibration, undistorter: Undistorter, pictures: Sequence[Picture], count: int
) -> dict[str, str]:
    """Return the figures of a stream with a depth for each pixel, by their names: a frame, and a
    depth image that is replaced by another.
    """
    width, height = undistorter.size
    straight = np.zeros((height, width, 3), np.uint8)
    millimetres = np.full((height, width), 800, np.uint16)
    millimetres[:, : width // 2] = 300
    view = StreamView(None)
    frame_ratios = []
    image_ratios = []
    with TemporaryDirectory() as folder:
        path = Path(folder, "depth.png")
        cv2.imwrite(str(path), millimetres)
        file = DepthFile(path, NEAR, lambda _: None)
        straightener = Straightener(calibration, view, depth_file=file)
        maps = DepthMaps(calibration, view, DepthFile(path, NEAR, lambda _: None))
        for _ in range(ROUNDS):
            plain = remap_frames(undistorter, straight, pictures, count)
            stream = stream_frames(straightener, Nowhere(), pictures, count)
            cv2.imwrite(str(path), millimetres)
            cpu = time.process_time()
            maps.undistorter(view)
            image_ratios.append(1e3 * (time.process_time() - cpu) / plain.cpu_ms)
            straightener.straighten(pictures[0])
            straightener.wait()
            frame_ratios.append(stream.cpu_ms / plain.cpu_ms)
    return {
        "with a depth image: CPU over cv2.remap": f"{median(frame_ratios):.3f}",
        "a new depth image: CPU over cv2.remap": f"{median(image_ratios):.1f}",
    }


def typical(costs: Sequence[Cost]) -> Cost:
    return Cost(*(median(values) for values in zip(*costs, strict=True)))


if __name__ == "__main__":
    sys.exit(main())
