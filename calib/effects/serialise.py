"""Functions that turn effects into the mappings of a calibration file, and back."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from calib.effects.effect import Effect
from calib.effects.registry import KINDS, OF_VIEW
from calib.effects.varying import MANNERS, Varying

Estimated = Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
"""A value and its standard deviation, by the parameter's name."""


def effect_to_yaml(effect: Effect, parameters: Estimated) -> dict[str, object]:
    """Return the mapping that `effect_from_yaml` reads."""
    units = {parameter.param.name: parameter.param.unit for parameter in effect.effect_parameters}
    return {
        "name": effect.name,
        "varies": effect.varies,
        "form": {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(effect).items()  # type: ignore[call-overload]
        },
        "parameters": {
            name: {"value": value.tolist(), "sigma": sigma.tolist(), "unit": units[name]}
            for name, (value, sigma) in parameters.items()
        },
    }


def effect_from_yaml(mapping: Mapping[str, Any]) -> tuple[Effect, Estimated]:
    """Return an effect and its parameters. Raise LookupError, TypeError or ValueError if the
    mapping does not describe an effect.
    """
    kind = _kind(mapping["name"], mapping.get("varies"))
    form = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in mapping["form"].items()
    }
    for key, hint in get_type_hints(kind).items():
        if key in form and not _fits(form[key], hint):
            raise ValueError(f"form.{key} of {kind.name} is not of the right type")
    effect = kind(**form)
    parameters = {}
    for parameter in effect.effect_parameters:
        entry = mapping["parameters"][parameter.param.name]
        value = np.asarray(entry["value"], dtype=np.float64)
        sigma = np.asarray(entry["sigma"], dtype=np.float64)
        if (
            value.shape != parameter.param.shape
            or sigma.shape != value.shape
            or not np.isfinite(value).all()
            or not (sigma >= 0).all()
        ):
            raise ValueError(f"{parameter.param.name} is not a number of its shape")
        parameters[parameter.param.name] = value, sigma
    return effect, parameters


def _kind(name: str, varies: str | None) -> type[Effect]:
    """Return the kind of effect of this name, whose numbers differ from view to view in this way;
    None for a file that does not say it.
    """
    for kind in (*KINDS, *OF_VIEW):
        if kind.name == name and varies in (kind.varies, None):
            return kind
    if varies in MANNERS:
        return Varying
    raise LookupError(name)


def _fits(value: object, hint: Any) -> bool:
    """True if a value has the type of a form's field: a text, a finite number, or a tuple of
    these.
    """
    inner = get_args(hint)
    if inner:
        kinds = (
            (inner[0],) * len(value)
            if isinstance(value, tuple) and inner[-1] is Ellipsis
            else inner
        )
        return (
            isinstance(value, tuple) and len(value) == len(kinds) and all(map(_fits, value, kinds))
        )
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e6
    return type(value) is hint
