"""The 45 pictures of Table 1, rendered once by Mitsuba and kept in out/, which git ignores."""

from collections.abc import Callable
from pathlib import Path

from fixtures.render import STRONG, Session, render

CACHE = Path("out")
VIEWS = 45

REAL = Session("paper-real", seed=45, views=VIEWS, depths=(0.60, 1.20), relief=STRONG)
"""The glass of the fixture `bumps`: 3 mm thick, a 4x4 relief with amplitudes of 30 um, sigma 7.5
um.
"""


def pictures(tick: Callable[[], None]) -> Path:
    """The session's folder; rendered first where it is not there, with `tick` after each
    picture.
    """
    folder = CACHE / REAL.name
    if not (folder / "truth.npz").exists():  # the last file that render writes
        render(REAL, CACHE, tick)
    return folder
