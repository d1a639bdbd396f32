"""A driver's controls by the names it gives them: those by which vivid feigns faults have no
numbers in any header.
"""

import struct
from fcntl import ioctl

QUERYCTRL, S_CTRL = 0xC0445624, 0xC008561C
NEXT = 0x80000000


def controls(handle: int) -> dict[str, int]:
    """The numbers of all controls of a device that is open."""
    results: dict[str, int] = {}
    number = NEXT
    while True:
        try:
            described = ioctl(handle, QUERYCTRL, struct.pack("=I64x", number))
        except OSError:
            return results
        number = struct.unpack_from("=I", described)[0]
        results[described[8:40].split(b"\0")[0].decode()] = number
        number |= NEXT


def set_control(handle: int, name: str, value: int = 1) -> None:
    ioctl(handle, S_CTRL, struct.pack("=Ii", controls(handle)[name], value))
