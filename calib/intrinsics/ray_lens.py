"""The lens models besides OpenCV's that intrinsics may have. Nothing slow is imported here."""

from dataclasses import dataclass

from calib.session.lens import FISHEYE, SPLINED


@dataclass(frozen=True, slots=True)
class RayLens:
    """A lens model that is fitted through its rays."""

    model: str
    columns: int = 0
    """Columns of control points of a spline; 0 for no spline."""

    def __str__(self) -> str:
        return f"{self.model} {self.columns}" if self.columns else self.model


PLAIN = RayLens(FISHEYE)
SPLINES = tuple(RayLens(SPLINED, columns) for columns in (6, 8, 11))
"""Splines whose control points are a third, a fifth and an eighth of the picture's width apart."""
