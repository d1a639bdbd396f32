"""The content of a screen as plain data for a page that draws it for a thumb: texts, fields, lists,
and its keys as buttons.

It is read from the screen's own widgets, so there is one session, whatever draws it.
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

from calib.session.schema import UNKNOWN
from calib.verdict.verdict import Trust
from capture.tui.board_and_cover import OR_UNKNOWN, NumberField
from capture.tui.help import Prose
from capture.tui.maps import CoverageMap
from capture.tui.page import STEPS, Page
from capture.tui.picture import Picture
from capture.tui.row import ASSUMED, Row
from capture.tui.touch_wording import name_buttons, readable_label
from capture.tui.working_page import Bar, WorkingPage

Block = dict[str, object]
"""A block has a `kind` (text, map, bar, field, choice or list), a `name` by which the page refers
to it, and its content.
"""

COLUMNS = re.compile(r"[ ]{2}|[░▒▓█]")
"""Matches a text in columns."""
INSTRUCTION_IDS = ("now", "verdict", "problem", "sentence", "said", "next", "onward", "hint")
"""The texts that say what to do, the most urgent first: they stay visible, whatever is scrolled."""
MOVED_BEFORE = ("phase", "like")
"""The choice that a terminal shows below all fields. A page would hide it there, so it comes before
this optional field.
"""
MOVED_BELOW = ("outside_index", "shape")
"""The field that decides between air and water, and the choice below which a page has it: below all
others it would be hidden, with a value that nobody has looked at.
"""
WIDE = ("outside_index",)
"""The fields that take the width of the page, because their labels are long."""
MAIN_ACTIONS = [
    "take",
    "start",
    "export",
    "use",
    "update",
    "straighten",
    "cover_on",
    "results",
    "fit",
    "refit",
    "correct",
    "report",
]
"""The main actions: a screen's main button is the first of these that it has."""
KEYBOARD_ACTIONS = re.compile(r"app\.(focus_\w+|dots)|scroll\b.*")
"""The actions for which the page has no use."""
CHARACTERS = {"space": " ", "question_mark": "?"}
TONES = (*(grade.value for grade in Trust), "wrong")
"""The classes of a text that give it a colour."""


def describe_screen(app: App[Any]) -> dict[str, object]:
    """Return the screen in front; `focus` is the name of the field with the focus."""
    screen = app.screen
    pages = [item for item in app.screen_stack if isinstance(item, Page)]
    focused = screen.focused
    labels = _labels(app)
    blocks = sorted(_blocks(screen), key=_urgency)
    _move_before(blocks, *MOVED_BEFORE)
    _move_below(blocks, *MOVED_BELOW)
    for block in blocks:
        if block["kind"] == "text" and not block["columns"]:
            block["text"] = name_buttons(str(block["text"]), labels)
    return {
        "screen": screen_id(screen),
        "step": pages[-1].step() if pages else "",
        "steps": list(STEPS) if pages and pages[-1].step() in STEPS else [],
        "blocks": blocks,
        "pictures": len(screen.query(Picture)),
        "focus": name_of(focused) if isinstance(focused, Input | Select) else "",
        "keys": _buttons(_shown_bindings(screen), pages[-1] if pages else None),
        "notices": [name_buttons(item.message, labels) for item in app._notifications],
    }


def screen_id(screen: Screen[Any]) -> str:
    """Return an id that differs for all existing screens."""
    return f"{type(screen).__name__}-{id(screen)}"


def name_of(widget: Widget) -> str:
    return widget.id or widget.name or type(widget).__name__


def find_field(screen: Screen[Any], name: str) -> Widget | None:
    """Return the field, choice or list of that name, if it can be used now."""
    candidates = (
        widget
        for widget in screen.query("Input, Select, OptionList").results(Widget)
        if name_of(widget) == name
    )
    return next((widget for widget in candidates if not widget.disabled and widget.display), None)


def visible_bindings(screen: Screen[Any]) -> list[Any]:
    """Return the bindings of the screen's last line, without those that only a keyboard needs; one
    for each action.
    """
    return [binding for binding, enabled in _shown_bindings(screen) if enabled]


def _shown_bindings(screen: Screen[Any]) -> list[tuple[Any, bool]]:
    """Return the same bindings and those that are off now, each with whether it is on."""
    bindings: dict[str, tuple[Any, bool]] = {}
    for _, binding, enabled, _ in screen.active_bindings.values():
        if binding.show and not KEYBOARD_ACTIONS.fullmatch(binding.action):
            bindings.setdefault(binding.action, (binding, enabled))
    return list(bindings.values())


def character_of(key: str) -> str | None:
    return CHARACTERS.get(key, key if len(key) == 1 else None)


def _labels(app: App[Any]) -> dict[str, str]:
    """Return the labels of the buttons, by their keys as sentences name them. A sentence may name a
    key of the screen behind: that of the next step.
    """
    return {
        key: binding.description
        for screen in app.screen_stack
        for binding in visible_bindings(screen)
        for key in (binding.key, app.get_key_display(binding))
    }


