"""A small good session, and every way to spoil it that a person has thought of so far.

Tests of the commands run over the table too.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

SESSION = """\
format: 1
board: {columns: 6, rows: 5, square_mm: 20.0}
camera:
  model: drawn
  width: 320
  height: 240
  intrinsics: {fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5, distortion: [0, 0, 0, 0, 0]}
cover:
  shape: cone
  inner_radius_mm: 41.95
  radius_slope: -0.105
  axis_offset_mm: [0.0, -30.0]
  thickness_mm: 3.0
  refractive_index: 1.5
"""
WITH_CORNERS = SESSION + "corners: corners.vnl\n"
BOARD = "board: {columns: 6, rows: 5, square_mm: 20.0}"
INTRINSICS = (
    "  intrinsics: {fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5, distortion: [0, 0, 0, 0, 0]}\n"
)
CONE = SESSION[SESSION.index("  shape") :]
FLAT = "  shape: flat\n  distance_mm: 10.0\n  thickness_mm: 3.0\n  refractive_index: 1.5\n"
DOME = (
    "  shape: dome\n  inner_radius_mm: 50.0\n  centre_mm: [0, 30.0, 40.0]\n  thickness_mm: 3.0\n "
    " refractive_index: 1.5\n"
)


def checkerboard(left_edge: int, top: int) -> NDArray[np.uint8]:
    """(240, 320) a board of 6x5 inner corners, 30 px apart, squarely before the camera."""
    pixels = np.full((240, 320), 200, np.uint8)
    squares = (np.indices((6, 7)).sum(0) % 2).astype(np.uint8) * 160 + 40
    pixels[top : top + 180, left_edge : left_edge + 210] = np.kron(
        squares, np.ones((30, 30), np.uint8)
    )
    return pixels


def write_good_session(folder: Path) -> Path:
    """Three pictures through a cone, and a corners.vnl of the same three that session.yaml does not
    name.
    """
    (folder / "frames").mkdir(parents=True)
    (folder / "session.yaml").write_text(SESSION)
    lines = ["# filename x y level"]
    for name, left_edge, top in (("0000.png", 50, 30), ("0001.jpg", 80, 40), ("0002.png", 30, 20)):
        cv2.imwrite(str(folder / "frames" / name), checkerboard(left_edge, top))
        lines += [
            f"{name} {left_edge + 30 * column + 29.5} {top + 30 * row + 29.5} 0"
            for row in range(1, 6)
            for column in range(1, 7)
        ]
    (folder / "corners.vnl").write_text("\n".join(lines) + "\n")
    return folder


@dataclass(frozen=True, slots=True)
class Malformed:
    """One way to spoil the good session, and what must be said about it."""

    name: str
    spoil: Callable[[Path], object]
    says: tuple[str, ...]
    exit_code: int = 2
    is_extra: bool = False
    """A fit leaves the damaged picture out, beside as many good ones as before."""


def _replace(file: str, old: str, new: str, count: int = 1) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text, f"{old!r} is not in the good {file}"
        (folder / file).write_text(text.replace(old, new, count))

    return spoil


def _yaml(old: str, new: str) -> Callable[[Path], None]:
    return _replace("session.yaml", old, new)


def _write(file: str, data: str | bytes) -> Callable[[Path], object]:
    return lambda folder: (folder / file).write_bytes(
        data.encode() if isinstance(data, str) else data
    )


def _folder_instead(folder: Path) -> None:
    (folder / "session.yaml").unlink()
    (folder / "session.yaml").mkdir()


def _halve(folder: Path) -> None:
    cv2.imwrite(str(folder / "frames" / "0001.jpg"), checkerboard(50, 30)[::2])


def _repeat_corners(folder: Path) -> None:
    text = (folder / "corners.vnl").read_text()
    (folder / "corners.vnl").write_text(text + text)


def _cut(file: str, keep: float) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        data = (folder / file).read_bytes()
        (folder / file).write_bytes(data[: int(len(data) * keep)])

    return spoil


def _array(array: NDArray) -> Callable[[Path], None]:
    return lambda folder: np.save(folder / "frames" / "0003.npy", array)


def _with_corners(spoil: Callable[[Path], object]) -> Callable[[Path], None]:
    def both(folder: Path) -> None:
        (folder / "session.yaml").write_text(WITH_CORNERS)
        spoil(folder)

    return both


def _corners(old: str, new: str) -> Callable[[Path], None]:
    return _with_corners(_replace("corners.vnl", old, new))


def _bare(session: str | None) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        (folder / "bare").mkdir()
        if session:
            shutil.copytree(folder / "frames", folder / "bare" / "frames")
            (folder / "bare" / "session.yaml").write_text(session)

    return spoil


def _lens(first: str, last: str) -> Callable[[Path], None]:
    """The intrinsics as those of a lens with four coefficients, and with something before and
    behind its numbers.
    """
    return _yaml(
        INTRINSICS,
        INTRINSICS.replace("{fx", f"{{{first}, fx").replace(
            "[0, 0, 0, 0, 0]}", f"[0, 0, 0, 0]{last}}}"
        ),
    )


def _correlated(rows: str) -> Callable[[Path], None]:
    return _yaml(
        "distortion: [0, 0, 0, 0, 0]}", f"distortion: [0, 0, 0, 0, 0], correlations: {rows}}}"
    )


UNCORRELATED = str([[0] * row for row in range(1, 9)])
UNSEEN = "# filename x y level\na - - -\nb - - -\n"
FIRST_CORNER = "0000.png 109.5 89.5 0"

MALFORMED: tuple[Malformed, ...] = (
    Malformed("no folder", shutil.rmtree, ("does not exist", "folder of a session")),
    Malformed(
        "no session.yaml",
        lambda f: (f / "session.yaml").unlink(),
        ("no session.yaml", "{format: 1, board: {"),
    ),
    Malformed("session.yaml is a folder", _folder_instead, ("cannot be read",)),
    Malformed("session.yaml is empty", _write("session.yaml", ""), ("session.yaml is empty",)),
    Malformed(
        "session.yaml is a list",
        _write("session.yaml", "- format: 1\n"),
        ("session.yaml is not a mapping",),
    ),
    Malformed("yaml syntax", _yaml("rows: 5,", "rows: 5,,"), ("session.yaml, line 2",)),
    Malformed(
        "yaml tag",
        _yaml("model: drawn", "model: !!python/name:os.system"),
        ("session.yaml, line 4", "constructor"),
    ),
    Malformed(
        "yaml scalar", _yaml("columns: 6", "columns: !!int six"), ("session.yaml is not YAML",)
    ),
    Malformed(
        "not UTF-8",
        _write("session.yaml", SESSION.replace("drawn", "Kamera für Wasser").encode("latin-1")),
        ("not UTF-8",),
    ),
    Malformed(
        "duplicate key",
        _yaml("  width: 320\n", "  width: 320\n  width: 640\n"),
        ("session.yaml, line 6", '"width" comes twice, first in line 5: remove one'),
    ),
    Malformed(
        "tab", _yaml("  width", "\twidth"), ("line 5: found character", "indent the line by blanks")
    ),
    Malformed(
        "two documents",
        _write("session.yaml", f"---\n{SESSION}---\na: 1"),
        ("remove the line ---",),
    ),
    Malformed(
        "format of the future",
        _yaml("format: 1", "format: 2"),
        ("format is 2: write 1", "this version"),
    ),
    Malformed("format in quotes", _yaml("t: 1", "t: '1'"), ("write 1 without quotes.",)),
    Malformed("format missing", _yaml("format: 1\n", ""), ("format is missing: write 1",)),
    Malformed(
        "unknown key",
        _yaml("format: 1", "format: 1\nauthor: me"),
        ("author is not a known key", "format, board, camera, cover"),
    ),
    Malformed(
        "unknown board key",
        _yaml("columns: 6", "colour: 6"),
        ("board.colour is not a known key", "columns, rows, square_mm"),
    ),
    Malformed(
        "typing error in a key",
        _yaml("columns: 6", "colums: 6"),
        ("board.colums", "did you mean columns?"),
    ),
    Malformed(
        "unknown camera key", _yaml("model:", "modle:"), ("camera.modle", "did you mean model?")
    ),
    Malformed(
        "unknown intrinsics key",
        _yaml("fx:", "f:"),
        ("camera.intrinsics.f is not", "fx, fy, cx, cy, distortion"),
    ),
    Malformed(
        "unknown cover key",
        _yaml("thickness_mm", "thickness"),
        ("cover.thickness is not a key of the shape cone", "thickness_mm?"),
    ),
    Malformed(
        "key of another shape",
        _yaml(CONE, FLAT + "  inner_radius_mm: 40.0\n"),
        ("inner_radius_mm", "shape flat", "distance_mm"),
    ),
    Malformed(
        "bad shape",
        _yaml("shape: cone", "shape: cylindre"),
        ("cover.shape", "cylindre", "cylinder"),
    ),
    Malformed("shape in capitals", _yaml(": cone", ": DOM"), ("write dome, or one of none",)),
    Malformed("key in capitals", _yaml("shape:", "Shape:"), ("write it in small letters, shape",)),
    Malformed("shape missing", _yaml("  shape: cone\n", ""), ("cover.shape is missing", "dome")),
    Malformed(
        "key missing",
        _yaml("square_mm: 20.0", ""),
        ("board.square_mm is missing", "millimetres"),
    ),
    Malformed(
        "neither number nor unknown",
        _yaml("inner_radius_mm: 41.95", "inner_radius_mm: unknwon"),
        ('cover.inner_radius_mm is the text "unknwon"', "in millimetres, or unknown"),
    ),
    Malformed(
        "unknown where it must be known",
        _yaml("square_mm: 20.0", "square_mm: unknown"),
        ('board.square_mm is the text "unknown"', "write a number"),
    ),
    Malformed(
        "unknown beside another cover",
        _yaml("cover:\n" + CONE, "cover: [{shape: unknown}, {shape: flat}]\n"),
        ("cover[0].shape", "cone, cylinder, flat, dome"),
    ),
    Malformed("section missing", _yaml(BOARD + "\n", ""), ("board is missing", "square_mm: 25.0")),
    Malformed(
        "section is text", _yaml(BOARD, "board: 6x5"), ('board is the text "6x5"', "mapping")
    ),
    Malformed(
        "columns not whole",
        _yaml("columns: 6", "columns: 6.5"),
        ("board.columns is 6.5: write a whole number",),
    ),
    Malformed(
        "too few rows",
        _yaml("rows: 5", "rows: 2"),
        ("board.rows is 2: write a whole number from 3",),
    ),
    Malformed("columns true", _yaml("columns: 6", "columns: true"), ("board.columns is true",)),
    Malformed(
        "number false",
        _yaml("radius_slope: -0.105", "radius_slope: false"),
        ("cover.radius_slope is false",),
    ),
    Malformed("width zero", _yaml("width: 320", "width: 0"), ("camera.width is 0",)),
    Malformed(
        "width absurd", _yaml("width: 320", f"width: {'9' * 5000}"), ("camera.width is inf",)
    ),
    Malformed(
        "model is a number",
        _yaml("model: drawn", "model: 2.1"),
        ("camera.model is 2.1", "in quotes"),
    ),
    Malformed(
        "square negative",
        _yaml("square_mm: 20.0", "square_mm: -20.0"),
        ("board.square_mm is -20.0", "millimetres"),
    ),
    Malformed(
        "square in metres",
        _yaml("square_mm: 20.0", "square_mm: 0.02"),
        ("board.square_mm is 0.02", "metres were meant, is 20"),
    ),
    Malformed(
        "square less than sure",
        _yaml("square_mm: 20.0", "square_mm: {value: 20.0, sigma: -1.0}"),
        ("board.square_mm.sigma is -1.0", "a number above 0"),
    ),
    Malformed(
        "thickness in metres",
        _yaml("thickness_mm: 3.0", "thickness_mm: 0.003"),
        ("cover.thickness_mm is 0.003", "millimetres"),
    ),
    Malformed(
        "index below one",
        _yaml("refractive_index: 1.5", "refractive_index: 0.9"),
        ("cover.refractive_index is 0.9", "from 1 to 3"),
    ),
    Malformed(
        "tilt too large",
        _yaml(CONE, CONE + "  tilt_deg: [0, 90.0]\n"),
        ("tilt_deg[1] is 90.0: write a number from -45 to 45",),
    ),
    Malformed(
        "number nan",
        _yaml("thickness_mm: 3.0", "thickness_mm: .nan"),
        ("cover.thickness_mm is nan",),
    ),
    Malformed("number infinite", _yaml("cx: 159.5", "cx: .inf"), ("camera.intrinsics.cx is inf",)),
    Malformed(
        "number in quotes",
        _yaml("square_mm: 20.0", 'square_mm: "20.0"'),
        ("board.square_mm", "drop the quotes"),
    ),
    Malformed(
        "number empty",
        _yaml("thickness_mm: 3.0", "thickness_mm:"),
        ("cover.thickness_mm is empty",),
    ),
    Malformed(
        "list too short",
        _yaml("[0.0, -30.0]", "[-30.0]"),
        ("cover.axis_offset_mm is a list of 1", "[x, z]"),
    ),
    Malformed(
        "sigma missing",
        _yaml("thickness_mm: 3.0", "thickness_mm: {value: 3.0}"),
        ("cover.thickness_mm.sigma is missing",),
    ),
    Malformed(
        "sigma negative",
        _yaml("fx: 300.0", "fx: {value: 300.0, sigma: -1}"),
        ("camera.intrinsics.fx.sigma is -1", "above 0"),
    ),
    Malformed(
        "exact is no truth value",
        _yaml("thickness_mm: 3.0", "thickness_mm: {value: 3.0, exact: 1}"),
        ("thickness_mm.exact is 1",),
    ),
    Malformed(
        "exact with a sigma",
        _yaml("thickness_mm: 3.0", "thickness_mm: {value: 3.0, sigma: 0.1, exact: true}"),
        ("cover.thickness_mm.sigma is 0.1: write 0, or drop it, as the number is exact",),
    ),
    Malformed(
        "value missing",
        _yaml("thickness_mm: 3.0", "thickness_mm: {sigma: 3.0}"),
        ("cover.thickness_mm.value is missing",),
    ),
    Malformed(
        "sigma misspelt",
        _yaml("[0.0, -30.0]", "[0.0, {value: -30.0, sgima: 1}]"),
        ("cover.axis_offset_mm[1].sgima", "sigma?"),
    ),
    Malformed(
        "three coefficients",
        _yaml("[0, 0, 0, 0, 0]", "[0, 0, 0]"),
        ("distortion is a list of 3", "0, 4, 5, 8, 12, 14"),
    ),
    Malformed(
        "more pixels than a sensor has",
        _yaml("width: 320\n  height: 240", "width: 100000\n  height: 100000"),
        ("camera.height is 100000", "100000x100000 px are more"),
    ),
    Malformed(
        "shutter",
        _yaml("  width", "  shutter: rolling\n  width"),
        ("camera.shutter is", "{type: rolling, readout_ms: 30}"),
    ),
    Malformed(
        "shutter type",
        _yaml("  width", "  shutter: {type: roling}\n  width"),
        ("camera.shutter.type is", "rolling or global"),
    ),
    Malformed(
        "readout",
        _yaml("  width", "  shutter: {type: rolling, readout_ms: -3}\n  width"),
        ("readout_ms is -3", "from 0.01 to 1000"),
    ),
    Malformed(
        "global readout",
        _yaml("  width", "  shutter: {type: global, readout_ms: 3}\n  width"),
        ("readout_ms is 3", "drop the key"),
    ),
    Malformed(
        "lens",
        _yaml("  width", "  lens: fishy\n  width"),
        ("camera.lens is", "one of auto, opencv, fisheye"),
    ),
    Malformed(
        "lens against lens_coefficients",
        _yaml("  width", "  lens: fisheye\n  lens_coefficients: 8\n  width"),
        ("camera.lens_coefficients is 8", "lens is fisheye"),
    ),
    Malformed(
        "lens against intrinsics",
        _yaml("  width", "  lens: fisheye\n  width"),
        ("camera.lens", "opencv, the model of camera.intr"),
    ),
    Malformed(
        "intrinsics model",
        _yaml("{fx", "{model: equidistant, fx"),
        ("intrinsics.model", "one of opencv, fisheye"),
    ),
    Malformed(
        "spline of a fisheye",
        _lens("model: fisheye", ", spline: 3"),
        ("intrinsics.spline is 3", "a lens of the model fisheye"),
    ),
    Malformed(
        "spline missing",
        _lens("model: splined", ""),
        ("intrinsics.spline is missing", "{columns: 8, rows: 6"),
    ),
    Malformed(
        "spline of too few",
        _lens("model: splined", ", spline: {columns: 4, rows: 4, x_px: [0], y_px: [0]}"),
        ("intrinsics.spline.x_px is a list of 1", "a list of 16 numbers"),
    ),
    Malformed(
        "spline of one row",
        _lens("model: splined", ", spline: {columns: 4, rows: 1, x_px: [0], y_px: [0]}"),
        ("intrinsics.spline.rows is 1", "from 4 to 100"),
    ),
    Malformed(
        "fisheye coefficients",
        _yaml("{fx", "{model: fisheye, fx"),
        ("intrinsics.distortion", "4 numbers in cv2.fisheye"),
    ),
    Malformed(
        "lens_coefficients",
        _yaml("  width", "  lens_coefficients: 6\n  width"),
        ("camera.lens_coefficients is 6", "4, 5, 8"),
    ),
    Malformed(
        "camera outside the cone",
        _yaml("-30.0", "-42.0"),
        ("cover.axis_offset_mm", "outside the cone", "41.95 mm"),
    ),
    Malformed(
        "camera outside the dome",
        _yaml(CONE, DOME),
        ("cover.centre_mm", "outside the dome", "50 mm"),
    ),
    Malformed(
        "correlations of others",
        _correlated("[[0.9], [0, 0]]"),
        ("camera.intrinsics.correlations is a list of 2", "8 rows"),
    ),
    Malformed(
        "correlations a number",
        _correlated("0.9"),
        ("camera.intrinsics.correlations is 0.9", "8 rows"),
    ),
    Malformed(
        "correlation above one",
        _correlated(UNCORRELATED.replace("[0]", "[1.5]")),
        ("camera.intrinsics.correlations[0][0] is 1.5", "from -1 to 1"),
    ),
    Malformed(
        "correlations that cannot be",
        _correlated(UNCORRELATED.replace("[0], [0, 0]", "[0.9], [0.9, -0.9]")),
        ("camera.intrinsics.correlations is a list of 8", "positive definite"),
    ),
    Malformed(
        "splined lens, no bare",
        _yaml(INTRINSICS, "  lens: splined\n"),
        ("camera.lens is splined", "bare"),
    ),
    Malformed("bare is empty", _bare(None), ("bare has neither pictures nor a session.yaml",)),
    Malformed("bare has a cover", _bare(SESSION), ("cover.shape is cone: write none",)),
    Malformed(
        "bare of another size",
        _bare(SESSION.replace("320", "640").replace(CONE, "  shape: none\n")),
        ("640x240", "write 320x240"),
    ),
    Malformed(
        "no frames",
        lambda f: shutil.rmtree(f / "frames"),
        ("has no pictures", "corners: corners.vnl", "frames"),
    ),
    Malformed(
        "pictures of another size",
        _yaml("width: 320", "width: 640"),
        ("0000.png is 320x240", "640x240"),
    ),
    Malformed("mixed sizes", _halve, ("0001.jpg is 320x120",)),
    Malformed("truncated jpg", _cut("frames/0001.jpg", 0.9), ("0001.jpg is truncated",)),
    Malformed("truncated png", _cut("frames/0002.png", 0.9), ("0002.png is truncated",)),
    Malformed(
        "text named png", _write("frames/0002.png", "not a picture"), ("0002.png is not an image",)
    ),
    Malformed(
        "empty picture",
        _write("frames/0002.png", ""),
        ("0002.png is an empty file",),
    ),
    Malformed(
        "float npy", _array(np.zeros((240, 320))), ("0003.npy", "float64", "uint8"), is_extra=True
    ),
    Malformed(
        "pickled npy",
        _array(np.array([[None]], dtype=object)),
        ("0003.npy is not a whole .npy array",),
        is_extra=True,
    ),
    Malformed(
        "npy of five channels",
        _array(np.zeros((240, 320, 5), np.uint8)),
        ("0003.npy", "(240, 320, 5)"),
        is_extra=True,
    ),
    Malformed(
        "dangling link",
        lambda f: (f / "frames" / "0003.npy").symlink_to("gone.npy"),
        ("0003.npy", "cannot be read"),
        is_extra=True,
    ),
    Malformed(
        "corners missing",
        _with_corners(lambda f: (f / "corners.vnl").unlink()),
        ("corners names", "corners.vnl", "not a file"),
    ),
    Malformed(
        "corners is a list",
        _yaml("format: 1", "format: 1\ncorners: [corners.vnl]"),
        ("corners is a list of 1",),
    ),
    Malformed(
        "corners empty",
        _with_corners(_write("corners.vnl", "# filename x y level\n")),
        ("corners.vnl has no corners",),
    ),
    Malformed(
        "corners not text",
        _with_corners(_write("corners.vnl", b"\xff\xfe\x00")),
        ("corners.vnl is not a UTF-8",),
    ),
    Malformed(
        "corners without legend",
        _corners("# filename x y level\n", ""),
        ("corners.vnl, line 1", '"# filename x y level"'),
    ),
    Malformed(
        "corners nan",
        _corners(FIRST_CORNER, "0000.png nan 89.5 0"),
        ("corners.vnl, line 2", 'x is "nan"'),
    ),
    Malformed(
        "corners text",
        _corners(FIRST_CORNER, "0000.png 109.5 high 0"),
        ("corners.vnl, line 2", 'y is "high"'),
    ),
    Malformed(
        "corners half seen",
        _corners(FIRST_CORNER, "0000.png 109.5 - 0"),
        ("corners.vnl, line 2", "only one of x and y"),
    ),
    Malformed(
        "corners without level",
        _corners(FIRST_CORNER, "0000.png 109.5 89.5"),
        ("corners.vnl, line 2 has 3 columns: write 4",),
    ),
    Malformed(
        "corners of another board",
        _corners(FIRST_CORNER + "\n", ""),
        ("corners.vnl, line 2", "29 of the 30 lines"),
    ),
    Malformed(
        "corners out of order",
        _corners(FIRST_CORNER, "0002.png 109.5 89.5 0"),
        ("0002.png has 1 of the 30 lines",),
    ),
    Malformed(
        "corners twice",
        _with_corners(_repeat_corners),
        ("corners.vnl, line 93", "0000.png comes a second"),
    ),
    Malformed(
        "no board seen",
        _with_corners(_write("corners.vnl", UNSEEN)),
        ("none with a board",),
        exit_code=3,
    ),
)
"""Every malformed session that the commands must refuse, with the exit code and pieces of the
sentence.
"""
