"""The shutters of sensors that libcamera drives, by the names that their drivers have.

Of cameras that are sold for the Raspberry Pi; a sensor that is not here is not known. How long a
rolling one reads depends on its mode, which no driver tells.
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
"""The last part of a camera's place in the device tree, such as /base/soc/i2c0mux/i2c@1/imx219@10.
"""


def sensor_in(words: str) -> str:
    """The sensor of the camera whose id stands in these words; empty where none does."""
    found = NODE.search(words)
    return found[1] if found else ""


def shutter_of(sensor: str) -> Shutter | None:
    return SHUTTERS.get(sensor)
