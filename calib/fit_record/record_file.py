"""The record of a fit in calibration.yaml: the entries of its key `settings`, each optional."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from inspect import signature
from typing import Any, TypeVar

from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.surface_prior import Smoothness
from calib.fit_record.history import (
    DiagnosisRecord,
    DiagnosisRun,
    History,
    MediumChange,
    UpdateRecord,
)
from calib.fit_record.outcome import (
    CrossValidation,
    FitOutcome,
    FleetPriorTest,
    JointOutcome,
    Redetection,
)
from calib.fit_record.request import CommandOptions, FitRequest, Provenance, Settings

T = TypeVar("T")

_OPTIONS = ("method", "grid", "free", "steps", "exact_hit", "flat_board")
_ORIGIN = ("session", "session_sha256", "finished", "python", "machine")


def record_to_yaml(request: FitRequest, outcome: FitOutcome, history: History) -> dict[str, Any]:
    """Return the entries of a record in the order of RECORD. A field that is None has no entry."""
    settings, looks = request.settings, outcome.redetections
    entries: dict[str, Any] = {
        "method": settings and settings.method,
        "grid": settings and list(settings.grid or ()),
        "grid_held_out_px": outcome.grid_held_out_px,
        "free": settings and list(settings.free),
        "steps": settings and settings.steps,
        "exact_hit": settings and settings.exact_hit,
        "flat_board": settings and settings.flat_board,
        "intrinsics_from": outcome.intrinsics_from,
        "shape_log_odds": outcome.shape_log_odds,
        "shape_map_changes_px": outcome.shape_map_changes_px,
        "shape_camera_sigma": outcome.shape_camera_sigma,
        "rival_lens": outcome.rival_lens,
        "medium_log_odds": outcome.medium_log_odds,
        "lens_held_out_px": outcome.lens_held_out_px,
        "turned_boards": outcome.turned_boards and list(outcome.turned_boards),
        "half_turned_boards": outcome.half_turned_boards and list(outcome.half_turned_boards),
        "mixed_settings": list(outcome.mixed_settings) or None,
        "second_look": None if looks is None else [_redetection_to_yaml(look) for look in looks],
        "outlier_corners": outcome.outlier_corners,
        "view_noise": outcome.view_noise,
        "made_by": request.provenance and provenance_to_yaml(request.provenance),
        "cross_validation": outcome.cross_validation and asdict(outcome.cross_validation),
        "fleet_prior": outcome.fleet_prior and asdict(outcome.fleet_prior),
        **(_joint_to_yaml(outcome.joint) if outcome.joint else {}),
        "asked": request.command and asdict(request.command),
        "immersed": history.medium_change and asdict(history.medium_change),
        "updates": [asdict(update) for update in history.updates] or None,
        "diagnosis": history.diagnosis and dict(history.diagnosis.document),
        "diagnosed": [asdict(run) for run in history.diagnosis_runs] or None,
    }
    return {
        key: value for key, value in entries.items() if value is not None or key == "relief_prior"
    }


def record_from_yaml(entries: Mapping[str, Any]) -> tuple[FitRequest, FitOutcome, History]:
    """Return the record of entries that have the shapes of RECORD."""
    request = FitRequest(
        settings=_settings_from_yaml(entries),
        command=_optional(entries, "asked", _reader(CommandOptions)),
        provenance=_optional(entries, "made_by", _provenance_from_yaml),
    )
    outcome = FitOutcome(
        grid_held_out_px=entries.get("grid_held_out_px"),
        intrinsics_from=entries.get("intrinsics_from"),
        shape_log_odds=entries.get("shape_log_odds"),
        shape_map_changes_px=entries.get("shape_map_changes_px"),
        shape_camera_sigma=entries.get("shape_camera_sigma"),
        rival_lens=entries.get("rival_lens"),
        medium_log_odds=entries.get("medium_log_odds"),
        lens_held_out_px=entries.get("lens_held_out_px"),
        turned_boards=_optional(entries, "turned_boards", tuple),
        half_turned_boards=_optional(entries, "half_turned_boards", tuple),
        mixed_settings=tuple(entries.get("mixed_settings", ())),
        redetections=_optional(entries, "second_look", _redetections_from_yaml),
        outlier_corners=entries.get("outlier_corners"),
        view_noise=entries.get("view_noise"),
        cross_validation=_optional(entries, "cross_validation", _reader(CrossValidation)),
        fleet_prior=_optional(entries, "fleet_prior", _reader(FleetPriorTest)),
        joint=_joint_from_yaml(entries) if "sigma_px" in entries else None,
    )
    history = History(
        medium_change=_optional(entries, "immersed", _reader(MediumChange)),
        updates=tuple(map(_reader(UpdateRecord), entries.get("updates", ()))),
        diagnosis=_optional(entries, "diagnosis", DiagnosisRecord),
        diagnosis_runs=tuple(map(_reader(DiagnosisRun), entries.get("diagnosed", ()))),
    )
    return request, outcome, history


def _optional(entries: Mapping[str, Any], key: str, read: Callable[[Any], T]) -> T | None:
    return read(entries[key]) if key in entries else None


def _reader(kind: Callable[..., T]) -> Callable[[Mapping[str, Any]], T]:
    """Return a function that reads a dataclass whose fields are named like the keys."""
    names = signature(kind).parameters

    def read(entry: Mapping[str, Any]) -> T:
        values = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in entry.items()
            if name in names
        }
        return kind(**values)

    return read


def _settings_from_yaml(entries: Mapping[str, Any]) -> Settings | None:
    """Return the settings. An option that is missing beside others has its default."""
    options = {key: entries[key] for key in _OPTIONS if key in entries}
    if not options:
        return None
    settings = _reader(Settings)(options)
    folds = entries["cross_validation"]["folds"] if "cross_validation" in entries else 0
    return replace(settings, grid=settings.grid or None, folds=folds)


def provenance_to_yaml(provenance: Provenance) -> dict[str, str]:
    """Return the entry of a fit's inputs and programs."""
    origin = {key: getattr(provenance, key) for key in _ORIGIN}
    return {key: value for key, value in origin.items() if value is not None} | dict(
        provenance.packages
    )


