"""Which parameters a session states with a standard deviation: these are the free ones of the joint fit, and take its estimates."""

from collections.abc import Mapping
from dataclasses import replace

from calib.estimation.joint_fit import JointFit
from calib.estimation.priors import Priors
from calib.optics.path import Path
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.schema import Number


def priors_of(intrinsics: Intrinsics, cover: Cover, path: Path) -> Priors:
    """Of each parameter of the path that is described with a standard deviation (SI units)."""
    known = {param.name for param in path.params}
    sigmas = {name: number.sigma for name, number in _stated(intrinsics, cover).items() if number.sigma > 0 and name in known}
    return Priors(sigmas, _correlations(intrinsics))


def with_estimates(intrinsics: Intrinsics, cover: Cover, joint: JointFit | None) -> tuple[Intrinsics, Cover]:
    """The same description with the estimates and their standard deviations; parameters of a fit that is not finite stay as stated. How the
    estimates are correlated the fit's covariance says."""
    found = joint.estimates() if joint else {}
    if joint and not joint.finite:
        found = {
            name: replace(number, sigma=stated.sigma) for name, stated in _stated(intrinsics, cover).items() if (number := found.get(name))
        }
    return _with(intrinsics, cover, found)


def widened(intrinsics: Intrinsics, cover: Cover, name: str, factor: float) -> tuple[Intrinsics, Cover]:
    """The same description with the standard deviation of one number, as the path calls it, `factor` times as large.

    It keeps its covariances, as if an error that owes nothing to the others were added to it: so the prior is looser in every direction. If
    it kept its correlations instead, or lost them, the prior would grow tighter in some, without a reason.
    """
    number = _stated(intrinsics, cover)[name]
    wider, cover = _with(intrinsics, cover, {name: replace(number, sigma=factor * number.sigma)})
    correlations = tuple(
        tuple(value / factor if name in (one, other) else value for other, value in row.items())
        for one, row in _rows_of(intrinsics).items()
    )
    return replace(wider, correlations=correlations), cover


def _with(intrinsics: Intrinsics, cover: Cover, found: Mapping[str, Number]) -> tuple[Intrinsics, Cover]:
    """The description with some numbers, by the path's names, in place of its own."""
    parameters = {name: found.get(f"cover.{name}", number) for name, number in cover.parameters.items()}
    fx, fy, cx, cy, *lens = (found.get(name, number) for name, number in _named(intrinsics).items())
    return replace(intrinsics, fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(lens), correlations=()), replace(cover, parameters=parameters)


def _correlations(intrinsics: Intrinsics) -> dict[tuple[str, str], float]:
    return {(one, other): value for one, row in _rows_of(intrinsics).items() for other, value in row.items()}


def _rows_of(intrinsics: Intrinsics) -> dict[str, dict[str, float]]:
    """The correlations of each number with those before it; empty where they are independent."""
    names = tuple(_named(intrinsics))
    rows = zip(names[1:], intrinsics.correlations, strict=False)
    return {one: dict(zip(names, row, strict=False)) for one, row in rows}


def _stated(intrinsics: Intrinsics, cover: Cover) -> dict[str, Number]:
    return {f"cover.{name}": number for name, number in cover.parameters.items()} | _named(intrinsics)


def _named(intrinsics: Intrinsics) -> dict[str, Number]:
    pinhole = {f"camera.{name}": getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy")}
    return pinhole | {f"camera.{name}": number for name, number in zip(intrinsics.names, intrinsics.distortion, strict=True)}
