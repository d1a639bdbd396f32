"""Write a session.yaml to start from: the printed board, and places for the numbers that only its
owner knows.
"""

import json
from collections.abc import Mapping

from calib.session.shapes.registry import find_shape, shape_names
from calib.sheet.sheet import Sheet
from calib.sheet.target import Pattern

EXAMPLE_ERROR = 0.5
"""mm by which both rulers of the example are printed too short."""


def starting_session(pattern: Pattern, sheet: Sheet, size: tuple[int, int]) -> str:
    """Return the file's text. `size` is the width and height of the camera's pictures, px."""
    a, b = sheet.rulers
    measured_a, measured_b = a - EXAMPLE_ERROR, b - EXAMPLE_ERROR
    value = sheet.side * (measured_a / a + measured_b / b) / 2
    sigma = sheet.side / 2 / min(a, b)
    board = _entries(pattern.to_yaml(sheet.side, sheet.side))
    covers = "\n".join(
        f"# cover: {{shape: {shape.name}, {_entries(shape.example)}}}"
        for shape in map(find_shape, shape_names())
        if shape.has_glass
    )
    return f"""\
# Made by calib board, for the sheet of board.pdf. After printing, measure its rulers a and b \
(mm), and write in place of {sheet.side:g}
# {{value: VALUE, sigma: SIGMA}}, with VALUE = {sheet.side:g} * (a / {a} + b / {b}) / 2 and SIGMA \
= {sheet.side:g} * D / 2 / {min(a, b)},
# where D (mm) is your ruler's smallest division. For example: a = {measured_a:g}, \
b = {measured_b:g} and D = 1 give {{value: {value:.3f}, sigma: {sigma:.3f}}}.
# A plain number is taken to be within 0.2 %.
format: 1
board: {{{board}}}
camera: {{width: {size[0]}, height: {size[1]}}}  # px, of your pictures
cover: {{shape: none}}  # a camera by itself
# For a camera behind glass, replace the line above by one of these, with your own lengths:
{covers}
# Add outside_index: 1.333 to them under water.
"""


def _entries(mapping: Mapping[str, object]) -> str:
    """Return the entries of a mapping on one line, as YAML has them in braces."""
    return ", ".join(f"{key}: {json.dumps(value)}" for key, value in mapping.items())
