"""The shutter types of the image sensors that libcamera drives, by their drivers' names.

The list covers cameras that are sold for the Raspberry Pi; the shutter of another sensor is
unknown. The readout time of a rolling shutter depends on the mode, which no driver reports.
"""

import re
from types import MappingProxyType

from calib.session.shutter import Shutter

ROLLING = (
    "ov5647",
    "imx219",
    "imx477",
    "imx378",
    "imx500",
    "imx519",
    "imx708",
    "imx290",
    "imx327",
    "imx462",
    "imx415",
    "ov64a40",
)
GLOBAL = ("imx296", "ov7251", "ov9281", "ov2311")
SHUTTERS = MappingProxyType({name: Shutter(name in ROLLING) for name in (*ROLLING, *GLOBAL)})
NODE = re.compile(r"/([a-z0-9]+)(?:_[a-z0-9]+)*@[0-9a-f]+(?![\w/])")
"""A regular expression for the last element of a camera's path in the device tree, such as
/base/soc/i2c0mux/i2c@1/imx219@10.
"""


def sensor_in(text: str) -> str:
    """Return the sensor of the camera whose id is in this text; empty if the text has no id."""
    match = NODE.search(text)
    return match[1] if match else ""


def shutter_of(sensor: str) -> Shutter | None:
    return SHUTTERS.get(sensor)
