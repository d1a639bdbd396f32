"""The shapes of the entries that a record has in calibration.yaml."""

from collections.abc import Mapping

from calib.io.shapes import (
    Shape,
    choice,
    count,
    either,
    flag,
    many,
    maybe,
    number,
    positive,
    record,
    table,
    text,
)
from calib.session.freeing import option_names

_QUALITY = record({"rms_px": number, "rmse_cm": number, "held_out_px": number})
_FAMILY = record({"name": text, "members": table(number), "experiment": text})
_ESTIMATES = table(record({"value": number, "sigma": number, "unit": text}))
_CANDIDATE = record(
    {
        "effect": text,
        "accepted": flag,
        "held_out_px_before": maybe(number),
        "held_out_px_after": maybe(number),
        "parameters": _ESTIMATES,
    },
    {"varies": maybe(text), "spread": _ESTIMATES, "from_file": maybe(text)},
)
RECORD: Mapping[str, Shape] = {
    "method": choice("joint", "paper"),
    "grid": either(many(count, of=2), many(count, of=0)),
    "grid_held_out_px": table(number),
    "free": many(lambda value, where: choice(*option_names())(value, where)),
    "steps": count,
    "exact_hit": flag,
    "flat_board": flag,
    "intrinsics_from": choice("session.yaml", "bare", "prior", "views"),
    "shape_log_odds": table(number),
    "shape_map_changes_px": table(number),
    "shape_camera_sigma": table(number),
    "rival_lens": table(number),
    "medium_log_odds": table(number),
    "lens_held_out_px": table(number),
    "turned_boards": many(text),
    "half_turned_boards": many(text),
    "mixed_settings": many(text),
    "second_look": many(record({"file": text, "found": count, "refused": count, "dropped": count})),
    "outlier_corners": table(count),
    "view_noise": table(positive),
    "made_by": table(text),
    "cross_validation": record(
        {"folds": count, "held_out_px": number, "fitted_px": number}, {"held_out_sigma_px": number}
    ),
    "fleet_prior": record(
        {
            "file": text,
            "sha256": text,
            "cameras": count,
            "used": flag,
            "p_value": number,
            "farthest": text,
            "farthest_sigmas": number,
        }
    ),
    "outcome": text,
    "iterations": count,
    "sigma_px": positive,
    "log_evidence": number,
    "relief_prior": maybe(record({"height_m": positive, "length_of_patch": positive})),
    "asked": record({}, {"effects": many(text), "depths": many(number)}),
    "immersed": record(
        {"from_index": number, "to_index": number, "sigma": number, "calibration": text}
    ),
    "updates": many(
        record(
            {
                "calibration_sha256": text,
                "finished": text,
                "answer": text,
                "views": many(text),
                "change": text,
                "moved_sigmas": table(number),
            }
        )
    ),
    "diagnosis": record(
        {"candidates": many(_CANDIDATE)},
        {"before": _QUALITY, "after": _QUALITY, "families": many(_FAMILY), "remarks": many(text)},
    ),
    "diagnosed": many(record({"calibration": text, "holdout": text})),
}
"""The shape of each entry, in the order of the file."""
