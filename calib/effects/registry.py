"""The registry of all effects: a new effect is a file of its own and a line here."""

from calib.effects.board_flex import BoardFlex
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.cover_offset import CoverOffset
from calib.effects.cover_radius import CoverRadius
from calib.effects.cover_tilt import CoverTilt
from calib.effects.detector_bias import DetectorBias
from calib.effects.effect import Effect
from calib.effects.entrance_pupil import EntrancePupil
from calib.effects.fine_surface import FineSurface
from calib.effects.flat_port import FlatPort
from calib.effects.focal import Focal
from calib.effects.free_field import FreeField
from calib.effects.inner_surface import InnerSurface
from calib.effects.lens import LensEffect
from calib.effects.lens_field import LensField
from calib.effects.principal_point import PrincipalPoint
from calib.effects.refractive_index import RefractiveIndex
from calib.effects.rolling_shutter import RollingShutter
from calib.effects.screen_glass import ScreenGlass
from calib.effects.thickness import Thickness
from calib.effects.varying import FocalOfView, PrincipalPointOfView
from calib.effects.wedge import Wedge

EFFECTS: tuple[type[Effect], ...] = (
    LensEffect,
    EntrancePupil,
    PrincipalPoint,
    Focal,
    RollingShutter,
    FlatPort,
    CoverTilt,
    CoverOffset,
    CoverRadius,
    Thickness,
    RefractiveIndex,
    Wedge,
    InnerSurface,
    FineSurface,
    BoardShape,
    BoardFlex,
    BoardScale,
    ScreenGlass,
    DetectorBias,
)
"""The effects with a physical cause, in the order of a ray's way, in which reports list them."""

FIELDS: tuple[type[Effect], ...] = (LensField, FreeField)
"""Effects without a cause, which the diagnosis tries if no other effect helps and the residual
still has a structure: they can imitate many other effects.
"""

KINDS: tuple[type[Effect], ...] = (*EFFECTS, *FIELDS)
"""The effects that commands know by their names."""

OF_VIEW: tuple[type[Effect], ...] = (FocalOfView, PrincipalPointOfView)
"""Effects that give every view the numbers that another effect of the same name changes in all
views alike. The diagnosis proposes them where that is what most probably differs.
"""
