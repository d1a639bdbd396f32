"""The check of a rig by a few later placements of its board: are the cameras still where they were?

Each camera is checked by itself, with a pose of the board of its own in each picture: that asks
whether its own calibration still holds. Cameras that pass are then compared by the placements that
several of them saw, with one pose of the board for all: that asks whether they moved against each
other. Each question has its share of the false alarms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from calib.checking.check import Checker
from calib.checking.overdispersion import Overdispersion
from calib.checking.pictures import Pictures
from calib.checking.result import Change, CheckResult, CheckStatus
from calib.checking.significance import ALPHA
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.progress import Progress, Silent, check_progress
from calib.rig.check_result import CONTRADICTION, RigChange, RigCheckResult
from calib.rig.clock_shift import describe_clock_shift
from calib.rig.later_views import LaterViews, read_later_views, renumber_views
from calib.rig.mounting_agreement import (
    MIN_COMPARED,
    MountingAgreement,
    describe_other_pairing,
    turn_steps,
)
from calib.rig.mounting_test import MOUNTING_SHARE, MountingCheck, MountingTest
from calib.rig.placement_equations import LinearRig
from calib.rig.placements import Placements
from calib.rig.poses import compose, invert_poses
from calib.rig.rig import Rig, RigCalibrationSource
from calib.rig.rig_content import RejectedView
from calib.rig.rig_file import RigDescription, RigSource, read_rig
from calib.rig.shared_placements import SharedPlacements, own_scatter
from calib.session.board import Board
from calib.threads import single_thread

CHANGED = "its own calibration no longer holds, so its pose cannot be compared"
BEHIND_SHARED_COVER = (
    "its cover is shared, and the pictures do not tell its motion from that of the cover"
)
CONTRADICTORY = "its pictures contradict each other"
LEFT_OUT = "the pictures of another camera contradict each other"
ALONE = "no other compared camera sees the board together with it"


@dataclass(frozen=True, slots=True, eq=False)
class RigChecker:
    """A calibrated rig ready for checks."""

    rig: Rig
    linear: LinearRig
    checkers: Mapping[str, Checker]
    scatter: Overdispersion
    """Of the placements of the rig's own fit, along the motions of all cameras."""

    @staticmethod
    def of(rig: Rig) -> RigChecker:
        """Prepare a rig for checks.

        Raises:
            InputError: the rig has no covariance.
        """
        if not rig.covariance.size:
            raise InputError("The rig has no covariance to check it by: fit the rig again.")
        checkers = {name: Checker.of(c) for name, c in rig.calibrations.items()}
        with single_thread():
            linear = LinearRig.of(rig)
            return RigChecker(rig, linear, checkers, own_scatter(rig, linear))

    def check(
        self,
        views: Mapping[str, LaterViews],
        placements: Placements,
        rejected: Sequence[RejectedView] = (),
        progress: Progress = Silent(),
    ) -> RigCheckResult:
        """Check the rig by later views of its cameras.

        Raises:
            NotEnoughDataError: no two cameras saw the board at the same moment.
        """
        if not _components(placements, tuple(views)):
            raise NotEnoughDataError(
                "No picture shows the board at the same moment as a picture of another camera: take"
                " some where two cameras see it together."
            )
        camera_checks = {
            name: self.checkers[name].check(Pictures(camera.views, camera.board), progress)
            for name, camera in views.items()
            if camera.views
        }
        limit = ALPHA * (1 - MOUNTING_SHARE) / len(camera_checks)
        changed = [
            name
            for name, result in camera_checks.items()
            if result.status is not CheckStatus.VALID
            and result.statistics is not None
            and result.statistics.p_value < limit
        ]
        with single_thread():
            mountings = self._compare(views, placements, camera_checks, changed)
        return _combine(camera_checks, changed, mountings, rejected)

    def _compare(
        self,
        views: Mapping[str, LaterViews],
        placements: Placements,
        camera_checks: Mapping[str, CheckResult],
        changed: Sequence[str],
    ) -> MountingCheck:
        """Compare the mountings of the cameras whose own calibration holds."""
        unplaced = dict.fromkeys(changed, CHANGED)
        usable = {name: camera for name, camera in views.items() if name not in changed}
        components = _components(placements, tuple(usable))
        if not components:
            return MountingCheck(unplaced=unplaced | dict.fromkeys(usable, ALONE))
        names = max(components, key=lambda group: (self.rig.reference in group, len(group)))
        unplaced |= {name: ALONE for name in usable if name not in names}
        reference = self.rig.covers.get(self.rig.reference, self.rig.reference)
        base = reference if reference in names else names[0]
        cover_cameras = [
            camera.name for camera in self.linear.cameras if camera.describes_shared_cover
        ]
        unplaced |= {
            name: BEHIND_SHARED_COVER for name in names if name in cover_cameras and name != base
        }
        reported = tuple(name for name in names if name != base and name not in cover_cameras)
        movable = reported if len(names) == 2 or base in cover_cameras else (base, *reported)
        noise = {
            name: result.statistics.noise_ratio
            for name, result in camera_checks.items()
            if result.statistics
        }
        poses = {name: self._poses_in_frame(name, views[name].poses) for name in names}
        shared = SharedPlacements.of(
            self.linear,
            {name: views[name].views for name in names},
            poses,
            placements,
            {name: views[name].board for name in names},
            noise,
        )
        test = MountingTest(self.rig, self.linear, base, reported, movable, self.scatter)
        assert shared  # the components are not empty
        contradictions = self._contradictions(names, base, views, placements)
        check = test.run(shared, explain=not contradictions)
        if not contradictions or check.p_value >= ALPHA * MOUNTING_SHARE:
            return replace(check, unplaced=unplaced)
        named = {change.camera for change in contradictions}
        unplaced |= {name: CONTRADICTORY if name in named else LEFT_OUT for name in reported}
        return replace(
            check,
            status=CheckStatus.UNDECIDED,
            changes=contradictions,
            places={},
            unplaced=unplaced,
        )

    def _contradictions(
        self,
        names: Sequence[str],
        base: str,
        views: Mapping[str, LaterViews],
        placements: Placements,
    ) -> tuple[RigChange, ...]:
        """Return a finding for each camera on whose place against the base its pictures do not
        agree.
        """
        board = self.rig.calibrations[base].board
        findings = (
            _contradiction(name, views[name], views[base], placements, base, board)
            for name in names
            if name != base
        )
        return tuple(finding for finding in findings if finding)

    def _poses_in_frame(self, name: str, poses: Tensor) -> Tensor:
        """Return the (V, 6) poses of boards in the frame of the first camera behind a cover."""
        index = self.rig.index(name)
        mounting = torch.from_numpy(self.rig.mountings[index])
        to_frame = compose(self.linear.cameras[index].mounting, invert_poses(mounting))
        return compose(to_frame, poses)


