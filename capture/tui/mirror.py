"""What a screen shows and takes, as plain data for a page that draws it for a thumb: texts, fields,
lists, and its keys as buttons.

It is read from the screen's own widgets, so that there is one session, whatever draws it.
"""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from textual.app import App
from textual.containers import Grid
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Button, Footer, Input, Label, OptionList, Select, Static
from textual.widgets._toast import ToastRack

from capture.tui.help import Prose
from capture.tui.maps import CoverageMap
from capture.tui.page import STEPS, Page
from capture.tui.picture import Picture
from capture.tui.touch_wording import worded
from capture.tui.working_page import Bar, WorkingPage

Block = dict[str, object]
"""`kind`: text, map, bar, field, choice or list; `name`, by which it is spoken of; and what it
shows.
"""

LAID_OUT = re.compile(r"[ ]{2}|[░▒▓█]")
"""Of a text that stands in columns."""
SPOKEN = ("verdict", "problem", "sentence", "said", "hint", "next", "onward")
"""Texts that say what to do: they stay in sight, whatever is scrolled."""
MAIN = ("take", "start", "export", "use", "update", "straighten", "cover_on", "fit")
"""What a screen is there for is the first of these actions that it has."""
NEEDLESS = re.compile(r"app\.(focus_\w+|dots)|scroll\b.*")
"""Actions that a page of its own has no use for."""
CHARACTERS = {"space": " ", "question_mark": "?"}


def described(app: App[Any]) -> dict[str, object]:
    """The screen in front; `focus` is the name of the field that it looks at."""
    screen = app.screen
    pages = [each for each in app.screen_stack if isinstance(each, Page)]
    focused, bindings = screen.focused, keys(screen)
    labels = {
        key: each.description for each in bindings for key in (each.key, app.get_key_display(each))
    }
    blocks = list(_blocks(screen))
    for block in blocks:
        if block["kind"] == "text" and not block["columns"]:
            block["text"] = worded(str(block["text"]), labels)
    return {
        "screen": handle(screen),
        "step": pages[-1].step() if pages else "",
        "steps": list(STEPS),
        "blocks": blocks,
        "picture": bool(screen.query(Picture)),
        "focus": name_of(focused) if isinstance(focused, Input) else "",
        "keys": _buttons(app, bindings),
        "notices": [worded(each.message, labels) for each in app._notifications],
    }


def handle(screen: Screen[Any]) -> str:
    """Tells one screen from every other that is there."""
    return f"{type(screen).__name__}-{id(screen)}"


def name_of(widget: Widget) -> str:
    return widget.id or widget.name or type(widget).__name__


def named(screen: Screen[Any], name: str) -> Widget | None:
    """The field, choice or list of that name, if it can be used now."""
    found = (
        each
        for each in screen.query("Input, Select, OptionList").results(Widget)
        if name_of(each) == name
    )
    return next((each for each in found if not each.disabled and each.display), None)


def keys(screen: Screen[Any]) -> list[Any]:
    """The bindings that the screen's last line has, but for those that only a keyboard needs; one
    for each action.
    """
    found: dict[str, Any] = {}
    for _, binding, enabled, _ in screen.active_bindings.values():
        if binding.show and enabled and not NEEDLESS.fullmatch(binding.action):
            found.setdefault(binding.action, binding)
    return list(found.values())


def character_of(key: str) -> str | None:
    return CHARACTERS.get(key, key if len(key) == 1 else None)


def _buttons(app: App[Any], bindings: list[Any]) -> list[Block]:
    actions = {binding.action for binding in bindings}
    main = next((action for action in MAIN if action in actions), "")
    return [
        {
            "key": each.key,
            "shown": app.get_key_display(each),
            "label": each.description,
            "main": each.action == main,
        }
        for each in bindings
    ]


def _blocks(widget: Widget) -> Iterator[Block]:
    """In the order of the screen. A label belongs to what follows it."""
    label = ""
    for each in widget.children:
        if not each.display or isinstance(each, Footer | Button | Picture | ToastRack):
            continue  # a button has a key as well
        if isinstance(each, Label):
            label = str(each.content).lstrip("✗ ")
        elif isinstance(each, CoverageMap) and each.covered is not None:
            yield _map(each, each.covered)
        elif isinstance(each, Static):
            if each.id == "tasks" and isinstance(each.screen, WorkingPage):
                yield from map(_bar, each.screen.bars)
            if (
                text := each.flowing if isinstance(each, Prose) else str(each.content)
            ) and not _needless(each):
                yield _text(each, text)
        elif block := _taken(each, label):
            yield block
        else:
            yield from _blocks(each)


def _needless(widget: Static) -> bool:
    drawn = (
        isinstance(widget.screen, WorkingPage)
        and bool(widget.screen.bars)
        and widget.id in ("tasks", "errors")
    )
    return drawn or widget.id in ("steps", "small", "legend")


def _bar(bar: Bar) -> Block:
    return {
        "kind": "bar",
        "name": bar.title,
        "label": bar.title,
        "share": round(bar.share, 3),
        "text": bar.words.strip(),
    }


def _map(widget: CoverageMap, covered: NDArray[np.float64]) -> Block:
    return {
        "kind": "map",
        "name": name_of(widget),
        "label": widget.title,
        "full": widget.full,
        "cells": np.round(covered, 2).tolist(),
    }


def _text(widget: Static, text: str) -> Block:
    columns = not isinstance(widget, Prose) and bool(LAID_OUT.search(text.strip()))
    return {
        "kind": "text",
        "name": name_of(widget),
        "text": text if columns else text.strip(),
        "columns": columns,
        "spoken": widget.id in SPOKEN,
        "banner": widget.has_class("banner"),
    }


def _taken(widget: Widget, label: str) -> Block | None:
    """A field, a choice or a list."""
    half = any(isinstance(each, Grid) for each in widget.ancestors)
    about = {"name": name_of(widget), "label": label, "disabled": widget.disabled, "half": half}
    match widget:
        case Input():
            return {
                "kind": "field",
                **about,
                "value": widget.value,
                "wrong": widget.has_class("wrong"),
            }
        case Select():
            chosen = next(
                (
                    place
                    for place, (_, value) in enumerate(widget._options)
                    if value == widget.value
                ),
                -1,
            )
            return {
                "kind": "choice",
                **about,
                "options": [str(prompt) for prompt, _ in widget._options],
                "chosen": chosen,
            }
        case OptionList():
            chosen = -1 if widget.highlighted is None else widget.highlighted
            return {
                "kind": "list",
                **about,
                "options": [str(each.prompt) for each in widget.options],
                "chosen": chosen,
            }
    return None
