"""The pictures in bare/ show the camera through its cover: then the lens that they gave has the
cover in it already.
"""

from collections.abc import Iterator

import numpy as np

from calib.verdict.case import Case
from calib.verdict.thresholds import EXPLAINED, WORSE_THAN_BARE
from calib.verdict.verdict import Reason


def bare_pictures(case: Case) -> Iterator[Reason]:
    if taken_through_cover(case):
        bare, cover = (case.rms_px[name] for name in ("pinhole", "cover"))
        said = (
            f"the camera alone explains the pictures through the cover ({bare:.3f} px) better than"
            f" the cover does ({cover:.3f} px): were the pictures in bare/ taken with the cover on?"
            " Take them anew without it, or else check the cover's numbers."
        )
        yield Reason(
            said, case.next.capture(), ("camera.fx", "camera.fy", "camera.cx", "camera.cy")
        )


def taken_through_cover(case: Case) -> bool:
    """Whether the lens of bare/ leaves hardly more than noise of pictures in which the cover, as it
    is described, would be seen.
    """
    cover, bare = (case.rms_px.get(name, np.nan) for name in ("cover", "pinhole"))
    alone = bare <= EXPLAINED * case.calibration.noise_px
    return bool(
        case.calibration.settings.get("intrinsics_from") == "bare"
        and alone
        and cover > WORSE_THAN_BARE * bare
    )
