"""The lines on pictures that are not used: those of one reason together, by their number if they
are many.
"""

from collections.abc import Iterable, Iterator

from calib.corners.view import NUMBER
from calib.io.numerals import counted

MAX_NAMES = 3
"""Pictures of one reason that are all named. The JSON and the report name the others as well."""


def left_out_lines(pictures: Iterable[tuple[str, str]], words: str) -> Iterator[str]:
    """Yield a line for each reason; reasons that differ by their numbers alone are one.

    Args:
        pictures: the name of each picture and its reason, which has no full stop.
        words: the beginning of each line.
    """
    pictures_by_kind: dict[str, list[tuple[str, str]]] = {}
    for name, reason in pictures:
        pictures_by_kind.setdefault(NUMBER.sub("", reason), []).append((name, reason))
    for alike in pictures_by_kind.values():
        if len(alike) > MAX_NAMES:
            shown = ", ".join(name for name, _ in alike[:MAX_NAMES])
            reasons = {reason for _, reason in alike}
            first = ", the first" if len(reasons) > 1 else ""
            yield f"{words} {counted(len(alike), 'picture')} ({shown}, ...){first}: {alike[0][1]}."
        else:
            names_by_reason: dict[str, list[str]] = {}
            for name, reason in alike:
                names_by_reason.setdefault(reason, []).append(name)
            for reason, names in names_by_reason.items():
                yield f"{words} {', '.join(names)}: {reason}."
