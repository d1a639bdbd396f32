"""The source of a libcamera camera, such as a Raspberry Pi's, through libcamera's own Python
bindings.

`libcamera:0?size=1640x1232&exposure_us=8000&gain=1&lens_position=2.0`. The camera finds exposure,
gain and white balance by itself before the first frame if they are not given, and holds them from
then on. `patience_s` is the time that it may send nothing. The bindings come with the system, not
from PyPI.
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
from capture.sources.options import (
    AUTO,
    COLOUR,
    EXPOSURE_US,
    GAIN,
    PATIENCE_S,
    read_number,
    read_size,
    read_switch,
)
from capture.sources.registry import Inventory

LENS_POSITION = Quantity("lens_position", low=0, high=100)
MAX_SETTLING_FRAMES = 60  # frames, the maximum in which the camera finds its exposure
MANUAL, CONVERGED = 0, 2  # values of AfMode and AeState
# s, the maximum age of a frame that has just come: an older time is not from this clock
MAX_FRAME_AGE = 1.9
CONTROL_DELAY = 12  # frames, the maximum until a sensor applies its controls
COLUMNS = {
    "ExposureTime": "exposure_us",
    "AnalogueGain": "gain",
    "LensPosition": "lens_position",
    "ColourGains": "awbgains",
    "ScalerCrop": "crop",
    "SensorTemperature": "temperature_c",
}
"""The frame's metadata that goes into frames.csv, and its columns."""


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
        *,
        automatic: bool = False,
    ) -> None:
        """`controls` are named as in libcamera: ExposureTime, AnalogueGain, LensPosition. With
        `automatic`, exposure, gain and white balance follow the light.
        """
        self._automatic = automatic
        self._place = place
        self._size = size or (0, 0)
        self._requested = controls
        self._patience_s = patience_s
        self._controls: dict[Any, object] = {}
        self._metadata: dict[str, Any] = {}
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
        )  # its buffers live as long as the allocator
        allocator.allocate(stream)
        requests = []
        for index, buffer in enumerate(allocator.buffers(stream)):
            request = self._camera.create_request(index)
            request.add_buffer(stream, buffer)
            requests.append(request)
            plane = buffer.planes[0]  # the plane of grey values
            self._mapped[index] = stack.enter_context(
                mmap(plane.fd, plane.offset + plane.length, MAP_SHARED, PROT_READ)
            )
            self._offset = plane.offset
        self._selector = stack.enter_context(selectors.DefaultSelector())
        self._selector.register(self._manager.event_fd, selectors.EVENT_READ)
        self._set_controls(
            {
                "AfMode": MANUAL,
                "AeEnable": not {"ExposureTime", "AnalogueGain"} <= set(self._requested),
                **self._requested,
            }
        )
        self._camera.start(self._controls)
        stack.callback(
            self._manager.get_ready_requests
        )  # after the stop: remaining requests would go to the next user of a camera
        stack.callback(self._camera.stop)
        for request in requests:
            self._camera.queue_request(request)
        self._first = self._settle()

    def _configure(self) -> Any:
        """Return the stream, in the first format that begins with grey values, in the requested
        size or the largest one.
        """
        configurations = self._camera.generate_configuration([self._library.StreamRole.Viewfinder])
        configuration = configurations.at(0)
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
        configurations.validate()
        size = configuration.size.width, configuration.size.height
        if size != self._size:
            raise CaptureError(
                f"The camera gives pictures of {size[0]}x{size[1]} px: write"
                f" ?size={size[0]}x{size[1]} after the source."
            )
        self._camera.configure(configurations)
        self._stride = configuration.stride
        return configuration.stream

    def _set_controls(self, values: Mapping[str, object]) -> None:
        """Set these controls from the next request on, as far as the camera has them."""
        self._controls |= {
            self._ids[name]: value for name, value in values.items() if name in self._ids
        }

    def _settle(self) -> Frame | None:
        """Return the first frame with fixed exposure, gain and white balance, unless they are
        automatic; None if the source was closed before.
        """
        frame = self._take()
        if self._automatic:
            return frame
        for _ in range(MAX_SETTLING_FRAMES if "AeEnable" in self._ids else 0):
            if frame is None or self._metadata.get(
                "AeLocked", self._metadata.get("AeState") == CONVERGED
            ):
                break
            frame = self._take()
        settled: dict[str, object] = {
            name: self._metadata[name]
            for name in ("ExposureTime", "AnalogueGain", "ColourGains")
            if name in self._metadata
        }
        self._set_controls({**settled, **self._requested, "AeEnable": False, "AwbEnable": False})
        for _ in range(CONTROL_DELAY if self._controls else 0):
            frame = frame and self._take()
        return frame

    def _take(self) -> Frame | None:
        """Return the next complete frame; None once closed."""
        deadline = time.monotonic() + self._patience_s
        while not self._closed.is_set():
            if self._pending:
                request = self._pending.pop(0)
                frame = self._copy_frame(request)
                request.reuse()
                for control, value in self._controls.items():
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

    def _copy_frame(self, request: Any) -> Frame | None:
        """Return the request's picture; None if the camera failed to take it."""
        buffer = next(iter(request.buffers.values())).metadata
        failed = (
            self._library.FrameMetadata.Status.Error,
            self._library.FrameMetadata.Status.Cancelled,
        )
        if request.status != self._library.Request.Status.Complete or buffer.status in failed:
            return None
        width, height = self._size
        plane = np.frombuffer(
            self._mapped[request.cookie], np.uint8, self._stride * height, self._offset
        )
        self._metadata = {control.name: value for control, value in request.metadata.items()}
        metadata = {
            column: _plain(self._metadata[name])
            for name, column in COLUMNS.items()
            if name in self._metadata
        }
        pixels = plane.reshape(height, self._stride)[:, :width].copy()
        arrival_s = time.monotonic()
        if 0 <= arrival_s - buffer.timestamp / 1e9 < MAX_FRAME_AGE:
            return Frame(pixels, buffer.sequence, buffer.timestamp / 1e9, metadata)
        return Frame(
            pixels, request.sequence, arrival_s, metadata
        )  # a virtual camera fills the other numbers with random memory


def open_source(place: str, options: Section) -> LibcameraSource:
    options.allow_only(
        ("size", COLOUR, AUTO, EXPOSURE_US.key, GAIN.key, LENS_POSITION.key, PATIENCE_S.key),
        "known option",
    )
    read_switch(options, COLOUR)  # it is accepted, and the pictures are grey
    controls: dict[str, float | int] = {}
    if (exposure := read_number(options, EXPOSURE_US)) is not None:
        controls["ExposureTime"] = round(exposure)
    for name, quantity in (("AnalogueGain", GAIN), ("LensPosition", LENS_POSITION)):
        if (value := read_number(options, quantity)) is not None:
            controls[name] = value
    return LibcameraSource(
        place,
        read_size(options),
        controls,
        read_number(options, PATIENCE_S) or 0.0,
        automatic=read_switch(options, AUTO),
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
    return Inventory(
        tuple(device.list_camera(number, camera) for number, camera in enumerate(cameras))
    )


def _plain(value: object) -> float | str:
    """Return a cell of frames.csv: a number, or a text for other values."""
    if isinstance(value, bool | int | float):
        return float(value)
    return " ".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
