"""A camera of libcamera, such as a Raspberry Pi's, through libcamera's own Python bindings.

`libcamera:0?size=1640x1232&exposure_us=8000&gain=1&lens_position=2.0`. Exposure, gain and white
balance that are not given are found by the camera itself before the first frame, and held from then
on. `patience_s` is how long it may send nothing. The bindings come with the system, not from PyPI.
"""

import selectors
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from mmap import MAP_SHARED, PROT_READ, mmap
from types import TracebackType
from typing import Any, Self

import numpy as np

from calib.session.schema import Quantity, Section
from calib.session.shutter import Shutter
from capture.errors import CaptureError
from capture.frames import Frame
from capture.sensors import sensor_in, shutter_of
from capture.sources import libcamera_device as device
from capture.sources.options import EXPOSURE_US, GAIN, PATIENCE_S, read_number, read_size
from capture.sources.registry import Inventory

LENS_POSITION = Quantity("lens_position", low=0, high=100)
SETTLING = 60  # frames, at the most, in which the camera finds its exposure
MANUAL, CONVERGED = 0, 2  # of AfMode and AeState
OLDEST = 1.9  # s, of a frame that has just come: what is older was not told by this clock
DELAY = 12  # frames, at the most, until a sensor obeys
COLUMNS = {
    "ExposureTime": "exposure_us",
    "AnalogueGain": "gain",
    "LensPosition": "lens_position",
    "ColourGains": "awbgains",
    "ScalerCrop": "crop",
    "SensorTemperature": "temperature_c",
}
"""What of a frame's metadata goes into frames.csv."""