def check_rig(
    rig: RigCalibrationSource, source: RigSource, progress: Progress = Silent()
) -> RigCheckResult:
    """Check by a few pictures whether a calibrated rig still holds, and what has changed.

    Args:
        rig: the calibrated rig, or the path of its folder.
        source: the later pictures: a rig.yaml whose cameras are some of the rig's.
        progress: the progress bars.

    Raises:
        WrongTypeError: an argument is of another type.
        InputError: the pictures are of other cameras.
        NotEnoughDataError: none can be used.
        NotEnoughDataError: no two cameras saw the board at the same moment.
    """
    check_progress(progress)
    calibrated = Rig.of(rig)
    description = read_rig(source)
    rejected: list[RejectedView] = []
    cameras: dict[str, LaterViews] = {}
    for name in description.sessions:
        cameras[name], dropped = read_later_views(calibrated, description, name, progress)
        rejected += [RejectedView(name, picture, reason) for picture, reason in dropped]
    if not any(camera.views for camera in cameras.values()):
        raise NotEnoughDataError(
            "No picture can be checked: no pose of the board explains the corners of any picture."
            " Take pictures that show the whole board."
        )
    views = {name: camera.views for name, camera in cameras.items()}
    placements = Placements.of(description, views)
    check_clocks(description, views, placements)
    with single_thread():
        cameras = renumber_views(calibrated, cameras, placements)
    return RigChecker.of(calibrated).check(cameras, placements, rejected, progress)


