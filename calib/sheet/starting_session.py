"""Write a session.yaml to start from: the printed board, and places for the numbers that only its
owner knows.
"""

import json

from calib.sheet.sheet import Sheet
from calib.sheet.target import Pattern


def starting_session(pattern: Pattern, sheet: Sheet, size: tuple[int, int]) -> str:
    """Return the file's text. `size` is the width and height of the camera's pictures, px."""
    a, b = sheet.rulers
    board = ", ".join(
        f"{key}: {json.dumps(value)}"
        for key, value in pattern.to_yaml(sheet.side, sheet.side).items()
    )
    return f"""\
# Made by calib board, for the sheet of board.pdf. After printing, measure its rulers a and b \
(mm), and write in place of {sheet.side:g}
# {{value: VALUE, sigma: SIGMA}}, with VALUE = {sheet.side:g} * (a / {a} + b / {b}) / 2 and SIGMA \
= {sheet.side:g} * D / 2 / {min(a, b)},
# where D (mm) is your ruler's smallest division. A plain number is taken to be within 0.2 %.
format: 1
board: {{{board}}}
camera: {{width: {size[0]}, height: {size[1]}}}  # px, of your pictures
cover: {{shape: none}}  # a camera by itself; for one behind glass, one of these, with your own \
lengths:
# cover: {{shape: flat, distance_mm: 25.0, thickness_mm: 6.0, refractive_index: 1.5}}
# cover: {{shape: dome, inner_radius_mm: 50.0, centre_mm: [0.0, 0.0, 0.0], thickness_mm: 3.0, \
refractive_index: 1.5}}
# cover: {{shape: cylinder, inner_radius_mm: 42.0, axis_offset_mm: [0.0, -30.0], thickness_mm: \
3.0, refractive_index: 1.5}}
# cover: {{shape: cone, inner_radius_mm: 42.0, radius_slope: -0.1, axis_offset_mm: [0.0, -30.0], \
thickness_mm: 3.0, refractive_index: 1.5}}
# Add outside_index: 1.333 to them under water.
"""
