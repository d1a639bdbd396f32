"""Progress bars on stderr, and tables on stdout."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from types import TracebackType

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Column, Table

from calib.apply.angular_reach import undistortion_limit
from calib.apply.map_uncertainty import describe_sigmas, map_sigmas
from calib.calibration import Calibration
from calib.calibration_content import Stage
from calib.commands.left_out_lines import left_out_lines
from calib.commands.printing import drop
from calib.corners.copies import describe_still
from calib.corners.view import RejectedPicture
from calib.errors import InputError, brief, harmless
from calib.fitting.board_turns import describe_turned
from calib.fitting.corner_outliers import describe_outlier_corners
from calib.fitting.corner_range import corners_at, distance_range
from calib.fitting.description import (
    PRINTED_COLUMNS,
    describe,
    describe_bend,
)
from calib.fitting.evaluate import Evaluation
from calib.fitting.guided_redetection import describe_redetection
from calib.fitting.supported_depths import describe_supported
from calib.fitting.view_noise import describe_noisy_views
from calib.io.numerals import counted
from calib.progress import Advance
from calib.session.lens import NAMES
from calib.table import board_error
from calib.verdict.residual import asks_for_cover
from calib.verdict.thresholds import NO_BETTER
from calib.verdict.uncertainty import reached_depths
from calib.verdict.verdict import Trust, Verdict

AS_WELL = 1.2
"""The largest error of held-out views, over that of the fitted ones, that is called as good."""
MUCH_LARGER = 10.0
"""The error by the focal length alone, over that of the maps, that gets a sentence."""
TITLE_WIDTH = 22
REPEATED = ", again"
"""The words behind a title that repeats."""
BAR_WIDTH = 20


class _Narrator(Console):
    """A console whose work goes on where nobody reads what it prints any more."""

    def on_broken_pipe(self) -> None:
        self.quiet = True
        drop(sys.stderr)


class Bars:
    """Progress bars on stderr, one for each task. A title that repeats says so."""

    def __init__(self) -> None:
        columns = (
            TextColumn(
                "{task.description}",
                markup=False,
                table_column=_column(TITLE_WIDTH + len(REPEATED)),
            ),
            BarColumn(bar_width=BAR_WIDTH, table_column=_column(BAR_WIDTH)),
            TextColumn("{task.completed:>4.0f}/{task.total:<4.0f}", table_column=_column(9)),
            TimeElapsedColumn(table_column=_column(7)),
            TextColumn("{task.fields[words]}", markup=False, table_column=_column()),
        )
        self._progress = Progress(*columns, console=_Narrator(stderr=True))
        self._titles: Counter[str] = Counter()

    def __enter__(self) -> "Bars":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._progress.live.is_started:
            self._progress.stop()

    def task(self, title: str, total: int) -> Advance:
        self._progress.start()
        self._titles[title] += 1
        repeats = REPEATED if self._titles[title] > 1 else ""
        bar: TaskID = self._progress.add_task(brief(title) + repeats, total=total, words="")
        return lambda done, words: self._progress.update(bar, completed=done, words=brief(words))


def _column(width: int | None = None) -> Column:
    """Return a column of one line. All bars have the same widths, whatever their words are."""
    return Column(width=width, min_width=width, no_wrap=True, overflow="ellipsis")


def print_fit(calibration: Calibration, seconds: float, verdict: Verdict | None = None) -> None:
    """Print the table of stages, the numbers of views and corners, and the rejected pictures.

    Args:
        verdict: that on the calibration; findings about the board are guesses where it asks for a
            cover.
    """
    verb = "may be" if verdict and asks_for_cover(verdict) else "is"
    is_forbidden = verdict is not None and verdict.word is Trust.DO_NOT_USE
    console = Console()
    console.print(_stages(calibration.stages))
    for line in _stage_legend(calibration.stages):
        console.print(line, highlight=False, soft_wrap=True)
    print_description(console, calibration)
    corners = sum(view.count for view in calibration.views)
    noise = calibration.noise_px
    words = "unknown" if noise is None else f"about {noise:.3f} px"
    console.print(
        f"{counted(len(calibration.views), 'view')} with {corners} corners, noise of the corners"
        f" {words}, fit in {seconds:.1f} s."
    )
    looks = describe_redetection(calibration.outcome.redetections or ())
    outliers = describe_outlier_corners(calibration.outcome.outlier_corners)
    noisy_views = describe_noisy_views(calibration.outcome.view_noise)
    view_lines = filter(None, (looks, outliers, noisy_views))
    reach = filter(None, [undistortion_limit(calibration)])
    uncertainty = calibration.outcome.uncertainty
    for line in (
        *([] if is_forbidden else _unseen_cover(calibration)),
        *view_lines,
        *_lens(calibration),
        *_prior(calibration),
        *describe_still(calibration.views),
        *_turned_boards(calibration, verb),
        *filter(None, [describe_bend(calibration, verb)]),
        *filter(None, [uncertainty.heavy_sentence if uncertainty else ""]),
        *([] if is_forbidden else (*_maps(calibration), *reach)),
    ):
        console.print(harmless(line), markup=False, highlight=False, soft_wrap=True)
    if validation := calibration.outcome.cross_validation:
        console.print(
            f"Tested by {validation.folds} more fits, each of which left out a different part of"
            f" the views: {validation.held_out_px:.3f} px on what was left out,"
            f" {validation.fitted_px:.3f} px on what was fitted. The fit"
            f" {'overfits' if validation.overfits else 'does not overfit'}.",
            soft_wrap=True,
        )
    _list_rejected(console, calibration.rejected)


def _stages(stages: Sequence[Stage]) -> Table:
    """Return the table of the errors after each stage."""
    fell = stages[-1].rms_px < stages[0].rms_px
    title = "How the error fell (root mean square)" if fell else "Error (root mean square)"
    table = Table("stage", "reprojection error", "on the board", title=title)
    for column in table.columns[1:]:
        column.justify = "right"
    for stage in stages:
        table.add_row(stage.title, f"{stage.rms_px:.3f} px", board_error(stage.rmse_cm))
    return table


def _stage_legend(stages: Sequence[Stage]) -> Iterator[str]:
    """Yield the meaning of each stage, if there are several."""
    if len(stages) > 1:
        yield from (f"{stage.title}: {stage.meaning}." for stage in stages)


def _maps(calibration: Calibration) -> Iterator[str]:
    """Yield a line on the standard deviation of the maps in the part of the picture where the board
    was.
    """
    try:
        command = calibration.request.command
        requested = command.depths if command else ()
        reached = reached_depths(calibration)
        sigmas = map_sigmas(calibration, sorted({*requested, *reached}))
    except InputError:  # corners lie behind the camera: the verdict says so
        return
    if sigmas:
        near, far = distance_range(corners_at(calibration)[:, 2])
        described = describe_sigmas(sigmas, (min(reached), max(reached)))
        yield (
            "Expected error of the maps (sigma), in the part of the picture where the board was:"
            f" {described}. {describe_supported(near, far)}"
        )
        if focal_error(calibration) > MUCH_LARGER * max(sigmas.values()):
            yield (
                "Single numbers, such as camera.fx, are less certain than the maps: in the maps,"
                " their errors cancel."
            )


def focal_error(calibration: Calibration) -> float:
    """Return by how much the edge of the picture moves, in px, for one standard deviation of the
    focal length, if no other number moves with it.
    """
    camera = calibration.camera
    if not camera.intrinsics:
        return 0.0
    focal = camera.intrinsics.fx
    return focal.sigma / focal.value * camera.width / 2


def _lens(calibration: Calibration) -> Iterator[str]:
    """Yield a line on the lens model that held-out views chose, if there was a choice of models."""
    intrinsics = calibration.camera.intrinsics
    held_out_px = calibration.outcome.lens_held_out_px or {}
    models = {name: error for name, error in held_out_px.items() if name.split()[0] in NAMES}
    if not (intrinsics and models):
        return
    counts = {name: error for name, error in held_out_px.items() if name.isdigit()}
    best = min(counts, key=lambda name: counts[name], default="")
    errors = ([f"opencv {counts[best]:.3f} px with {best} coefficients"] if best else []) + [
        f"{n} {e:.3f} px" for n, e in models.items()
    ]
    yield f"Lens: {intrinsics.model}, by the error on held-out views: {', '.join(errors)}."


def _turned_boards(calibration: Calibration, verb: str) -> Iterator[str]:
    """Yield a line on the views that showed the board turned, if there are any."""
    if names := calibration.outcome.turned_boards:
        yield describe_turned(names, verb=verb)
    if names := calibration.outcome.half_turned_boards:
        yield describe_turned(names, "half a turn", verb)


def _unseen_cover(calibration: Calibration) -> Iterator[str]:
    """Yield a line if the cover, as it is fitted, leaves the error of the camera alone."""
    stages = calibration.stages
    if calibration.cover.shape == "none" or len(stages) < 2:
        return
    if stages[-1].rms_px > NO_BETTER * stages[0].rms_px:
        yield (
            "The camera alone leaves the same error: at the distances of these boards, the lens"
            " makes up for the cover, and straight pictures need no more. So these pictures say"
            " little about the cover itself."
        )


def _prior(calibration: Calibration) -> Iterator[str]:
    """Yield a line that says whether the fit used a fleet's prior."""
    if prior := calibration.outcome.fleet_prior:
        source = f"{prior.cameras} cameras ({prior.file})"
        if prior.used:
            yield (
                f"Prior: the numbers and the glass of {source}, which stand below for what is"
                " declared."
            )
        else:
            yield f"Prior: that of {source} was left out, for the views contradict it."


