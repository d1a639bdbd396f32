"""Warnings before a start or a fit, each shown once: the person may intend it, and an error would
show only after the recording.
"""

from collections.abc import Iterator

from capture.coverage import SessionProgress
from capture.source_folder import describe_mismatch, is_kind_unknown
from capture.tui.camera import Task

COVER_IS_OFF = (
    "Were these pictures taken without the cover? If so, start once more. If not, set record now to"
    " through the cover."
)


def find_warnings(task: Task) -> Iterator[tuple[str, str]]:
    """Yield the warnings, each with the field that it concerns."""
    if task.bare and task.setup[2].shape != "none" and is_kind_unknown(task.source):
        yield COVER_IS_OFF, "phase"
    if mismatch := describe_mismatch(task.source, covered=task.covered):
        other_phase = "without the cover" if task.covered else "through the cover"
        yield (
            f"{mismatch} Set record now to {other_phase}, or start once more if they are right all"
            " the same.",
            "phase",
        )


def too_few_views_warning(progress: SessionProgress) -> str:
    """Return the warning about a fit that has too few views."""
    return f"{progress.sentence} Press f again to fit all the same."
