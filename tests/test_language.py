"""The rules for the language of the code: names are nouns, docstrings are sentences, and a
statement does one thing. They hold in tests, benchmarks and fixtures as well.
"""

import ast
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("calib", "capture")
FOLDERS = (*PACKAGES, "tests", "benchmarks", "fixtures")
MAX_NAMES = 0.005
"""The fraction of names that may be a refused word: some, such as `inside`, are a term
in some places.
"""
MAX_OPENINGS = 0.02
"""The fraction of docstrings that may open with a refused word."""
MAX_COLUMNS = 100
MAX_NAN_ARGUMENTS = 2
"""A call with more arguments nan builds a result that nobody measured, or a type that is too
large.
"""

PROTOCOL_NAMES = frozenset(
    ("add_arguments", "common_epilog", "export", "inventory", "main", "open_source", "run")
)
"""Functions that each module of a registry has: commands, export formats, sources of frames."""

NAME_WORDS = """
told known seen own left missed found said given named kept lost asked begun apart away off along
across beside beyond within inside outside down here there now then before after again one ones
other others each every both some such more most least few fewer rest whole part parts way ways
still even it its this that these those they them
"""
"""Participles, pronouns, adverbs and prepositions, which do not say what a value is."""
OPENING_WORDS = """
what of those as it where which by with likewise that its them they over beside whose whom how why
this these
"""
"""First words of a docstring that is a clause without its subject or its verb."""

REFUSED_NAMES = frozenset(NAME_WORDS.split())
REFUSED_OPENINGS = frozenset(OPENING_WORDS.split())

each_package = pytest.mark.parametrize("package", PACKAGES)
each_folder = pytest.mark.parametrize("folder", FOLDERS)


Check = Callable[[ast.AST], list[tuple[int, str]]]
"""A function that returns the line and the word of each place that breaks a rule."""


@cache
def parsed_files(package: str) -> dict[Path, ast.Module]:
    """Return the syntax tree of every file of a package."""
    files = sorted((ROOT / package).rglob("*.py"))
    return {file: ast.parse(file.read_text(encoding="utf-8")) for file in files}


def name_bindings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of each variable, field and argument."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id != "_":
            yield node.lineno, node.id
        elif isinstance(node, ast.arg) and node.arg not in ("self", "cls", "_"):
            yield node.lineno, node.arg


def docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of each docstring, those below an assignment included."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        for i, statement in enumerate(body):
            follows = i == 0 and documented
            if i > 0 and isinstance(body[i - 1], ast.Assign | ast.AnnAssign):
                follows = True
            if follows and isinstance(statement, ast.Expr):
                value = statement.value
                if isinstance(value, ast.Constant) and isinstance(value.value, str):
                    yield statement.lineno, value.value


def refused_names(tree: ast.AST) -> list[tuple[int, str]]:
    """Return the lines and names that are a refused word."""
    return [(line, name) for line, name in name_bindings(tree) if name.strip("_") in REFUSED_NAMES]


def refused_openings(tree: ast.AST) -> list[tuple[int, str]]:
    """Return the lines and first words of docstrings that open with a refused word."""
    openings = []
    for line, text in docstrings(tree):
        words = "".join(c if c.isalpha() or c == "'" else " " for c in text).split()
        if words and words[0].lower() in REFUSED_OPENINGS:
            openings.append((line, words[0]))
    return openings


def unpacked_comprehensions(tree: ast.AST) -> list[tuple[int, str]]:
    """Return the lines that assign a comprehension to several names."""
    return [
        (node.lineno, ast.unparse(node.targets[0]))
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Tuple | ast.List)
        and isinstance(node.value, ast.GeneratorExp | ast.ListComp)
    ]


def nan_calls(tree: ast.AST) -> list[tuple[int, str]]:
    """Return the lines of calls with too many arguments nan."""
    calls = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            values = [*node.args, *(keyword.value for keyword in node.keywords)]
            if sum(is_nan(value) for value in values) > MAX_NAN_ARGUMENTS:
                calls.append((node.lineno, ast.unparse(node.func)))
    return calls


def is_nan(value: ast.expr) -> bool:
    """True if the expression is a nan of Python, numpy or torch."""
    return ast.unparse(value) in ("nan", "np.nan", "math.nan", "torch.nan", "float('nan')")


