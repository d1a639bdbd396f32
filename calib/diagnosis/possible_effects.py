"""Whether effects that a person asks for by name can be added to a fit: known before it, from the
session and what is to be estimated.
"""

from collections.abc import Sequence

import torch

from calib.effects.effect import EffectContext
from calib.effects.registry import KINDS
from calib.errors import InputError
from calib.estimation.stated_priors import priors_of
from calib.fitting.stages import Settings, Setup
from calib.optics.build import covered_path, with_relief
from calib.optics.relief import AMPLITUDES, Relief
from calib.session.camera import Intrinsics
from calib.session.schema import Number
from calib.session.session import Session

FOUND = Number(1e3, sigma=1.0)
TO_BE_FOUND = Intrinsics(FOUND, FOUND, FOUND, FOUND)
"""In place of intrinsics that the session leaves to its pictures: estimated, whatever they are."""
RELIEF = Relief((-1.0, -1.0), (1.0, 1.0), (2, 2))
"""In place of the one that a fit makes."""


def check_possible(session: Session, settings: Settings, names: Sequence[str]) -> None:
    """Nothing, where these effects can be added one after the other to a fit with these settings.

    Raises:
        InputError: this cover or camera can have no such effect, or the fit estimates what it
            changes.
    """
    camera = session.camera
    setup = Setup(session.board, camera, camera.intrinsics or TO_BE_FOUND, session.cover).freed(
        settings
    )
    path, values = covered_path(setup.intrinsics, setup.cover)
    if path.cover:
        path, values = (
            with_relief(path, RELIEF),
            values | {AMPLITUDES: torch.zeros(RELIEF.grid, dtype=torch.float64)},
        )
    free = frozenset(priors_of(setup.intrinsics, setup.cover, path).sigmas)
    kinds = {kind.name: kind for kind in KINDS}
    for name in names:
        held, fitted = (
            kinds[name].propose(
                EffectContext(
                    session.board,
                    camera.width,
                    camera.height,
                    path,
                    values,
                    estimated,
                    camera.shutter,
                    torch.zeros(2),
                )
            )
            for estimated in (frozenset[str](), free)
        )
        if not held:
            shutter = (
                " and a global shutter" if camera.shutter and not camera.shutter.rolling else ""
            )
            raise InputError(
                f"--effects {name}: with cover.shape: {session.cover.shape}{shutter} there can be"
                f" no {name}: leave it out."
            )
        if not fitted:
            raise InputError(
                f"--effects {name}: the fit estimates what {name} would change: leave it out, or"
                " call that exact in session.yaml."
            )
        path = fitted[0].apply(path)