def check_clocks(
    description: RigDescription, views: Mapping[str, Sequence[View]], placements: Placements
) -> None:
    """Raise NotEnoughDataError if no cameras can be compared because of a clock. Where others can,
    a camera that shares no moment with them is listed in the result.
    """
    if _components(placements, tuple(views)):
        return
    if sentence := describe_clock_shift(description, views, placements):
        raise NotEnoughDataError(sentence)


def _contradiction(
    name: str,
    views: LaterViews,
    base_views: LaterViews,
    placements: Placements,
    base: str,
    board: Board,
) -> RigChange | None:
    """Return the finding that the placements disagree on where a camera is; None if they agree."""
    of_base = {place: row for row, place in enumerate(placements.of_views[base].tolist())}
    rows = [row for row, place in enumerate(placements.of_views[name].tolist()) if place in of_base]
    base_rows = [of_base[int(placements.of_views[name][row])] for row in rows]
    if len(rows) < MIN_COMPARED:
        return None
    poses, base_poses = views.poses[rows], base_views.poses[base_rows]
    steps = turn_steps(board)
    agreement = MountingAgreement.of(poses, base_poses, steps)
    if not agreement.is_contradictory:
        return None
    advice = describe_other_pairing(poses, base_poses, steps, name).rstrip(".")
    words = (
        f"only {agreement.count} of the {len(rows)} pictures that {name} shares with {base} agree"
        " on where it is, so they show no movement"
        + (f". {advice}" if advice else ": correct together in rig.yaml, and check again")
    )
    return RigChange(name, Change(CONTRADICTION, words, 1.0))


def _components(placements: Placements, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the groups of two cameras and more that placements connect."""
    groups: list[set[str]] = []
    for place in range(placements.count):
        seeing = {name for name in names if place in placements.of_views[name]}
        if len(seeing) < 2:
            continue
        touching = [group for group in groups if group & seeing]
        groups = [group for group in groups if not group & seeing]
        groups.append(seeing.union(*touching))
    return [tuple(name for name in names if name in group) for group in groups]


def _combine(
    camera_checks: Mapping[str, CheckResult],
    changed: Sequence[str],
    mountings: MountingCheck,
    rejected: Sequence[RejectedView],
) -> RigCheckResult:
    """Return the result of both questions."""
    own_p_values = [r.statistics.p_value for r in camera_checks.values() if r.statistics]
    p_value = min(
        1.0,
        len(camera_checks) * min(own_p_values, default=1.0) / (1 - MOUNTING_SHARE),
        mountings.p_value / MOUNTING_SHARE,
    )
    statuses = [mountings.status, *(camera_checks[name].status for name in changed)]
    status = max(statuses, key=list(CheckStatus).index)
    of_cameras = [
        RigChange(name, replace(change, words=f"{name}: {change.words}"))
        for name in changed
        for change in camera_checks[name].changes
    ]
    left_out = [
        RejectedView(name, picture.name, picture.reason)
        for name, result in camera_checks.items()
        for picture in result.rejected
    ]
    reused = sum(r.statistics.reused_views for r in camera_checks.values() if r.statistics)
    statistics = mountings.statistics
    if statistics:
        statistics = replace(statistics, reused_views=reused)
    return RigCheckResult(
        status=status,
        p_value=p_value,
        statistics=statistics,
        changes=(*of_cameras, *mountings.changes),
        cameras=camera_checks,
        places=mountings.places,
        base=mountings.base,
        unplaced=mountings.unplaced,
        placements=mountings.placements,
        rejected=(*rejected, *left_out, *mountings.rejected),
    )
