"""Read YAML as people expect it: 1e-3 is a number, no is a word, and a repeated key is an error.

PyYAML follows YAML 1.1, so the plain scalars of YAML 1.2's core schema are resolved here.
"""

import re
import unicodedata
from pathlib import Path

import yaml

from calib.errors import InputError, brief
from calib.io.files import read_file

MAX_BYTES = 2 << 20
"""The largest size of a file, bytes: the calibration of ten thousand views has 1 MB."""
MAX_LEVELS = 60
"""The largest number of nested levels of mappings and lists; our files have eight."""
MAX_NODES = 1_000_000
"""The largest number of keys and values, each counted as often as aliases repeat it."""


ADVICE = {
    "mapping values are not allowed here": (  # mostly, a key is indented more than those before it
        "begin the keys of one section in the same column, and put a text with a colon in quotes"
    ),
    "found character '\\t' that cannot start any token": "indent the line by blanks, not by a tab",
    "but found another document": "remove the line --- and one of the two documents",
}
"""What to correct, by PyYAML's words on the problem."""
TWICE = "comes twice, first in line"
"""The words on a repeated key."""


class _Loader(yaml.SafeLoader):
    """A loader with only the types that are added at the end of this file."""


_Loader.yaml_implicit_resolvers = {}
_Loader.yaml_constructors = {}


MAX_FOREIGN_BYTES = 1 << 24
"""The largest size of a file of cv2.FileStorage, bytes."""


def is_opencv(path: Path) -> bool:
    """Return True if cv2.FileStorage wrote a file. `read_yaml` refuses the types of its YAML."""
    return b"opencv-matrix" in read_file(path, MAX_FOREIGN_BYTES)


def read_yaml(path: Path) -> dict[str, object]:
    """Return the mapping in a YAML file; InputError if it is none."""
    try:
        text = read_file(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: save it again as UTF-8.") from error
    try:
        content = _load(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise InputError(
            f"{path}{line}: {brief(error.problem or error.context)}: {_advice(text, error)}."
        ) from error
    except RecursionError as error:
        raise InputError(
            f"{path} has more than {MAX_LEVELS} levels within each other: write it as text, one"
            " key: value on a line."
        ) from error
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(
            f"{path} is not YAML ({brief(error)}): write it as text, one key: value on a line."
        ) from error
    if content is None:
        raise InputError(f"{path} is empty: write its keys, one key: value on a line.")
    if not isinstance(content, dict):
        raise InputError(f"{path} is not a mapping: write its keys, one key: value on a line.")
    return content


def _advice(text: str, error: yaml.MarkedYAMLError) -> str:
    """Return what to correct in a text that is not YAML, as the end of a sentence."""
    mark = error.problem_mark or error.context_mark
    lines = text.splitlines()
    line = lines[mark.line] if mark and mark.line < len(lines) else ""
    odd = next((c for c in line if unicodedata.category(c) in ("Zs", "Cf") and c != " "), "")
    if odd:
        name = unicodedata.name(odd, "strange blank").lower()
        advice = "type a plain space" if odd.isspace() else "delete it, as it is not visible"
        return f"the line has a {name}: {advice}"
    if TWICE in str(error.problem):
        return "remove one"
    return ADVICE.get(str(error.problem), "correct the YAML there")


def _load(text: str) -> object:
    """Return the content of a YAML text, with the version in its first line passed over;
    ValueError if it is nested too deeply, or its aliases repeat too much.
    """
    # OpenCV's FileStorage writes "%YAML:1.0", which YAML does not know
    loader = _Loader(re.sub(r"\A%YAML", "#", text))
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _count_nodes(node, 1, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _count_nodes(node: yaml.Node, level: int, sizes: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Return the number of nodes and of levels of a node with its contents; ValueError if one is
    too large.

    Args:
        node: the node.
        level: the node's level in the file, from 1.
        sizes: both numbers of the nodes that were counted before, by their identity.
    """
    if level > MAX_LEVELS:
        raise ValueError(f"more than {MAX_LEVELS} levels within each other")
    if not isinstance(node, yaml.CollectionNode):
        return 1, 1
    if id(node) not in sizes:
        inner = [
            inner_node
            for entry in node.value
            for inner_node in (entry if isinstance(entry, tuple) else (entry,))
        ]
        inner_sizes = [_count_nodes(inner_node, level + 1, sizes) for inner_node in inner]
        sizes[id(node)] = (
            1 + sum(count for count, _ in inner_sizes),
            1 + max((levels for _, levels in inner_sizes), default=0),
        )
    count, levels = sizes[id(node)]
    if count > MAX_NODES or level + levels - 1 > MAX_LEVELS:
        raise ValueError(
            f"more than {MAX_LEVELS} levels within each other"
            if count <= MAX_NODES
            else "aliases that repeat it too often"
        )
    return count, levels


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[str, object]:
    mapping: dict[str, object] = {}
    lines: dict[str, int] = {}
    for key_node, value_node in node.value:
        key = str(loader.construct_object(key_node, deep=True))
        if key in mapping:
            raise yaml.MarkedYAMLError(
                problem=f'the key "{key}" {TWICE} {lines[key]}',
                problem_mark=key_node.start_mark,
            )
        lines[key] = key_node.start_mark.line + 1
        mapping[key] = loader.construct_object(value_node, deep=True)
    return mapping


def _sequence(loader: _Loader, node: yaml.SequenceNode) -> list[object]:
    return [loader.construct_object(item, deep=True) for item in node.value]


def _unknown(loader: _Loader, node: yaml.Node) -> None:
    loader.construct_undefined(node)


def _int(_: _Loader, node: yaml.ScalarNode) -> int | float:
    return int(node.value) if len(node.value) < 19 else float(node.value)


def _float(_: _Loader, node: yaml.ScalarNode) -> float:
    return float(node.value.replace(".inf", "inf").replace(".nan", "nan"))


_SCALARS = (
    ("null", "(?:~|null|Null|NULL|)", lambda *_: None),
    ("bool", "(?:true|True|TRUE|false|False|FALSE)", lambda _, node: node.value.lower() == "true"),
    ("int", "[-+]?[0-9]+", _int),
    (
        "float",
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))",
        _float,
    ),
    ("str", "", yaml.SafeLoader.construct_yaml_str),
)
for _name, _pattern, _construct in _SCALARS:
    _tag = f"tag:yaml.org,2002:{_name}"
    _Loader.add_constructor(_tag, _construct)
    if _pattern:
        _Loader.add_implicit_resolver(_tag, re.compile(f"^{_pattern}$"), None)
_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
_Loader.add_constructor("tag:yaml.org,2002:seq", _sequence)
_Loader.add_constructor(None, _unknown)
