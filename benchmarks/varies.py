"""Sessions in which something differs from view to view: is it named, are the maps as sure as they
say, and is nothing named where nothing differs? `python -m benchmarks.varies`.

Each session has 24 views of 81 corners with 0.1 px of noise per axis, and declared numbers with
errors of their tolerances. Every cause of `fixtures.view_variation.CAUSES` is tried in so many
sessions of each size, which take turns at the scenes. "ten" are the sizes that stand there, "three"
are 0.3 of them. The seeds of a session are those of its number from `--first` on, so that one can
be done again:

    python -m benchmarks.varies --causes focal/each --scenes dome --first 3007 --sessions 1
        --clean 0 --sizes ten

A cause that poses reduce below a third of the noise counts as not visible, and its session apart.
Of the others, each table has a row for each cause:

    right      its group is in what is said to differ, or among the accepted effects and their
               families; there is none for causes without a name
    wrong      sessions with a name that stands alone and is another: an accepted effect without a
               family, or what is said to differ, without an alternative. A field without a cause
               is no name. An effect on declared numbers is no wrong one if it brings them nearer
               to the true ones by half or more: they have errors here.
    too sure   sessions that are called trusted with a map error above 2.5 sigma, after the loop
    map        map error over predicted sigma, root mean square over the depths: the median and the
               largest, before and after the loop

With `--fit-only` there is no loop: what differs is what the verdict on the fit says.
"""

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.workers import Workers, add_workers, workers_of
from calib.calibration import Calibration
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.finding import Diagnosis
from calib.effects.registry import FIELDS
from calib.errors import RefracalError
from calib.fit_record.request import Settings
from calib.fitting.differing import Differing
from calib.progress import Silent
from calib.threads import single_thread
from calib.verdict.differing_views import find_differing
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust, Verdict
from fixtures.calibrated import calibrated
from fixtures.map_errors import error_over_sigma
from fixtures.synthetic import COVERS, Scene
from fixtures.view_variation import CAUSES, CLEAN, SIZES, VIEWS, Cause, varied_session

SCENES = ("thin-cone", "dome", "cylinder", "wet-flat")
FAR = 2.5
"""Standard deviations."""
GROUPS = {"board_shape": "board_flex"}
"""The group of an effect, where it has another name."""
CAUSE_OF = {cause.name: cause for cause in (*CAUSES, CLEAN)}


@dataclass(frozen=True, slots=True)
class Grade:
    """The grade of a calibration."""

    trusted: bool
    ratio: float
    """The map error over predicted sigma."""

    @staticmethod
    def of(made: Scene, calibration: Calibration, verdict: Verdict) -> "Grade":
        return Grade(verdict.word is Trust.TRUSTED, error_over_sigma(made, calibration))

    @property
    def too_sure(self) -> bool:
        return self.trusted and self.ratio > FAR


