"""What a start or a fit is asked about once: it may be meant, and nobody would see before all is
recorded that it was not.
"""

from collections.abc import Iterator

from capture.coverage import SessionProgress
from capture.source_folder import describe_mismatch
from capture.tui.camera import Task
from capture.tui.fit_requirements import lens_known

NO_LENS_YET = (
    "The lens is not known yet: choose record now: without the cover, or name a session that knows"
    " it beside like. Start once more to record through the cover first."
)


def doubts(task: Task) -> Iterator[tuple[str, str]]:
    """A sentence each, and the field that it is about."""
    if said := describe_mismatch(task.source, covered=task.covered):
        other = "without the cover" if task.covered else "through the cover"
        yield (
            f"{said} Set record now to {other}, or start once more if they are right all the same.",
            "phase",
        )
    if task.covered and not lens_known(task.session, task.asked):
        yield NO_LENS_YET, "like"


def too_few(progress: SessionProgress) -> str:
    """Of a fit before there are enough views."""
    return f"{progress.sentence} Press f again to fit all the same."
