"""The texts of the set-up: for its fields, and for going on with the cover on."""

from calib.io.numerals import counted
from capture.sources.registry import is_recorded_source
from capture.tui.form import explain_field

COMPLETES = " → completes it."
"""The key that takes a suggested path."""
SOURCE = (
    "Where pictures come from: v4l2:/dev/video0, libcamera:0, rpicam:0, video:FILE, or folder:PATH"
    f" (pictures, or a session).{COMPLETES}"
)
LIKE = (
    "Another session, its folder: board, cover and lens (of its session.yaml or its fit) are taken"
    f" from there. May stay empty.{COMPLETES}"
)
LENS = (
    "Another session, its folder, that knows the lens: that alone is taken from there, into"
    f" session.yaml.{COMPLETES}"
)
PHASE = (
    "First without the cover, for the lens; then through it, with the same focus. If it stays on:"
    " through it alone."
)
VALUES = "The values are here: change what is wrong. Then ^s goes on."
VALUES_AND_FIT = "The values are here: change what is wrong. Then ^r fits again, ^s records."
OPEN_LIST = " enter opens the list, tab goes on."
COVER_ON = "NOW PUT THE COVER ON, and leave the focus alone."
SAME_CAMERA = "Then press ^s."
OTHER_SOURCE = "Name the source of the pictures through it, then ^s."
SAME_SOURCE = "The source is a session that has pictures through it as well: ^s goes on with those."


def help_for(key: str, kind: str, shape: str, *, continued: bool) -> str:
    """Return the help for a field, for a board of this type or a cover of this shape. `continued`
    is True if the session is described already.
    """
    texts = {
        "source": SOURCE,
        "like": LENS if continued else LIKE,
        "phase": PHASE,
        "start": "Enter begins to record.",
    }
    return texts.get(key, explain_field(key, kind, shape))


def cover_on_text(source: str, *, same_source: bool, recorded_views: int = 0) -> str:
    """Return the instruction after the views without the cover. `same_source` is True if the source
    has the views through the cover as well; `recorded_views` is the number of those in the session.
    """
    note = (
        f" Recorded through it already: {counted(recorded_views, 'view')}, which ^r fits."
        if recorded_views
        else ""
    )
    if same_source:
        next_step = SAME_SOURCE
    else:
        next_step = OTHER_SOURCE if is_recorded_source(source) else SAME_CAMERA
    return f"{COVER_ON} {next_step}{note}"
