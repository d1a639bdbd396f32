"""The check, before a fit, that requested effects are possible for a session and settings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from calib.effects.effect import EffectContext, PlaceOnGlass
from calib.effects.registry import KINDS
from calib.effects.screen_glass import ScreenGlass
from calib.errors import InputError
from calib.estimation.stated_priors import priors_of
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.optics.build import covered_path, with_relief
from calib.optics.relief import AMPLITUDES, Relief
from calib.session.camera import Intrinsics
from calib.session.point_target import PointTarget
from calib.session.schema import Number
from calib.session.session import Session

ESTIMATED = Number(1e3, sigma=1.0)
ESTIMATED_INTRINSICS = Intrinsics(ESTIMATED, ESTIMATED, ESTIMATED, ESTIMATED)
"""A placeholder for intrinsics that the session does not give: all are estimated."""
RELIEF = Relief((-1.0, -1.0), (1.0, 1.0), (2, 2))
"""A placeholder for the relief of the fit."""
FLAT = PointTarget.of(np.zeros((1, 2)))
"""A flat target, which can have effects that a target in space cannot."""


def check_possible(session: Session, settings: Settings, names: Sequence[str]) -> None:
    """Check that these effects can be added one after the other to a fit with these settings.

    Raises:
        InputError: this camera or cover cannot have the effect, or the fit estimates the number
            that the effect changes.
    """
    camera = session.camera
    setup = Setup(
        session.board, camera, camera.intrinsics or ESTIMATED_INTRINSICS, session.cover
    ).with_tolerances(settings)
    path, values = covered_path(setup.intrinsics, setup.cover)
    if path.cover:
        path = with_relief(path, RELIEF)
        values = values | {AMPLITUDES: torch.zeros(RELIEF.grid, dtype=torch.float64)}
    free = frozenset(priors_of(setup.intrinsics, setup.cover, path).sigmas)
    kinds = {kind.name: kind for kind in KINDS}
    for name in names:
        context = EffectContext(
            session.board,
            camera.width,
            camera.height,
            path,
            values,
            frozenset(),
            camera.shutter,
            PlaceOnGlass((0.0, 0.0), (1.0, 1.0), 1e-3),
        )
        if not kinds[name].propose(context):
            shutter = (
                " and a global shutter" if camera.shutter and not camera.shutter.rolling else ""
            )
            setting = f"cover.shape: {session.cover.shape}{shutter}"
            if not session.board.is_flat and kinds[name].propose(replace(context, board=FLAT)):
                setting = "points that are not all in the plane z = 0"
            elif name == ScreenGlass.name:
                setting = "a printed board"
            raise InputError(
                f"--effects {name}: with {setting} there can be no {name}: leave it out."
            )
        forms = kinds[name].propose(replace(context, estimated=free))
        if not forms:
            raise InputError(
                f"--effects {name}: the fit estimates what {name} would change: leave it out, or"
                " call that exact in session.yaml."
            )
        path = forms[0].apply(path)
