"""YAML as people expect it: 1e-3 is a number, no stays a word, and a key that comes twice is
refused.

PyYAML follows YAML 1.1, so the plain scalars of YAML 1.2's core schema are resolved here.
"""

import re
from pathlib import Path

import yaml

from calib.errors import InputError, brief
from calib.io.files import read_file

LARGEST = 2 << 20
"""bytes: the calibration of ten thousand views has one."""
DEEPEST = 60
"""Levels of mappings and lists within each other; ours have eight."""
MOST_NODES = 1_000_000
"""Keys and values, each counted as often as aliases repeat it."""


class _Loader(yaml.SafeLoader):
    """Knows only what is added at the end of this file."""


_Loader.yaml_implicit_resolvers = {}
_Loader.yaml_constructors = {}


def read_yaml(path: Path) -> dict[str, object]:
    """The mapping in a YAML file."""
    try:
        text = read_file(path, LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: save it again as UTF-8.") from error
    try:
        content = _load(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise InputError(
            f"{path}{line}: {brief(error.problem or error.context)}: correct the YAML there."
        ) from error
    except RecursionError as error:
        raise InputError(
            f"{path} has more than {DEEPEST} levels within each other: write it as text, one key:"
            " value on a line."
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


def _load(text: str) -> object:
    """ValueError where it is nested too deeply, or its aliases repeat too much."""
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _check(node, 1, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _check(node: yaml.Node, level: int, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """How many nodes it has with all within it, and levels; `known` holds both by the identity of
    nodes that were looked into.
    """
    if level > DEEPEST:
        raise ValueError(f"more than {DEEPEST} levels within each other")
    if not isinstance(node, yaml.CollectionNode):
        return 1, 1
    if id(node) not in known:
        inner = [
            one for entry in node.value for one in (entry if isinstance(entry, tuple) else (entry,))
        ]
        found = [_check(one, level + 1, known) for one in inner]
        known[id(node)] = (
            1 + sum(count for count, _ in found),
            1 + max((levels for _, levels in found), default=0),
        )
    count, levels = known[id(node)]
    if count > MOST_NODES or level + levels - 1 > DEEPEST:
        raise ValueError(
            f"more than {DEEPEST} levels within each other"
            if count <= MOST_NODES
            else "aliases that repeat it too often"
        )
    return count, levels


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[str, object]:
    mapping: dict[str, object] = {}
    for key_node, value_node in node.value:
        key = str(loader.construct_object(key_node, deep=True))
        if key in mapping:
            raise yaml.MarkedYAMLError(
                problem=f'the key "{key}" comes twice', problem_mark=key_node.start_mark
            )
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
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))",
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