class LibcameraSource:
    live = True
    remarks: Sequence[str] = ()
    shutter: Shutter | None = None

    def __init__(
        self,
        place: str,
        size: tuple[int, int] | None,
        controls: Mapping[str, float],
        patience_s: float,
    ) -> None:
        """`controls` by libcamera's names: ExposureTime, AnalogueGain, LensPosition."""
        self._place = place
        self._size = size or (0, 0)
        self._asked = controls
        self._patience_s = patience_s
        self._held: dict[Any, object] = {}
        self._said: dict[str, Any] = {}
        self._mapped: dict[int, mmap] = {}
        self._offset = 0  # bytes
        self._pending: list[Any] = []
        self._closed = threading.Event()
        self._open = ExitStack()

    def __enter__(self) -> Self:
        self._library = device.bindings()
        self._manager = self._library.CameraManager.singleton()
        try:
            with ExitStack() as stack:
                self._prepare(stack)
                self._open = stack.pop_all()
        except (RuntimeError, OSError) as error:
            raise CaptureError(
                f"libcamera:{self._place} cannot stream ({error}): end other programs that use the"
                " camera, and check its cable."
            ) from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()

    def __iter__(self) -> Iterator[Frame]:
        frame = self._first
        while frame is not None:
            yield frame
            frame = self._take()

    def close(self) -> None:
        self._closed.set()

    def _prepare(self, stack: ExitStack) -> None:
        self._camera = device.find(self._manager.cameras, self._place)
        self.shutter = shutter_of(sensor_in(self._camera.id))
        self._camera.acquire()
        stack.callback(self._camera.release)
        self._ids = {control.name: control for control in self._camera.controls}
        stream = self._configure()
        self._allocator = allocator = self._library.FrameBufferAllocator(
            self._camera
        )  # its buffers live as long as it does
        allocator.allocate(stream)
        requests = []
        for index, buffer in enumerate(allocator.buffers(stream)):
            request = self._camera.create_request(index)
            request.add_buffer(stream, buffer)
            requests.append(request)
            plane = buffer.planes[0]  # the grey values
            self._mapped[index] = stack.enter_context(
                mmap(plane.fd, plane.offset + plane.length, MAP_SHARED, PROT_READ)
            )
            self._offset = plane.offset
        self._selector = stack.enter_context(selectors.DefaultSelector())
        self._selector.register(self._manager.event_fd, selectors.EVENT_READ)
        self._hold(
            {
                "AfMode": MANUAL,
                "AeEnable": not {"ExposureTime", "AnalogueGain"} <= set(self._asked),
                **self._asked,
            }
        )
        self._camera.start(self._held)
        stack.callback(
            self._manager.get_ready_requests
        )  # after the stop: what is left would come to the next who opens a camera
        stack.callback(self._camera.stop)
        for request in requests:
            self._camera.queue_request(request)
        self._first = self._settle()

    def _configure(self) -> Any:
        """The stream, in the first format that begins with grey values, in the size asked for or
        the largest.
        """
        whole = self._camera.generate_configuration([self._library.StreamRole.Viewfinder])
        configuration = whole.at(0)
        offered = {str(pixels): pixels for pixels in configuration.formats.pixel_formats}
        name = next((name for name in device.FORMATS if name in offered), None)
        if name is None:
            raise CaptureError(
                f"libcamera:{self._place} has none of the formats {', '.join(device.FORMATS)}, only"
                f" {', '.join(offered)}: use rpicam."
            )
        configuration.pixel_format = offered[name]
        if self._size == (0, 0):
            sizes = configuration.formats.sizes(offered[name])
            largest = max(sizes, key=lambda size: size.width * size.height)
            self._size = largest.width, largest.height
        configuration.size = self._library.Size(*self._size)
        configuration.buffer_count = 4
        whole.validate()
        given = configuration.size.width, configuration.size.height
        if given != self._size:
            raise CaptureError(
                f"The camera gives pictures of {given[0]}x{given[1]} px: write"
                f" ?size={given[0]}x{given[1]} after the source."
            )
        self._camera.configure(whole)
        self._stride = configuration.stride
        return configuration.stream

    def _hold(self, values: Mapping[str, object]) -> None:
        """From the next request on, those of the controls that the camera has."""
        self._held |= {
            self._ids[name]: value for name, value in values.items() if name in self._ids
        }

    def _settle(self) -> Frame | None:
        """The first frame whose exposure, gain and white balance are held; None if closed
        before.
        """
        frame = self._take()
        for _ in range(SETTLING if "AeEnable" in self._ids else 0):
            if frame is None or self._said.get("AeLocked", self._said.get("AeState") == CONVERGED):
                break
            frame = self._take()
        found: dict[str, object] = {
            name: self._said[name]
            for name in ("ExposureTime", "AnalogueGain", "ColourGains")
            if name in self._said
        }
        self._hold({**found, **self._asked, "AeEnable": False, "AwbEnable": False})
        for _ in range(DELAY if self._held else 0):
            frame = frame and self._take()
        return frame

    def _take(self) -> Frame | None:
        """The next complete frame; None once closed."""
        deadline = time.monotonic() + self._patience_s
        while not self._closed.is_set():
            if self._pending:
                request = self._pending.pop(0)
                frame = self._copied(request)
                request.reuse()
                for control, value in self._held.items():
                    request.set_control(control, value)
                self._camera.queue_request(request)
                if frame is not None:
                    return frame
            elif self._selector.select(0.1):
                self._pending += self._manager.get_ready_requests()
            if time.monotonic() > deadline:
                raise CaptureError(
                    f"libcamera:{self._place} sends no pictures: check the cable, and run the same"
                    " command to continue."
                )
        return None

    def _copied(self, request: Any) -> Frame | None:
        """The request's picture; None if the camera failed to take it."""
        said = next(iter(request.buffers.values())).metadata
        failed = (
            self._library.FrameMetadata.Status.Error,
            self._library.FrameMetadata.Status.Cancelled,
        )
        if request.status != self._library.Request.Status.Complete or said.status in failed:
            return None
        width, height = self._size
        plane = np.frombuffer(
            self._mapped[request.cookie], np.uint8, self._stride * height, self._offset
        )
        self._said = {control.name: value for control, value in request.metadata.items()}
        metadata = {
            column: _plain(self._said[name])
            for name, column in COLUMNS.items()
            if name in self._said
        }
        pixels = plane.reshape(height, self._stride)[:, :width].copy()
        now = time.monotonic()
        if 0 <= now - said.timestamp / 1e9 < OLDEST:
            return Frame(pixels, said.sequence, said.timestamp / 1e9, metadata)
        return Frame(
            pixels, request.sequence, now, metadata
        )  # a virtual camera's numbers are whatever was in the memory


def open_source(place: str, options: Section) -> LibcameraSource:
    options.allow_only(
        ("size", EXPOSURE_US.key, GAIN.key, LENS_POSITION.key, PATIENCE_S.key), "known option"
    )
    asked: dict[str, float | int] = {}
    if (exposure := read_number(options, EXPOSURE_US)) is not None:
        asked["ExposureTime"] = round(exposure)
    for name, quantity in (("AnalogueGain", GAIN), ("LensPosition", LENS_POSITION)):
        if (value := read_number(options, quantity)) is not None:
            asked[name] = value
    return LibcameraSource(
        place, read_size(options), asked, read_number(options, PATIENCE_S) or 0.0
    )


def inventory() -> Inventory:
    try:
        cameras = device.bindings().CameraManager.singleton().cameras
    except (CaptureError, RuntimeError) as error:
        return Inventory(missing=str(error))
    if not cameras:
        return Inventory(
            missing=(
                "libcamera sees no camera: check its cable, with the power off, and start the"
                " machine again."
            )
        )
    return Inventory(tuple(device.listed(number, camera) for number, camera in enumerate(cameras)))


def _plain(value: object) -> float | str:
    """A number, or the words of what is none, as a cell of frames.csv."""
    if isinstance(value, bool | int | float):
        return float(value)
    return " ".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
