"""Imports between the files of `capture` run one way: no file needs, however late, one that needs it."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import capture

FOLDER = Path(capture.__file__).parent


def _imports(tree: ast.AST) -> set[str]:
    """Modules of `capture` that it imports anywhere, within functions too; but for annotations alone does not count."""
    found: set[str] = set()
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        found |= _imports(node)
    return found


def test_no_circle() -> None:
    files = {".".join(path.relative_to(FOLDER.parent).with_suffix("").parts): path for path in FOLDER.rglob("*.py")}
    graph = {name: _imports(ast.parse(path.read_text())) & files.keys() for name, path in files.items()}
    assert "capture.tui.results" in graph["capture.tui.fit"]  # so that nothing found is not taken for nothing wrong
    TopologicalSorter(graph).prepare()  # CycleError names those in a circle
