"""Words for the entries of calibration.yaml's key `settings`, which a report lists."""

from collections.abc import Mapping

WORDS: Mapping[str, str] = {
    "method": "method of the fit",
    "grid": "points of the uneven surface, around and along",
    "grid_held_out_px": "held-out error with this grid, px",
    "free": "declared numbers that the fit may change",
    "steps": "steps of the paper's method",
    "exact_hit": "uneven glass moves where rays meet it",
    "flat_board": "the board counts as flat",
    "intrinsics_from": "first lens numbers from",
    "shape_log_odds": "log odds of this shape",
    "shape_map_changes_px": "change of the maps with this shape, px",
    "shape_camera_sigma": "sigma over all likely shapes or lenses, px",
    "rival_lens": "another lens with which even glass fits, px",
    "medium_log_odds": "log odds of this medium",
    "lens_held_out_px": "held-out error with this lens, px",
    "turned_boards": "boards turned by a quarter turn",
    "half_turned_boards": "boards turned by half a turn",
    "mixed_settings": "settings that differ between pictures",
    "outlier_corners": "corners that the fit leaves out",
    "second_look": "second look for corners",
    "second_look file": "second look: picture",
    "second_look found": "second look: corners added",
    "second_look refused": "second look: expected corners not seen",
    "second_look dropped": "second look: corners dropped",
    "view_noise": "noise over that of the median picture",
    "made_by": "made by",
    "cross_validation": "cross-validation",
    "cross_validation folds": "cross-validation: parts",
    "cross_validation held_out_px": "cross-validation: held-out error, px",
    "cross_validation fitted_px": "cross-validation: fitted error, px",
    "cross_validation held_out_sigma_px": "cross-validation: sigma of the held-out error, px",
    "fleet_prior": "prior of the fleet",
    "fleet_prior file": "prior of the fleet: file",
    "fleet_prior sha256": "prior of the fleet: SHA-256",
    "fleet_prior cameras": "prior of the fleet: cameras",
    "fleet_prior used": "prior of the fleet: used",
    "fleet_prior p_value": "prior of the fleet: p value",
    "fleet_prior farthest": "prior of the fleet: farthest number",
    "fleet_prior farthest_sigmas": "prior of the fleet: how far, sigmas",
    "outcome": "how the fit ended",
    "iterations": "steps of the fit",
    "sigma_px": "noise in x and in y that the fit weights corners with, px",
    "log_evidence": "log evidence of the model",
    "relief_prior": "prior of the uneven surface",
    "relief_prior height_m": "height of the uneven surface, m",
    "relief_prior length_of_patch": "length of its waves, in sides of its patch",
    "asked": "options of the command",
    "immersed": "change of the medium",
    "immersed from_index": "change of the medium: index from",
    "immersed to_index": "change of the medium: index to",
    "immersed sigma": "change of the medium: sigma of the index",
    "immersed calibration": "change of the medium: SHA-256 before",
    "updates": "update",
    "updates calibration_sha256": "update: SHA-256 before",
    "updates finished": "update: time",
    "updates answer": "update: answer of the check",
    "updates views": "update: pictures",
    "updates change": "update: what changed",
    "updates moved_sigmas": "update: shift, in sigmas, of",
    "diagnosis": "result of the diagnosis",
    "diagnosed": "diagnosed from",
    "refracal": "version of Refracal",
    "session_sha256": "SHA-256 of the session",
    "finished": "time of the fit",
    "python": "version of Python",
    "machine": "system and processor",
    "calibration_sha256": "SHA-256 of calibration.npz",
}
"""For the keys of an entry, with a space between them and without the numbers of list entries."""


def words_for(name: str) -> str:
    """Return words for an entry that `flat_rows` names; the name itself if there are none.

    The number of a list entry stands before the colon. A key that depends on the session, such as
    a file's name, follows the words.
    """
    path, *keys = name.split(" ")
    number = ""
    names: list[str] = []
    for key in keys:
        if f"{path} {key}" in WORDS:
            path = f"{path} {key}"
        elif key.isdigit() and not number and not names:
            number = f" {key}"
        else:
            names.append(key)
    subject, colon, predicate = WORDS.get(path, path).partition(":")
    return " ".join([f"{subject}{number}{colon}{predicate}", *names])
