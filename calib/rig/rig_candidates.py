"""The fitted explanations as candidates of a rig's diagnosis, and as families of those that the
placements do not tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.effects.varying import FROM_VIEW
from calib.fit_record.history import Family
from calib.inference.cross_validation import HeldOutGain
from calib.inference.naming import MIN_MEMBER_PROBABILITY, NAME_ALONE
from calib.rig.explanation_fit import FittedExplanation
from calib.rig.explanations import RigExplanation
from calib.rig.rig import Rig
from calib.rig.rig_finding import RigCandidate
from calib.rig.rig_sentences import parameters_of

ACCEPTED = "accepted"


def families_of(
    best: RigExplanation, fits_of_effects: Sequence[FittedExplanation]
) -> tuple[Family, ...]:
    """Return the family of an accepted explanation, if others are as probable.

    Args:
        fits_of_effects: its fit, and those that are less probable.
    """
    logs = np.array([fitted.log_evidence for fitted in fits_of_effects])
    odds = np.exp(logs - logs.max())
    chances = odds / odds.sum()
    if chances[0] > NAME_ALONE:
        return ()
    members: dict[str, float] = {}
    for fitted, chance in zip(fits_of_effects, chances.tolist(), strict=True):
        if chance > MIN_MEMBER_PROBABILITY:
            explanation = fitted.explanation
            name = f"{explanation.name} of {explanation.subject}"
            members[name] = members.get(name, 0.0) + chance
    if len(members) < 2:
        return ()
    assert best.effect
    return (
        Family(
            "a reason why the cameras disagree on where the board is",
            members,
            f"To separate them, {best.effect.advice}.",
        ),
    )


def candidate_of(
    rig: Rig,
    fitted: FittedExplanation,
    log_odds: float,
    gain: HeldOutGain | None,
    verdict: str,
) -> RigCandidate:
    """Return an explanation as a candidate of the diagnosis."""
    explanation = fitted.explanation
    return RigCandidate(
        effect=explanation.name,
        camera=explanation.camera,
        varies=explanation.varies or None,
        from_file=rig.placement_names[explanation.placement]
        if explanation.varies == FROM_VIEW
        else None,
        log_odds=log_odds,
        parameters=parameters_of(fitted),
        held_out_px_before=gain.base_px if gain else None,
        held_out_px_after=gain.extended_px if gain else None,
        gain_ci95=gain.ci95 if gain else None,
        p_value=gain.p_value if gain else None,
        accepted=verdict == ACCEPTED,
        verdict=verdict,
    )
