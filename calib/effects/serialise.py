"""Effects as a calibration file writes them."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from calib.effects.effect import Effect
from calib.effects.registry import KINDS

Estimated = Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
"""By name: a value and its standard deviation."""


def effect_to_yaml(effect: Effect, parameters: Estimated) -> dict[str, object]:
    """The mapping that `effect_from_yaml` reads."""
    units = {unknown.param.name: unknown.param.unit for unknown in effect.unknowns}
    return {
        "name": effect.name,
        "form": {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(effect).items()  # type: ignore[call-overload]
        },
        "parameters": {
            name: {"value": value.tolist(), "sigma": sigma.tolist(), "unit": units[name]}
            for name, (value, sigma) in parameters.items()
        },
    }


def effect_from_yaml(said: Mapping[str, Any]) -> tuple[Effect, Estimated]:
    """An effect and its parameters; LookupError, TypeError or ValueError where the mapping is not
    of one.
    """
    kinds = {kind.name: kind for kind in KINDS}
    kind = kinds[said["name"]]
    form = {
        key: tuple(part) if isinstance(part, list) else part for key, part in said["form"].items()
    }
    for key, hint in get_type_hints(kind).items():
        if key in form and not _fits(form[key], hint):
            raise ValueError(f"form.{key} of {kind.name} is not one")
    effect = kind(**form)
    parameters = {}
    for unknown in effect.unknowns:
        one = said["parameters"][unknown.param.name]
        value, sigma = (np.asarray(one[key], dtype=np.float64) for key in ("value", "sigma"))
        if (
            value.shape != unknown.param.shape
            or sigma.shape != value.shape
            or not np.isfinite(value).all()
            or not (sigma >= 0).all()
        ):
            raise ValueError(f"{unknown.param.name} is not a number of its shape")
        parameters[unknown.param.name] = value, sigma
    return effect, parameters


def _fits(value: object, hint: Any) -> bool:
    """Whether a value is of a form's type: a text, a finite number, or a tuple of such."""
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