def _provenance_from_yaml(entry: Mapping[str, str]) -> Provenance:
    origin = {key: value for key, value in entry.items() if key in _ORIGIN}
    packages = {key: value for key, value in entry.items() if key not in _ORIGIN}
    return Provenance(**origin, packages=packages)


def _redetection_to_yaml(redetection: Redetection) -> dict[str, Any]:
    return {
        "file": redetection.file,
        "found": redetection.new_corners,
        "refused": redetection.refused,
        "dropped": redetection.dropped,
    }


def _redetections_from_yaml(entries: Sequence[Mapping[str, Any]]) -> tuple[Redetection, ...]:
    return tuple(
        Redetection(
            file=entry["file"],
            new_corners=entry["found"],
            refused=entry["refused"],
            dropped=entry["dropped"],
        )
        for entry in entries
    )


def _joint_to_yaml(joint: JointOutcome) -> dict[str, Any]:
    entry = {"outcome": joint.outcome, "iterations": joint.iterations, "sigma_px": joint.sigma_px}
    if joint.log_evidence is None and joint.relief_prior is None:  # an update without a joint fit
        return entry
    prior = joint.relief_prior and {
        "height_m": joint.relief_prior.height,
        "length_of_patch": joint.relief_prior.length,
    }
    return {**entry, "log_evidence": joint.log_evidence, "relief_prior": prior}


def _joint_from_yaml(entries: Mapping[str, Any]) -> JointOutcome:
    prior = entries.get("relief_prior")
    return JointOutcome(
        outcome=entries.get("outcome", Outcome.CONVERGED.value),
        iterations=entries.get("iterations", 0),
        sigma_px=entries["sigma_px"],
        log_evidence=entries.get("log_evidence"),
        relief_prior=prior and Smoothness(prior["height_m"], prior["length_of_patch"]),
    )
