"""The dimensions of the glass, which covers of every shape have."""

from calib.session.schema import Quantity
from calib.session.shapes.dimension import Dimension
from calib.session.tolerances import (
    INDEX,
    THICKNESS,
    UNKNOWN_INDEX,
    UNKNOWN_OUTSIDE,
    UNKNOWN_THICKNESS,
)

LAYER = (
    Dimension(
        Quantity("thickness_mm", low=0.05, high=1e4, wide=UNKNOWN_THICKNESS),
        words="the glass's thickness",
        explanation="Thickness in mm. For laminated glass use `layers`.",
        typed_explanation=(
            "Thickness in mm; of laminated glass that of each layer, from the inside out."
        ),
        tolerance=THICKNESS,
        option="thickness",
        effect="thickness",
    ),
    Dimension(
        Quantity("refractive_index", low=1, high=3, wide=UNKNOWN_INDEX),
        words="the glass's refractive index",
        explanation=(
            "Refractive index: glass 1.52, acrylic 1.49, polycarbonate 1.585. For laminated glass"
            " use `layers`."
        ),
        typed_explanation=(
            "Refractive index: glass 1.52, acrylic 1.49, polycarbonate 1.585; of laminated glass"
            " that of each layer."
        ),
        tolerance=INDEX,
        option="index",
        effect="refractive_index",
        usual="1.5",
    ),
)
OUTSIDE = Dimension(
    Quantity("outside_index", low=1, high=3, default=1.0, wide=UNKNOWN_OUTSIDE),
    words="the index of what is outside",
    explanation=(
        "Refractive index of what is outside: 1 in air, 1.333 in water. That of water is taken to"
        " be within 0.004."
    ),
    typed_explanation="Refractive index of what is outside: 1 in air, 1.333 in water.",
)
"""The medium outside of the glass. Air is exact, and water has a tolerance
(`calib.session.freeing`).
"""
AIR, WATER = "air", "water"
MEDIA = {AIR: 1.0, WATER: 1.333}
"""The index of each medium that a camera may look into."""
HALFWAY = 1.17
"""The index from which a medium counts as water."""


def medium_word(index: float) -> str:
    """Return which of MEDIA an index belongs to."""
    return WATER if index > HALFWAY else AIR


def opposite_medium(index: float) -> str:
    """Return the one of MEDIA that an index does not belong to."""
    return AIR if medium_word(index) == WATER else WATER
