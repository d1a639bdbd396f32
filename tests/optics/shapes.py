"""One example of every cover shape, and its surface written once more in plain numpy for the
oracle.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.session.cover import Cover
from calib.session.schema import Number
from fixtures.synthetic import PATCH, Patch, paper_cone

Vec = NDArray[np.float64]
Numbers = Mapping[str, float]
GLASS = {"thickness": 0.003, "refractive_index": 1.5, "outside_index": 1.0}
WATER = 1.333


@dataclass(frozen=True)
class Example:
    cover: Cover
    moved: Mapping[str, float]
    """Numbers that put it off-centre, tilted and under water."""
    patch: Patch
    """About what the camera of fixtures.synthetic sees of its outer surface."""
    origin: Callable[[Numbers], Vec]
    """The place of its frame in the camera frame."""
    height: Callable[[Vec, Numbers], float]
    """The height of a point of its own frame above the inner surface."""
    chart: Callable[[Vec], tuple[float, float]]

    def changed(self, parameters: Mapping[str, float]) -> Cover:
        assert set(parameters) <= set(self.cover.parameters)
        return Cover(
            self.cover.shape,
            {
                **self.cover.parameters,
                **{name: Number(value) for name, value in parameters.items()},
            },
        )


def _axis(n: Numbers) -> Vec:
    return np.array([n["axis_offset.x"], 0.0, n["axis_offset.z"]])


def _cylinder_chart(p: Vec) -> tuple[float, float]:
    return float(p[1]), float(np.arctan2(p[0], p[2]))


def _numbers(**parameters: float) -> dict[str, Number]:
    return {name.replace("__", "."): Number(value) for name, value in (parameters | GLASS).items()}


TURNED = {"tilt.x": 0.03, "tilt.z": -0.02, "axis_offset.x": 0.002, "outside_index": WATER}

CONE = Example(
    paper_cone(),
    TURNED,
    PATCH,
    _axis,
    lambda p, n: float(np.hypot(p[0], p[2]) - n["inner_radius"] - n["radius_slope"] * p[1]),
    _cylinder_chart,
)
CYLINDER = Example(
    Cover(
        "cylinder",
        _numbers(
            inner_radius=0.042, axis_offset__x=0.0, axis_offset__z=-0.03, tilt__x=0.0, tilt__z=0.0
        ),
    ),
    TURNED,
    PATCH,
    _axis,
    lambda p, n: float(np.hypot(p[0], p[2]) - n["inner_radius"]),
    _cylinder_chart,
)
FLAT = Example(
    Cover("flat", _numbers(distance=0.02, tilt__x=0.0, tilt__y=0.0)),
    {"tilt.x": 0.15, "tilt.y": -0.1, "outside_index": WATER},
    ((-0.012, -0.016), (0.012, 0.016)),
    lambda n: np.array([0.0, 0.0, n["distance"]]),
    lambda p, _: float(p[2]),
    lambda p: (float(p[1]), float(p[0])),
)
DOME = Example(
    Cover("dome", _numbers(inner_radius=0.05, centre__x=0.0, centre__y=0.0, centre__z=-0.02)),
    {"centre.x": 0.004, "centre.y": -0.003, "outside_index": WATER},
    ((-0.3, -0.4), (0.3, 0.4)),
    lambda n: np.array([n["centre.x"], n["centre.y"], n["centre.z"]]),
    lambda p, n: float(np.linalg.norm(p) - n["inner_radius"]),
    lambda p: (float(np.arcsin(p[1] / np.linalg.norm(p))), float(np.arctan2(p[0], p[2]))),
)
EXAMPLES = (CONE, CYLINDER, FLAT, DOME)

each_shape = pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.cover.shape)
