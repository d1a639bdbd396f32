"""What the set-up says of its fields, and of going on with the cover on."""

from capture.tui.form import explained
from capture.tui.references import played

SOURCE = (
    "Where pictures come from: v4l2:/dev/video0, libcamera:0, rpicam:0, video:FILE, or folder:PATH"
    " (pictures, or a session)."
)
LIKE = (
    "Another session, its folder: board, cover and lens (of its session.yaml or its fit) are taken"
    " from there. May stay empty."
)
LENS = (
    "Another session, its folder, that knows the lens: that alone is taken from there, into"
    " session.yaml."
)
PHASE = "First without the cover, to find the lens; then through it, without touching the focus."
OPENS = " enter opens the list, tab goes on."
COVER_ON = "NOW PUT THE COVER ON, and leave the focus alone."
LIVE = "Then enter on Start."
PLAYED = "Name the source of the pictures through it, then ^s."
BOTH = "The source is a session that has pictures through it as well: ^s goes on with those."


def help_of(key: str, kind: str, shape: str, *, continued: bool) -> str:
    """What a field is for, of a board of this type or a cover of this shape; `continued`: the
    session is described already.
    """
    texts = {
        "source": SOURCE,
        "like": LENS if continued else LIKE,
        "phase": PHASE,
        "start": "Enter begins to record.",
    }
    return texts.get(key, explained(key, kind, shape))


def cover_on(source: str, *, both: bool, there: int = 0) -> str:
    """What to do after the views without the cover; `both`: the source has those through it as
    well; `there`: views through it already.
    """
    recorded = f" {there} views through it are here already: ^r fits them." if there else ""
    return f"{COVER_ON} {BOTH if both else PLAYED if played(source) else LIVE}{recorded}"
