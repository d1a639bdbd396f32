"""The shutter of a camera's sensor: it reads all lines at once, or one after the other."""

from __future__ import annotations

from dataclasses import dataclass

from calib.session.schema import Quantity, Section

READOUT = Quantity("readout_ms", low=0.01, high=1000)
EXAMPLE = "{type: rolling, readout_ms: 30}"


@dataclass(frozen=True, slots=True)
class Shutter:
    """The type of a sensor's shutter."""

    rolling: bool
    """False: a global shutter, with which no board moves during a picture."""
    readout: float | None = None
    """s, from a picture's first line to its last. None: not known."""


def read_shutter(camera: Section) -> Shutter | None:
    """Read the shutter; None where the session does not state it."""
    if "shutter" not in camera.values:
        return None
    section = camera.section("shutter", EXAMPLE)
    section.allow_only(("type", READOUT.key))
    rolling = section.choice("type", ("rolling", "global"), "rolling or global") == "rolling"
    if READOUT.key not in section.values:
        return Shutter(rolling)
    if not rolling:
        raise section.error(
            READOUT.key,
            section.values[READOUT.key],
            "nothing: a global shutter reads all lines at once, so drop the key",
        )
    return Shutter(rolling, section.read(READOUT)[READOUT.key].value / 1e3)


def shutter_to_yaml(shutter: Shutter) -> dict[str, object]:
    """Return the mapping that `read_shutter` reads as this shutter."""
    kind: dict[str, object] = {"type": "rolling" if shutter.rolling else "global"}
    return (
        kind
        if shutter.readout is None
        else kind | {READOUT.key: float(f"{1e3 * shutter.readout:.12g}")}
    )