def public_names(tree: ast.Module) -> set[str]:
    """Return the public classes and functions of a file."""
    definitions = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    names = {node.name for node in tree.body if isinstance(node, definitions)}
    return {name for name in names - PROTOCOL_NAMES if not name.startswith("_")}


def repeated_names(trees: dict[str, ast.Module]) -> dict[str, list[str]]:
    """Return the public names of more than one file, with these files."""
    files: dict[str, list[str]] = {}
    for file, tree in trees.items():
        for name in public_names(tree):
            files.setdefault(name, []).append(file)
    return {name: places for name, places in files.items() if len(places) > 1}


def imported_modules(tree: ast.AST) -> set[str]:
    """Return the names that a file may import as modules, those under TYPE_CHECKING included."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def import_circles(trees: dict[str, ast.Module]) -> set[tuple[str, str]]:
    """Return the pairs of modules that import each other."""
    imports = {module: imported_modules(tree) & trees.keys() for module, tree in trees.items()}
    return {
        (module, imported)
        for module, names in imports.items()
        for imported in names
        if module in imports[imported] and module < imported
    }


def places(package: str, check: Check) -> list[str]:
    """Return the file, the line and the word of everything that a check finds in a package."""
    return [
        f"{file.relative_to(ROOT)}:{line} {word}"
        for file, tree in parsed_files(package).items()
        for line, word in check(tree)
    ]


@each_folder
def test_names_are_nouns(folder: str) -> None:
    count = sum(len(list(name_bindings(tree))) for tree in parsed_files(folder).values())
    refused = places(folder, refused_names)
    assert len(refused) <= MAX_NAMES * count, "\n".join(refused)


@each_folder
def test_docstrings_are_sentences(folder: str) -> None:
    count = sum(len(list(docstrings(tree))) for tree in parsed_files(folder).values())
    refused = places(folder, refused_openings)
    assert len(refused) <= MAX_OPENINGS * count, "\n".join(refused)


@each_folder
def test_a_statement_does_one_thing(folder: str) -> None:
    assert places(folder, unpacked_comprehensions) == []


@each_package
def test_no_result_is_made_of_nan(package: str) -> None:
    assert places(package, nan_calls) == []


@each_package
def test_lines_fit_a_screen(package: str) -> None:
    assert [
        f"{file.relative_to(ROOT)}:{number}"
        for file in sorted((ROOT / package).rglob("*.py"))
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > MAX_COLUMNS
    ] == []


def test_a_public_name_stands_in_one_file() -> None:
    trees = {
        str(file.relative_to(ROOT)): tree
        for package in PACKAGES
        for file, tree in parsed_files(package).items()
    }
    assert repeated_names(trees) == {}


def test_no_two_files_import_each_other() -> None:
    trees = {
        ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): tree
        for package in PACKAGES
        for file, tree in parsed_files(package).items()
    }
    assert import_circles(trees) == set()


def test_the_checks_find_what_they_refuse() -> None:
    tree = ast.parse(
        '''
"""What a file is for."""
scale = 1.0
"""Of the picture."""
def convert(told, seen_pixels):
    """Return the pixels."""
    _found = [told]
    first, second = (pixel + 1 for pixel in seen_pixels)
    return Result(nan, np.nan, noise=math.nan), Result(nan, nan, 0.0)
'''
    )
    assert {name for _, name in refused_names(tree)} == {"_found", "told"}
    assert [word for _, word in refused_openings(tree)] == ["What", "Of"]
    assert unpacked_comprehensions(tree) == [(8, "(first, second)")]
    assert nan_calls(tree) == [(9, "Result")]
    trees = {
        "package.table": ast.parse("from package import row"),
        "package.row": ast.parse(
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import package.table"
        ),
        "package.cell": ast.parse("import package.row"),
    }
    assert import_circles(trees) == {("package.row", "package.table")}
    trees = {
        "row.py": ast.parse("class Line: ...\ndef run(): ...\ndef _read(): ..."),
        "table.py": ast.parse("async def run(): ...\ndef Line(): ...\ndef _read(): ..."),
    }
    assert repeated_names(trees) == {"Line": ["row.py", "table.py"]}
