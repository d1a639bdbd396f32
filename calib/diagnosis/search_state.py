"""The state of the search for missing effects: the fit, what was tried, and what was dropped.

A state is frozen. The functions of the search return the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from calib.diagnosis.trial import Trial
from calib.effects.effect import Effect, EffectContext
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.fitting.differing import Differing
from calib.inference.cross_validation import HeldOutErrors, Split, hold_out
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import FittedModel, ModelFit
from calib.inference.warm_start import start_without_effects
from calib.session.board import Board
from calib.session.camera import Camera

TrialKey = tuple[str, str]
"""The name of an effect and its form."""
EffectNames = tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SearchProblem:
    """The constant inputs of a search."""

    board: Board
    camera: Camera
    observations: Observations
    folds: Split
    depth_bands: Split | None
    base: CameraModel
    """The model without effects."""
    free_base: CameraModel | None
    """The same with the declared numbers free that `base` holds; None if it holds none, or if the
    user chose them.
    """
    report: Callable[[str], None]
    """Called with a short remark before each step."""
    has_structure: Callable[[ModelFit], bool]
    """True if noise does not explain the residual of a fit."""

    def at_optimum(self, fit: ModelFit) -> tuple[FittedModel, EffectContext]:
        """Return a fit with the observations, and its context."""
        fitted = FittedModel(fit.model, self.observations, fit.joint)
        return fitted, effect_context(fitted, self.board, self.camera, locate=False)


@dataclass(frozen=True, slots=True, eq=False)
class Evaluations:
    """Held-out errors and refits of one fit, each computed on first use."""

    problem: SearchProblem
    fit: ModelFit
    previous_fits: Mapping[EffectNames, JointFit]
    """Fits of models that the search has had, by their effects: starts for refits."""
    _refits: dict[EffectNames, ModelFit] = field(default_factory=dict)
    _errors: dict[tuple[bool, bool], HeldOutErrors] = field(default_factory=dict)
    _refit_errors: dict[tuple[EffectNames, bool], HeldOutErrors] = field(default_factory=dict)
    _differing: list[Differing | None] = field(default_factory=list)

    def refit_with(self, effects: Sequence[Effect]) -> ModelFit:
        """Return the fit of the model with some of its effects alone, with its noise and prior."""
        fit = self.fit
        if len(effects) == len(fit.model.effects):
            return fit
        names = effect_names(effects)
        if names not in self._refits:
            model = self.problem.base.with_effects(effects)
            observations = self.problem.observations
            if previous := self.previous_fits.get(names):
                poses = previous.poses
                start = replace(fit.joint.start, values=previous.values)
            else:
                poses = fit.joint.poses
                start = start_without_effects(model, fit.model, fit.joint, observations)
            self._refits[names] = ModelFit(model, model.fit(observations, poses, start))
        return self._refits[names]

    def refit_without(self, effect: Effect) -> ModelFit:
        """Return the fit of the model without one of its effects."""
        return self.refit_with(effects_without(effect, self.fit.model.effects))

    def held_out_errors(self, *, half: bool | None = None, by_depth: bool = False) -> HeldOutErrors:
        """Return the held-out errors of the model.

        Args:
            half: score half of the corners; None: if the views' own parameters require it.
            by_depth: hold out depth bands instead of folds.
        """
        key = self.fit.model.path.has_private_blocks if half is None else half, by_depth
        if key not in self._errors:
            bands = self.problem.depth_bands
            split = bands if by_depth and bands else self.problem.folds
            self._errors[key] = hold_out(
                self.fit.model, self.problem.observations, self.fit.joint, split, half=key[0]
            )
        return self._errors[key]

    def held_out_errors_with(self, effects: Sequence[Effect], *, half: bool) -> HeldOutErrors:
        """Return the held-out errors of the model with some of its effects alone."""
        key = effect_names(effects), half
        if key not in self._refit_errors:
            self.problem.report("what is needed")
            fit = self.refit_with(effects)
            self._refit_errors[key] = hold_out(
                fit.model, self.problem.observations, fit.joint, self.problem.folds, half=half
            )
        return self._refit_errors[key]

    @property
    def differing(self) -> Differing | None:
        """Numbers that differ from view to view beside the model; None if none do."""
        if not self._differing:
            self._differing.append(Differing.of(*self.problem.at_optimum(self.fit)))
        return self._differing[0]


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """A step of the search."""

    problem: SearchProblem
    evaluations: Evaluations
    """The current fit with its evaluations."""
    trials: Mapping[TrialKey, Trial] = field(default_factory=dict)
    """The trial in which each effect came closest to acceptance."""
    hopeless: frozenset[TrialKey] = frozenset()
    """Effects whose fit has such a large error that they are not tried again."""
    confounded: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """For each effect, those that these views do not tell from it."""
    dropped: frozenset[str] = frozenset()
    """Effects that were accepted and later not needed; they are not tried again."""

    @staticmethod
    def begin(problem: SearchProblem, fit: ModelFit) -> SearchState:
        """Return the state before the first step."""
        return SearchState(problem, Evaluations(problem, fit, {}))

    @property
    def fit(self) -> ModelFit:
        """The current fit."""
        return self.evaluations.fit

    @property
    def model(self) -> CameraModel:
        """The current model."""
        return self.evaluations.fit.model

    @property
    def joint(self) -> JointFit:
        """The fit of the current model."""
        return self.evaluations.fit.joint

    @property
    def fitted_model(self) -> FittedModel:
        """The current fit with the observations."""
        return FittedModel(self.model, self.problem.observations, self.joint)

    def with_fit(self, fit: ModelFit, *, keep_previous: bool = False) -> SearchState:
        """Return the state with another fit; with `keep_previous`, later refits may start from the
        current one.
        """
        previous = self.evaluations.previous_fits
        if keep_previous:
            previous = {**previous, effect_names(self.model.effects): self.joint}
        return replace(self, evaluations=Evaluations(self.problem, fit, previous))

    def with_trial(self, trial: Trial) -> SearchState:
        """Return the state with this trial of its effect."""
        return replace(self, trials={**self.trials, trial.key: trial})


def effect_names(effects: Sequence[Effect]) -> EffectNames:
    """Return the names of effects, with the way in which their numbers vary."""
    return tuple(f"{effect.name} {effect.varies}".rstrip() for effect in effects)


def effects_without(effect: Effect, effects: Sequence[Effect]) -> list[Effect]:
    """Return the effects except one."""
    return [candidate for candidate in effects if candidate is not effect]