def print_description(console: Console, calibration: Calibration) -> None:
    """Print the table of what was calibrated."""
    for line in describe(calibration).first_columns(PRINTED_COLUMNS).lines():
        style = "" if line.startswith(" ") else "bold"
        console.print(harmless(line), markup=False, highlight=False, soft_wrap=True, style=style)
    console.print()


def print_evaluation(evaluation: Evaluation, fitted_px: float | None, *, wide: bool) -> None:
    """Print the held-out error, in total and by depth, or by distance for a wide lens, and the
    error of the fitted views, px. An immersed calibration has no fitted views: None.
    """
    kind = "these" if evaluation.fitted_views else "held-out"
    console = Console()
    table = Table(
        "distance" if wide else "depth",
        "corners",
        "reprojection",
        "on the board",
        title=f"Error on {kind} views (root mean square)",
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for band in evaluation.by_depth:
        table.add_row(
            f"{band.from_m:g} to {band.to_m:g} m",
            str(band.corners),
            f"{band.rms_px:.3f} px",
            board_error(band.rmse_cm),
        )
    table.add_section()
    total = sum(band.corners for band in evaluation.by_depth)
    table.add_row("all", str(total), f"{evaluation.rms_px:.3f} px", board_error(evaluation.rmse_cm))
    console.print(table)
    count = evaluation.frames_used
    fitted = "poses of the board were fitted to them" if count > 1 else "pose was fitted to it"
    console.print(f"{counted(count, 'view')}: only the {fitted}.")
    if fitted_px is not None:
        agrees = not evaluation.fitted_views and evaluation.rms_px <= AS_WELL * fitted_px
        words = ": the pictures that were not fitted fit equally well" if agrees else ""
        line = f"The error on the fitted views is {fitted_px:.3f} px{words}."
        console.print(line, soft_wrap=True)
    for view in evaluation.bad_views:
        line = (
            f"Does not fit: {view.file}: {view.rms_px:.3f} px, the other views"
            f" {evaluation.other_views_rms_px:.3f} px."
        )
        console.print(harmless(line), markup=False, highlight=False, soft_wrap=True)
    _list_rejected(console, evaluation.rejected)


def _list_rejected(console: Console, rejected: Sequence[RejectedPicture]) -> None:
    """Print the pictures that were not used, those of one reason together."""
    for line in left_out_lines(((p.name, p.reason) for p in rejected), "Not used:"):
        console.print(harmless(line), markup=False, highlight=False, soft_wrap=True)
