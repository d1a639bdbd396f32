"""The next commands of a verdict, with their real paths, quoted for a shell."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.calibration import Calibration
from calib.corners.view import pose_labels
from calib.errors import InputError
from calib.fit_record.request import CommandOptions, Settings
from calib.inference.cross_validation import MIN_CONFIRMING_VIEWS
from calib.io.images import frames_folder
from calib.io.numerals import depth_text
from calib.io.output_folder import OutputFolder
from calib.io.shell import from_here, shell_line, shell_path
from calib.verdict.picture_source import PictureSource, picture_source

HOLDOUT = "HOLDOUT"
"""The word in a command for a folder of views that were not fitted, which the user names."""
HOLDOUT_NOTE = (
    "HOLDOUT is a folder of other pictures of this camera. If you have none, fit again with"
    " --folds 5 beside its other options: it leaves out a fifth of your pictures at a time, and"
    " tests the fit on them."
)
TESTED_NOTE = (
    "HOLDOUT is a folder of other pictures of this camera. If you have none, leave this command"
    " out: --folds has tested the fit already."
)
"""The same note after a fit that has tested itself on pictures that it left out."""
HELD_OUT_FOLDER = "holdout"
"""The folder of a session with views that were kept back."""
NEW_FILM = "FILM"
"""The word for a new video in a command, which the user films and names."""


@dataclass(frozen=True, slots=True)
class NextCommands:
    """Commands about one calibration."""

    session: Path
    folder: Path
    """The folder of the calibration."""
    settings: Settings
    """The settings of its fit."""
    source: PictureSource = PictureSource.CAPTURE
    """The origin of its views, and of further ones."""
    pictures: Path | None = None
    """The folder of the session's pictures; None if it has corners alone, or is not here."""
    depths: tuple[float, ...] = ()
    """m, of the maps that the fit was asked for: the same fit makes them again."""
    diagnosable: bool = True
    """True if there are enough poses of the board for a diagnosis."""
    held_out: Path | None = None
    """The session's folder of pictures that were kept back; None if it has none."""
    black_border: bool = False
    """True if straight pictures for the proposed depth have a black border unless it is cropped."""
    evaluated: bool = False
    """True if the calibration has been evaluated on `held_out`."""
    in_form: bool = False
    """True if sentences tell how to change the session in the form of `capture`, whose fields have
    the keys of session.yaml.
    """

    @staticmethod
    def of(
        calibration: Calibration,
        folder: Path | None,
        session: Path | None,
        depths: tuple[float, ...],
    ) -> NextCommands:
        """Return the commands of a calibration.

        Args:
            folder: that of the calibration; None: the folder that `calib fit` makes in the session.
            session: None: that of the provenance, or, if the two have been moved together, the
                folder around the calibration's.
            depths: m, of the maps; empty: those that the fit was asked for.
        """
        request = calibration.request
        recorded = Path(request.session)
        if folder and not folder.is_absolute():  # a report, which moves, has absolute paths
            recorded = from_here(recorded)
        around = folder.parent if folder else recorded
        if not session:
            session = next((s for s in (recorded, around) if is_described(s)), recorded)
        places = [place for place in (session, recorded, around) if is_described(place)]
        pictures = map(frames_folder, places)
        command = request.command or CommandOptions()
        return NextCommands(
            session,
            folder or session / "calibration",
            request.settings or Settings(),
            source=picture_source(session) if calibration.board.has_grid else PictureSource.DEVICE,
            pictures=next((place for place in pictures if place.is_dir()), None),
            depths=depths or command.depths,
            diagnosable=len(set(pose_labels(calibration.views))) >= MIN_CONFIRMING_VIEWS,
            held_out=held_out_folder(places),
        )

    def fit(self, *options: str) -> str:
        """Return the same fit, for a corrected session or with other options."""
        words = ["calib", "fit", shell_path(self.session)]
        if self.settings.method != Settings().method:
            words += ["--method", self.settings.method]
        grid = self.settings.grid
        if "--grid" not in options and grid and grid != Settings().grid:
            words += ["--grid", "x".join(map(str, grid))]
        if "--free" not in options and self.settings.free != Settings().free:
            words += ["--free", ",".join(self.settings.free) or "none"]
        if self.depths:
            words += ["--depth", *map(depth_text, self.depths)]
        if self.folder != self.session / "calibration":
            words += ["-o", shell_path(self.folder)]
        return " ".join([*words, *map(shlex.quote, options)])

    def fit_in(self, outside_index: float) -> str:
        """Return the same fit in another medium. Only a session.yaml that calib wrote is changed by
        options; another one is to be corrected first.
        """
        if not self.takes_options:
            return self.fit()
        return self.fit("--outside-index", f"{outside_index:g}")

    @property
    def takes_options(self) -> bool:
        """True if calib wrote session.yaml, so that options of `calib fit` change it."""
        try:
            return OutputFolder(self.session).owns("session.yaml")
        except (InputError, OSError):
            return False

    @property
    def description(self) -> str:
        """The words for the place where the session is described."""
        return "the set-up" if self.in_form else "session.yaml"

    @property
    def diagnosis(self) -> str:
        """The words for what finds effects: the command, or the key of `capture`."""
        return "the diagnosis (key e)" if self.in_form else "calib diagnose"

    def name_medium(self, index: float, sigma: float = 0.0) -> str:
        """Return the words that tell how to declare the refractive index of the medium outside of
        the cover.

        Args:
            sigma: its standard deviation; 0 for the usual one.
        """
        key, value = "outside_index", f"{index:g}"
        if self.in_form:
            tolerance = f" ± {sigma:g}" if sigma else ""
            return f"write {value}{tolerance} at {key} in the set-up"
        if self.takes_options:
            tolerance = f"+-{sigma:g}" if sigma else ""
            return f"add --outside-index {value}{tolerance}"
        with_tolerance = f"{{value: {value}, sigma: {sigma:g}}}" if sigma else value
        return f"write {key}: {with_tolerance} under cover in session.yaml"

    @property
    def unknown_cover(self) -> str:
        """The words that tell how to have the shape of the cover estimated."""
        if self.in_form:
            return "unknown at cover shape in the set-up"
        if self.takes_options:
            return f"`{self.fit('--cover', 'unknown')}`"
        return "cover: {shape: unknown} in session.yaml"

    def name_cover(self, shapes: Iterable[str]) -> str:
        """Return the words that tell how to declare the cover's shape, one of these."""
        first, *others = shapes
        if self.in_form:
            return "choose it at cover shape in the set-up"
        if not self.takes_options:
            return "write cover.shape in session.yaml"
        commands = [self.fit("--cover", first), *(f"--cover {shape}" for shape in others)]
        return f"type {' or '.join(f'`{command}`' for command in commands)}"

    def capture(self) -> str:
        """Return the command that records more views, or that fits them when they are there."""
        match self.source:
            case PictureSource.CAPTURE:
                return shell_line("capture", self.session)
            case PictureSource.DEVICE:
                return self.fit()
            case PictureSource.FILM:
                return f"calib fit {NEW_FILM}"

    def diagnose(self, *options: str) -> str:
        """Return the diagnosis, or what comes before it where there are too few views. It compares
        on the views that the session keeps back unless the options name others.
        """
        if not self.diagnosable:
            return self.capture()
        held_out: tuple[str | Path, ...] = ()
        if self.held_out and "--holdout" not in options:
            held_out = ("--holdout", self.held_out)
        return shell_line("calib", "diagnose", self.folder, *options, *held_out)

    def check(self, session: str) -> str:
        """Return the check by the pictures of a session."""
        return shell_line("calib", "check", self.folder, session)

    def evaluate(self) -> str:
        """Return the evaluation on other views: those that the session keeps back, else those of a
        session that the user names.
        """
        views = None if self.evaluated else self.held_out
        return shell_line("calib", "evaluate", self.folder, views or HOLDOUT)

    def undistort(self, depth: float) -> str:
        """Return the undistortion of the session's pictures for a depth in m."""
        pictures = self.pictures or frames_folder(self.session)
        out = self.folder / "undistorted"
        depth_word = depth_text(depth)
        crop = ("--crop", "0") if self.black_border else ()
        return shell_line(
            "calib", "undistort", self.folder, pictures, "--depth", depth_word, *crop, "-o", out
        )

    def uses(self, depth: float, *, mapped: bool) -> tuple[str, ...]:
        """Return the commands that use a calibration which is trusted, the first one first: a
        straight picture, if the session has pictures, and maps for other programs, unless they are
        written already.

        Args:
            depth: m
            mapped: true if the maps for this depth are written.
        """
        straight = (self.undistort(depth),) if self.pictures else ()
        return straight + (() if mapped else (self.export(depth),))

    def report(self) -> str:
        return shell_line("calib", "report", self.folder)

    def export(self, depth: float) -> str:
        """Return the export of maps for a depth in m."""
        options = ["--format", "npz", "--depth", depth_text(depth), "-o"]
        return shell_line("calib", "export", self.folder, *options, self.folder / "export")


def held_out_folder(places: Iterable[Path]) -> Path | None:
    """Return the folder of views that one of these folders keeps back; None if none does."""
    folders = (place / HELD_OUT_FOLDER for place in places)
    return next((folder for folder in folders if folder.is_dir()), None)


def is_described(session: Path) -> bool:
    """Return True if a folder is a session's and is here."""
    return (session / "session.yaml").is_file()
