"""The lenses other than OpenCV's that intrinsics may have. Nothing slow is imported here."""

from dataclasses import dataclass

from calib.session.lens import FISHEYE, SPLINED


@dataclass(frozen=True, slots=True)
class RayLens:
    """A lens that is fitted by its rays."""

    model: str
    columns: int = 0
    """Of a spline's control points."""

    def __str__(self) -> str:
        return f"{self.model} {self.columns}" if self.columns else self.model


PLAIN = RayLens(FISHEYE)
SPLINES = tuple(RayLens(SPLINED, columns) for columns in (6, 8, 11))
"""Control points a third, a fifth and an eighth of the picture's width apart."""
