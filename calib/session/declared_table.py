"""The numbers that a session declares, as a table for a notebook."""

from calib.rounding import with_sigma
from calib.session.board import Board
from calib.session.camera import COEFFICIENT, PINHOLE, Camera
from calib.session.cover import Cover
from calib.session.parameter_names import CAMERA
from calib.session.schema import UNKNOWN, Number, Quantity
from calib.table import Table, TableSection


def declared_table(name: str, board: Board, camera: Camera, cover: Cover) -> Table:
    """Return the table of a session's board, camera and cover."""
    size = f"{1e3 * board.square:g} mm"
    board_rows = [("corners", str(board))]
    if board.has_grid:
        board_rows.append((f"side of a {board.cell}", size))
    sections = (
        TableSection("board", "Board", tuple(board_rows)),
        TableSection("camera", f"Camera: {camera.width}x{camera.height} px", _camera_rows(camera)),
        TableSection("cover", f"Cover: {cover.words}", _cover_rows(cover)),
    )
    return Table(f"Session {name}", ("", "declared"), sections)


def _camera_rows(camera: Camera) -> tuple[tuple[str, str], ...]:
    intrinsics = camera.intrinsics
    if not intrinsics:
        return (("intrinsics", "not declared: estimated from pictures"),)
    pinhole = [
        (CAMERA.of(kind.key), _text(kind, getattr(intrinsics, kind.key), "px")) for kind in PINHOLE
    ]
    coefficients = [
        (CAMERA.of(name), _text(COEFFICIENT, number))
        for name, number in zip(intrinsics.names, intrinsics.distortion, strict=True)
        if number.value or number.sigma
    ]
    return (*pinhole, *coefficients)


def _cover_rows(cover: Cover) -> tuple[tuple[str, str], ...]:
    numbers = cover.numbers
    return tuple(
        (name, _text(kind.quantity, numbers[name], kind.quantity.unit[0]))
        for name, kind in cover.dimensions.items()
    )


def _text(quantity: Quantity, number: Number, unit: str = "") -> str:
    per_si = quantity.unit[1]
    if number.unknown:
        return UNKNOWN
    if number.exact:
        return f"{number.value * per_si:.6g} (exact) {unit}".rstrip()
    value, sigma = number.value * per_si, number.sigma * per_si
    text = with_sigma(value, sigma) if sigma else f"{value:.6g}"
    return f"{text} {unit}".rstrip()
