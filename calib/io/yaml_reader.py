"""YAML as people expect it: 1e-3 is a number, no stays a word, and a key that comes twice is refused.

PyYAML follows YAML 1.1, so the plain scalars of YAML 1.2's core schema are resolved here.
"""

import re
from pathlib import Path

import yaml

from calib.errors import InputError


class _Loader(yaml.SafeLoader):
    """Knows only what is added at the end of this file."""


_Loader.yaml_implicit_resolvers = {}
_Loader.yaml_constructors = {}


def read_yaml(path: Path) -> dict[str, object]:
    """The mapping in a YAML file."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its name and permissions.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: save it again as UTF-8.") from error
    try:
        content = yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}{line}: {error.problem or error.context}: correct the YAML there.") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{path} is not YAML ({str(error).splitlines()[0]}): write it as text, one key: value on a line.") from error
    if content is None:
        raise InputError(f"{path} is empty: write its keys, one key: value on a line.")
    if not isinstance(content, dict):
        raise InputError(f"{path} is not a mapping: write its keys, one key: value on a line.")
    return content


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[str, object]:
    mapping: dict[str, object] = {}
    for key_node, value_node in node.value:
        key = str(loader.construct_object(key_node, deep=True))
        if key in mapping:
            raise yaml.MarkedYAMLError(problem=f'the key "{key}" comes twice', problem_mark=key_node.start_mark)
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
    ("float", r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))", _float),
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
