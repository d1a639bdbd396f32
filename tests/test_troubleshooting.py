"""docs/troubleshooting.md: every message that it quotes stands in the code."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (.+?) \| ", re.MULTILINE)
QUOTED = [
    words
    for row in ROW.findall(PAGE)
    for words in re.findall(r"`([^`]+)`", row)
    if not row.startswith("the ")
]


@cache
def sentences() -> str:
    """Every text of the code, with `#` for what is put into it."""
    texts = []
    for package in ("calib", "capture"):
        for file in (ROOT / package).rglob("*.py"):
            tree = ast.parse(file.read_text(encoding="utf-8"))
            texts += [text_of(node) for node in ast.walk(tree) if isinstance(node, ast.expr)]
    return "\n".join(" ".join(text.split()) for text in texts if text)


def text_of(node: ast.expr) -> str:
    match node:
        case ast.Constant(value=str(value)):
            return value
        case ast.JoinedStr(values=values):
            return "".join(text_of(v) if isinstance(v, ast.Constant) else "#" for v in values)
    return ""


def test_it_quotes_many_messages() -> None:
    assert len(QUOTED) > 70


@pytest.mark.parametrize("words", dict.fromkeys(QUOTED))
def test_each_quoted_message_is_in_the_code(words: str) -> None:
    assert " ".join(words.split()) in sentences()
