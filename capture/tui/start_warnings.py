"""Warnings before a start or a fit, each shown once: the person may intend it, and an error would
show only after the recording.
"""

from collections.abc import Iterator

from capture.coverage import SessionProgress
from capture.source_folder import describe_mismatch, is_kind_unknown
from capture.tui.camera import Task

SHOW_NO_COVER = (
    "Were these pictures taken without the cover? If so, start once more. If not, set record now to"
    " through the cover."
)
SHOW_COVER = (
    "Were these pictures taken through the cover? If so, start once more. If not, set record now to"
    " without the cover."
)


def find_warnings(task: Task, *, is_guessed: bool) -> Iterator[tuple[str, str]]:
    """Yield the warnings, each with the field that it concerns.

    Args:
        is_guessed: true if the program has chosen the recorded phase by the source alone.
    """
    has_cover = task.setup[2].shape != "none"
    if is_guessed and has_cover and is_kind_unknown(task.source):
        yield (SHOW_NO_COVER if task.bare else SHOW_COVER), "phase"
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
