"""The tolerances of all physical quantities: how far each may deviate from its stated or nominal
value. This is the one table of the fits' priors.

The numbers that `--free` frees, the effects that the diagnosis tries, and the estimates of a board
take their standard deviations from here.
"""

from __future__ import annotations

from dataclasses import dataclass

TANGENTIAL_NAMES = ("p1", "p2")
"""The names of the tangential coefficients; all others are radial, or as loose."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The tolerance of one quantity."""

    sigma: float
    """The standard deviation of the quantity's prior."""
    unit: str
    scale: float
    """The size of a typical change; the solver divides by it."""
    reason: str


@dataclass(frozen=True, slots=True)
class WidePrior:
    """The prior of a number that nobody knows: what such numbers are in cameras and covers."""

    mean: float
    sigma: float
    """The standard deviation. The stated range is that of two of them, within the number's
    limits.
    """
    unit: str
    reason: str


RADIUS = Tolerance(2e-3, "m", 1e-3, "a calliper across a curved wall, and the draft of its mould")
RADIUS_SLOPE = Tolerance(0.02, "", 1e-2, "two millimetres of radius over a wall of a hundred")
OFFSET = Tolerance(
    2e-3,
    "m",
    1e-3,
    "the entrance pupil lies somewhere inside the lens, and a mount by hand has play",
)
DISTANCE = Tolerance(
    5e-3,
    "m",
    1e-3,
    "as an offset, along the lens, whose pupil is some millimetres behind its front",
)
COVER_TILT = Tolerance(
    0.02, "rad", 1e-2, "a bracket that was bent or drilled by hand: about a degree"
)
WEDGE = Tolerance(0.01, "rad", 1e-2, "the faces of blown or moulded glass: half a degree")
THICKNESS = Tolerance(
    5e-4,
    "m",
    1e-3,
    "cast acrylic is made to 0.4 mm and a tenth of its thickness (ISO 7823-1), at two sigma",
)
INDEX = Tolerance(
    0.02,
    "",
    1e-2,
    "acrylic 1.49, borosilicate 1.47, soda-lime 1.52; whoever does not know which is off by as"
    " much",
)
UNKNOWN_RADIUS = WidePrior(
    0.06, 0.06, "m", "tubes and domes of cameras, from the size of a lens to that of a football"
)
UNKNOWN_SLOPE = WidePrior(0.0, 0.3, "", "cones of up to 60 degrees across, narrowing either way")
UNKNOWN_OFFSET = WidePrior(
    0.0, 0.03, "m", "a camera anywhere within a cover of the size of two hands"
)
UNKNOWN_DISTANCE = WidePrior(
    0.03, 0.03, "m", "from a window on the lens to one a hand's breadth in front of it"
)
UNKNOWN_TILT = WidePrior(0.0, 0.2, "rad", "a window or a tube that leans by up to 23 degrees")
UNKNOWN_THICKNESS = WidePrior(
    0.005, 0.005, "m", "from a filter's glass to a port for deep water, 15 mm"
)
UNKNOWN_INDEX = WidePrior(1.52, 0.08, "", "plastics and glass, from 1.36 to 1.68")
UNKNOWN_OUTSIDE = WidePrior(1.17, 0.17, "", "air, 1, or water, 1.34")

GLASS_FIGURE = Tolerance(
    1e-5, "m", 1e-5, "what cheap windows are uneven by over a centimetre: some ten micrometres"
)

FOCAL = Tolerance(0.02, "", 1e-3, "of the length: a data sheet, or the same lens focused elsewhere")
PRINCIPAL_POINT = Tolerance(
    20.0, "px", 1.0, "lenses are mounted off the sensor's middle by some ten pixels, and stay there"
)
RADIAL = Tolerance(
    0.1, "", 1e-3, "lenses that are called free of distortion have coefficients up to here"
)
TANGENTIAL = Tolerance(0.01, "", 1e-3, "a lens tilted by half a degree")
THIN_PRISM = Tolerance(3e-3, "", 1e-3, "lens elements that are wedges by some minutes of arc")
SENSOR_TILT = Tolerance(0.02, "rad", 1e-3, "sensors are glued in to about a degree")

