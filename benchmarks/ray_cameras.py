"""A covered camera in renderers: `python -m benchmarks.ray_cameras [--blender PYTHON] [-o DIR]`.

A board is rendered by the exported camera and through the real glass, a mesh of an uneven cone that
Mitsuba bends the light at (fixtures/ray_cameras.py). The table says how far apart the board's
corners are in the two pictures, and in a picture of the bare pinhole. Needs `pip install -e
'.[render]'`, and for --blender a Python with bpy 5. Newton, nvidia-ncore and pycolmap are left out
where they are not installed.
"""

import argparse
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.cli import main as calib
from calib.session.cover import Cover
from fixtures.ray_camera_readers import (
    colmap_picture,
    gsplat_picture,
    ncore_picture,
    newton_picture,
)
from fixtures.ray_cameras import (
    Array,
    blender_picture,
    difference,
    mitsuba_pictures,
    true_calibration,
)

BLENDER_SAMPLES = 256
DEPTH = 0.36
"""m: the distance of the board's middle, for cameras that are right at one depth."""
PACKAGES = {"newton": "newton", "windshield": "ncore", "colmap": "pycolmap"}
"""Programs that may be missing, by the row of the table that needs them."""


def exported(calibration: Calibration, form: str, folder: Path, *words: str) -> Path:
    """Return the folder of an export."""
    saved, out = folder / f"{form}-calibration", folder / form
    calibration.save(saved)
    with redirect_stdout(StringIO()):
        assert calib(["export", str(saved), "--format", form, *words, "-o", str(out)]) == 0
    return out


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ray_cameras", description=__doc__)
    parser.add_argument("--blender", metavar="PYTHON", help="a Python with bpy 5")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="folder for the pictures")
    options = parser.parse_args()
    calibration = true_calibration()
    none = np.zeros((0, 0))
    bare = replace(calibration, cover=Cover("none", {}), relief=None, amplitudes=none)
    table = Table("camera", "RMS px", "largest px", title="From the picture through the glass")
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        picture, glass = mitsuba_pictures(exported(calibration, "mitsuba", folder))
        pictures = {"mitsuba": picture}
        pinhole, _ = mitsuba_pictures(exported(bare, "mitsuba", folder / "bare"))
        pictures["pinhole"] = pinhole
        if options.blender:
            shader = exported(calibration, "blender", folder)
            pictures["blender"] = blender_picture(shader, options.blender, BLENDER_SAMPLES)
        readers: dict[str, Callable[[], Array]] = {
            "newton": lambda: newton_picture(
                exported(calibration, "ray-image", folder, "--axes", "opengl")
            ),
            "windshield": lambda: ncore_picture(
                exported(calibration, "windshield", folder, "--depth", str(DEPTH)), DEPTH
            ),
            "colmap": lambda: colmap_picture(
                exported(calibration, "colmap", folder, "--depth", str(DEPTH)), DEPTH
            ),
        }
        pictures |= {name: draw() for name, draw in readers.items() if find_spec(PACKAGES[name])}
        splats = gsplat_picture(exported(calibration, "gsplat", folder))
    for name, rendered in pictures.items():
        table.add_row(name, *map("{:.4f}".format, _sizes(difference(rendered, glass))))
    Console().print(table)
    if options.output:
        options.output.mkdir(parents=True, exist_ok=True)
        for name, rendered in {**pictures, "gsplat": splats}.items():
            half = cv2.resize(rendered, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            levels = np.clip(np.rint(255 * half), 0, 255).astype(np.uint8)
            cv2.imwrite(str(options.output / f"ray-camera-{name}.png"), levels)


def _sizes(shift: Array) -> tuple[float, float]:
    length = np.linalg.norm(shift, axis=-1)
    return float(np.sqrt((length**2).mean())), float(length.max())


if __name__ == "__main__":
    main()