@dataclass(frozen=True, slots=True)
class Statement:
    """The names that a person reads."""

    alone: tuple[str, ...] = ()
    """The groups of names that stand alone."""
    possible: tuple[str, ...] = ()
    """The groups of all names."""
    text: str = ""
    """Empty if nothing is said."""

    @staticmethod
    def of(differing: Differing | None, diagnosis: Diagnosis | None = None) -> "Statement":
        accepted = diagnosis.accepted if diagnosis else ()
        families = diagnosis.families if diagnosis else ()
        members = [name for family in families for name in family.members]
        fields = {kind.name for kind in FIELDS}
        alone = [name for name in accepted if name not in (*members, *fields)]
        possible = [*alone, *members]
        texts = [*accepted, *(f"({' or '.join(family.members)})" for family in families)]
        if differing:
            causes = [item.group for item in differing.variations if item.group.has_cause]
            groups = [group.name for group in causes]
            alone += groups[:1] if differing.named else []
            possible += groups
            words = groups[0] if differing.named else " or ".join(groups)
            texts.append(f"differs: {words or 'no cause'}, {differing.first.kind}")
        return Statement(
            alone=tuple(dict.fromkeys(GROUPS.get(name, name) for name in alone)),
            possible=tuple(dict.fromkeys(GROUPS.get(name, name) for name in possible)),
            text="; ".join(texts),
        )


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one session."""

    scene_name: str
    cause: Cause
    size: str
    seed: int
    visible: bool
    statement: Statement = Statement()
    fitted: Grade | None = None
    """None if the session is refused."""
    diagnosed: Grade | None = None
    """None without a loop."""
    corrections: tuple[str, ...] = ()
    """The accepted effects that correct declared numbers."""

    @property
    def last(self) -> Grade | None:
        """The last grade."""
        return self.diagnosed or self.fitted

    @property
    def wrong(self) -> tuple[str, ...]:
        """The wrong names that stand alone."""
        right = (self.cause.group, *self.corrections)
        return tuple(name for name in self.statement.alone if name not in right)

    @property
    def right(self) -> bool:
        return self.cause.group in self.statement.possible

    @property
    def too_sure(self) -> bool:
        return bool(self.last and self.last.too_sure)

    def __str__(self) -> str:
        ratios = [f"{grade.ratio:.1f}" for grade in (self.fitted, self.diagnosed) if grade]
        trusted = "trusted" if self.last and self.last.trusted else "not trusted"
        return (
            f"{self.scene_name}, {self.cause.name}, {self.size}, seed {self.seed}"
            f"{'' if self.visible else ' (not visible)'}: {self.statement.text or 'no name'};"
            f" map {' then '.join(ratios)} sigma, {trusted}"
        )


def outcome(
    scene_name: str, cause_name: str, size: str, seed: int, views: int, fit_only: bool
) -> Outcome:
    """Calibrate and diagnose one session."""
    cause = CAUSE_OF[cause_name]
    scene_seed = len(CAUSE_OF) * seed + list(CAUSE_OF).index(cause_name)
    with single_thread():
        session = varied_session(scene_name, cause, scene_seed, SIZES[size], views)
        result = Outcome(scene_name, cause, size, seed, session.visible)
        try:
            calibration = calibrated(session.scene, session.setup, Settings())
            verdict = judge(calibration)
            result = replace(result, fitted=Grade.of(session.scene, calibration, verdict))
            if fit_only:
                differing = find_differing(calibration)
                read = str(differing) in [reason.sentence for reason in verdict.reasons]
                return replace(result, statement=Statement.of(differing if read else None))
            extended, diagnosis = diagnose(calibration, Silent())
        except RefracalError:
            return result
        return replace(
            result,
            statement=Statement.of(diagnosis.differing, diagnosis),
            diagnosed=Grade.of(session.scene, extended, judge(extended)),
            corrections=corrections(session.scene, extended),
        )


def corrections(made: Scene, calibration: Calibration) -> tuple[str, ...]:
    """Return the effects of a calibration that halve the errors of the declared numbers which they
    change, at least.
    """
    _, declared = calibration.model()
    names = []
    for added in calibration.effects:
        errors = [
            (float(declared[name] - made.values[name]) / number.sigma, number)
            for number in added.effect.effect_parameters
            for name in number.shifts
            if name in made.values and not number.relative
        ]
        residuals = [
            error + float(added.parameters[number.param.name][0]) / number.sigma
            for error, number in errors
        ]
        if errors and np.hypot.reduce(residuals) < np.hypot.reduce([e for e, _ in errors]) / 2:
            names.append(added.effect.name)
    return tuple(names)


Arguments = tuple[str, str, str, int, int, bool]


def drawn(options: argparse.Namespace, size: str) -> list[Arguments]:
    """Return the arguments of all sessions with a cause."""
    rows: list[Arguments] = []
    for index, cause in enumerate(CAUSES):
        scenes = [name for name in options.scenes if cause.possible(COVERS[name][0])]
        if cause.name in options.causes and scenes:
            for seed in range(options.first, options.first + options.sessions):
                scene_name = scenes[(index + seed) % len(scenes)]
                rows.append((scene_name, cause.name, size, seed, options.views, options.fit_only))
    return rows


def cells(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the cells of the row of one cause."""
    visible = [item for item in outcomes if item.visible]
    named = sum(bool(item.cause.group) for item in visible)
    return [
        str(len(visible)),
        str(len(outcomes) - len(visible)),
        f"{sum(item.right for item in visible)}" if named else "",
        str(sum(bool(item.wrong) for item in visible)),
        str(sum(item.too_sure for item in visible)),
        median_and_largest(item.fitted for item in visible),
        median_and_largest(item.diagnosed for item in visible),
    ]