UNKNOWN_FOCAL = WidePrior(
    1.0, 0.7, "", "of the picture's longer side: lenses of 24 degrees across and more"
)
UNKNOWN_CENTRE = WidePrior(
    0.5, 0.1, "", "of the picture's longer side, about its middle: pictures cut off the middle"
)
UNKNOWN_RADIAL = WidePrior(0.0, 0.5, "", "barrel distortion that a wide lens has, and pincushion")
UNKNOWN_TANGENTIAL = WidePrior(0.0, 0.02, "", "a lens tilted by a degree")

ENTRANCE_PUPIL = Tolerance(
    5e-3,
    "m",
    1e-3,
    "at a radian off the axis: wide lenses, from some tenths to some millimetres (their length)",
)
ENTRANCE_PUPIL_ASIDE = Tolerance(
    5e-4, "m", 1e-3, "a tenth of that: lens elements are centred to some hundredths of their size"
)

BOARD_SHAPE = Tolerance(
    3e-3, "m", 1e-3, "boards of makers are bent by 0.3 to 2.5 mm (ten of seventeen measured sets)"
)
SQUARE_SIDE = Tolerance(
    2e-3, "", 1e-3, "of the side: a ruler's half millimetre over a board of 25 cm"
)
SCREEN_GLASS = Tolerance(
    2e-3, "m", 1e-4, "the glass of a laptop or tablet: 0.5 to 2 mm; of a television: up to 3 mm"
)
PRINT_STRETCH = Tolerance(
    0.01, "", 1e-3, "desktop printers stretch paper by some tenths of a per cent along its feed"
)
PRINT_SHEAR = Tolerance(
    5e-3, "rad", 1e-3, "paper that is drawn in askew: a millimetre over the length of a sheet"
)
PRINT_UNEVEN = Tolerance(
    1e-3, "", 1e-4, "of the board's half: paper that swells, shrinks or is drawn on unevenly"
)
DETECTOR = Tolerance(
    0.1, "px", 0.01, "the largest pull towards pixels' middles that corner detectors are known for"
)
BOARD_SPIN = Tolerance(
    0.05, "rad", 1e-2, "a board that a hand turns at 1.5 rad/s, over a readout of 33 ms"
)
BOARD_FLEX = Tolerance(
    5e-4,
    "m",
    1e-3,
    "what a hand that holds it adds to the bend of a board of foam, card or plywood",
)
BOARD_MOVE = Tolerance(
    0.01, "m", 1e-3, "a board that a hand moves at 0.3 m/s, over a readout of 33 ms"
)

PORT_TILT = Tolerance(
    0.1, "rad", 1e-2, "a window that nobody declared, in front of a camera that nobody aligned"
)
PORT_THICKNESS = Tolerance(5e-3, "m", 1e-3, "from a filter's glass to an aquarium's, around 6 mm")
PORT_DISTANCE = Tolerance(0.02, "m", 1e-3, "housings, around 25 mm")
WATER_INDEX = Tolerance(
    1e-3, "", 1e-2, "fresh water from cold to warm, over the spectrum of a camera"
)
ANY_WATER = Tolerance(
    4e-3, "", 1e-2, "fresh water has 1.333 and the sea 1.34; whoever writes one seldom knows which"
)
MEDIA = Tolerance(
    0.2, "", 1e-2, "half of the step from air to water, by which views in both are off their mean"
)
WATER_OVER_AIR = Tolerance(
    1e-2,
    "",
    1e-2,
    "the step of 0.333 between views in air and views in water: water has 1.333 to 1.343, air"
    " 1.0003; which of them was stated is not known",
)

OWN_FOCAL = Tolerance(
    0.05,
    "",
    1e-3,
    "of the length: hardly any limit to intrinsics that come from these same views, so that views"
    " count once",
)
OWN_CENTRE = Tolerance(100.0, "px", 1.0, "the same")
OWN_COEFFICIENT = Tolerance(
    3.0, "", 1e-3, "of the distance from the axis, at the picture's corner: the same"
)