def _move_before(blocks: list[Block], name: str, other: str) -> None:
    """Move the block of that name before another, if both are there."""
    places = {str(block["name"]): place for place, block in enumerate(blocks)}
    if name in places and other in places:
        blocks.insert(places[other], blocks.pop(places[name]))


def _move_below(blocks: list[Block], name: str, other: str) -> None:
    """Move the block of that name below another, if both are there."""
    places = {str(block["name"]): place for place, block in enumerate(blocks)}
    if places.get(name, -1) > places.get(other, len(blocks)):
        blocks.insert(places[other] + 1, blocks.pop(places[name]))


def _urgency(block: Block) -> int:
    """Return the place of an instruction among the others; other blocks keep their order."""
    name = block["name"]
    return INSTRUCTION_IDS.index(str(name)) if block.get("spoken") else -1


def _buttons(bindings: list[tuple[Any, bool]], page: Page | None) -> list[Block]:
    """Return the buttons of the bindings. An action for which it is early, or which is not needed
    any more, is not the main one. A button that is off keeps its place: no other one may come under
    a finger. `pressed` is whether a switch is on, None for any other button.
    """
    early = page.early_actions if page else frozenset()
    finished = page.finished_actions if page else frozenset()
    switches = page.switches if page else {}
    shown = {binding.action for binding, _ in bindings} - finished
    actions = {binding.action for binding, enabled in bindings if enabled} & shown - early
    main = next((action for action in MAIN_ACTIONS if action in actions), "")
    top = next((action for action in MAIN_ACTIONS if action in shown), "")
    return [
        {
            "key": binding.key,
            "label": binding.description,
            "main": binding.action == main,
            "top": binding.action == top,
            "off": not enabled,
            "pressed": switches.get(binding.action),
        }
        for binding, enabled in bindings
    ]


def _blocks(widget: Widget) -> Iterator[Block]:
    """Yield the blocks in the order of the screen. A label belongs to the widget after it."""
    label = ""
    for child in widget.children:
        if not child.display or isinstance(child, Footer | Button | Picture | ToastRack):
            continue  # every button has a key as well
        if isinstance(child, Label):
            label = readable_label(str(child.content).lstrip("✗ "))
            if isinstance(widget, Row) and widget.is_assumed:
                label += f" ({widget.note})"
        elif isinstance(child, CoverageMap) and child.covered is not None:
            yield _map_block(child, child.covered)
        elif isinstance(child, Static):
            if child.id == "tasks" and isinstance(child.screen, WorkingPage):
                yield from map(_bar_block, child.screen.bars)
            if (
                text := child.flowing if isinstance(child, Prose) else str(child.content)
            ) and not _is_redundant(child):
                yield _text_block(child, text)
        elif block := _input_block(child, label):
            yield block
        else:
            yield from _blocks(child)


def _is_redundant(widget: Static) -> bool:
    drawn = (
        isinstance(widget.screen, WorkingPage)
        and bool(widget.screen.bars)
        and widget.id in ("tasks", "errors")
    )
    is_in_label = widget.has_class(ASSUMED)
    return drawn or is_in_label or widget.id in ("steps", "small", "legend")


def _bar_block(bar: Bar) -> Block:
    return {
        "kind": "bar",
        "name": bar.title,
        "label": bar.title,
        "share": round(bar.share, 3) or None,  # None: nothing is done yet
        "text": bar.words.strip(),
    }


def _map_block(widget: CoverageMap, covered: NDArray[np.float64]) -> Block:
    return {
        "kind": "map",
        "name": name_of(widget),
        "label": widget.title,
        "full": widget.full,
        "cells": np.round(covered, 2).tolist(),
    }


def _text_block(widget: Static, text: str) -> Block:
    columns = not isinstance(widget, Prose) and bool(COLUMNS.search(text.strip()))
    return {
        "kind": "text",
        "name": name_of(widget),
        "text": text if columns else text.strip(),
        "columns": columns,
        "spoken": widget.id in INSTRUCTION_IDS,
        "banner": widget.has_class("banner"),
        "tone": next((tone for tone in TONES if widget.has_class(tone)), ""),
    }


def _input_block(widget: Widget, label: str) -> Block | None:
    """Return the block of a field, a choice or a list; None for another widget."""
    half = name_of(widget) not in WIDE and any(
        isinstance(ancestor, Grid) for ancestor in widget.ancestors
    )
    about = {"name": name_of(widget), "label": label, "disabled": widget.disabled, "half": half}
    match widget:
        case Input():
            return {
                "kind": "field",
                **about,
                "value": widget.value,
                "placeholder": str(widget.placeholder).removesuffix(OR_UNKNOWN),
                "wrong": widget.has_class("wrong"),
                "suggestion": widget._suggestion,
                "unknown": UNKNOWN if isinstance(widget, NumberField) else "",
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
                "options": [str(ancestor.prompt) for ancestor in widget.options],
                "chosen": chosen,
            }
    return None