def median_and_largest(grades: Iterable[Grade | None]) -> str:
    """Return the median and the largest map error over sigma; an empty text without any."""
    ratios = [grade.ratio for grade in grades if grade]
    return f"{np.median(ratios):.1f}, {max(ratios):.1f}" if ratios else ""


def table_of(outcomes: Sequence[Outcome], size: str) -> Table:
    """Return the table of all causes of one size."""
    columns = ("visible", "not visible", "right", "wrong", "too sure", "map before", "map after")
    table = Table("cause", *columns, title=f"Causes of size {size}")
    for cause in CAUSES:
        if matching := [item for item in outcomes if item.cause.name == cause.name]:
            table.add_row(cause.name, *cells(matching))
    return table


def summary(outcomes: Sequence[Outcome], title: str) -> str:
    """Return the shares of sessions, a line each."""
    named = [item for item in outcomes if item.cause.group]
    lines = [
        f"{title}:",
        f"a wrong name alone in {share(bool(item.wrong) for item in outcomes)}",
        f"the right group first or in the family in {share(item.right for item in named)}",
    ]
    for words, grades in (
        ("before", [item.fitted for item in outcomes if item.fitted]),
        ("after", [item.diagnosed for item in outcomes if item.diagnosed]),
    ):
        if grades:
            lines += [
                f"{words} the loop trusted with a map error above {FAR:g} sigma in"
                f" {share(grade.too_sure for grade in grades)}",
                f"{words} the loop a map error of at most {FAR:g} sigma in"
                f" {share(grade.ratio <= FAR for grade in grades)}",
            ]
    if refused := sum(item.last is None for item in outcomes):
        lines.append(f"{refused} refused")
    return "\n    ".join(lines)


def share(flags: Iterable[bool]) -> str:
    """Return the count of true flags among all, and their percentage."""
    values = list(flags)
    return f"{sum(values)} of {len(values)} ({100 * sum(values) / max(1, len(values)):.1f} %)"


def with_causes(options: argparse.Namespace, size: str, pool: Workers, console: Console) -> None:
    """Print what becomes of sessions with causes of one size."""
    outcomes = []
    for item in pool.each(outcome, drawn(options, size), size):
        outcomes.append(item)
        if item.wrong or item.too_sure:
            console.print(f"{'wrong' if item.wrong else 'too sure'}: {item}")
    visible = [item for item in outcomes if item.visible]
    console.print(table_of(outcomes, size))
    console.print(summary(visible, f"{len(visible)} sessions with visible causes of size {size}"))
    if hidden := [item for item in outcomes if not item.visible]:
        console.print(summary(hidden, f"{len(hidden)} with causes that are not visible"))


def without_causes(options: argparse.Namespace, pool: Workers, console: Console) -> None:
    """Print the alarms of clean sessions."""
    rows = []
    for seed in range(options.first, options.first + options.clean):
        scene_name = options.scenes[seed % len(options.scenes)]
        rows.append((scene_name, CLEAN.name, "ten", seed, options.views, options.fit_only))
    outcomes = list(pool.each(outcome, rows, CLEAN.name))
    alarms = [item for item in outcomes if item.statement.text]
    ratios = [item.last.ratio <= FAR for item in outcomes if item.last]
    console.print(
        f"{len(outcomes)} clean sessions: {len(alarms)} alarms; a map error of at most"
        f" {FAR:g} sigma in {share(ratios)}."
    )
    for item in alarms:
        console.print(f"alarm: {item}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sessions", type=int, default=4, help="of each cause and size")
    parser.add_argument("--first", type=int, default=3000, help="the number of the first session")
    parser.add_argument("--clean", type=int, default=60, help="sessions without any cause")
    parser.add_argument("--views", type=int, default=VIEWS, help="of each session")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    parser.add_argument("--sizes", nargs="+", choices=tuple(SIZES), default=tuple(SIZES))
    names = tuple(cause.name for cause in CAUSES)
    parser.add_argument("--causes", nargs="+", choices=names, default=names, metavar="CAUSE")
    parser.add_argument("--fit-only", action="store_true", help="no loop: judge the fit alone")
    add_workers(parser)
    options = parser.parse_args()
    console = Console(width=150, highlight=False, markup=False)
    with workers_of(options) as pool:
        for size in options.sizes if options.sessions else ():
            with_causes(options, size, pool, console)
        if options.clean:
            without_causes(options, pool, console)
        console.print(pool.scaled)


if __name__ == "__main__":
    main()
