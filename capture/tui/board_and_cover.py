"""The form for board and cover: its fields follow from the board's type and the cover's shape."""

from collections.abc import Iterable, Mapping, Sequence

from textual.app import ComposeResult
from textual.containers import Grid, Vertical
from textual.events import Key
from textual.suggester import SuggestFromList
from textual.widgets import Input, Select, Static

from calib.session.coding import DICTIONARIES
from calib.session.schema import UNKNOWN
from calib.session.shapes.registry import find_shape, stated_shape_names
from capture.tui.corrected_fields import label_of
from capture.tui.form import BOARD, UNKNOWN_KEY, FormTexts
from capture.tui.page import Field
from capture.tui.row import ASSUMED, NEEDED, Row

BOARDS = {
    "checkerboard": {},
    "charuco": {"dictionary": "DICT_4X4_250", "legacy_pattern": "no"},
    "aprilgrid": {"spacing": "0.3"},
    "gridboard": {"spacing": "0.3", "dictionary": "DICT_4X4_250"},
}
"""The initial texts of the form, for each type of board."""


def _initial_texts(shape: str) -> dict[str, str]:
    """Return the first texts of a cover's fields: who does not know the shape hardly knows a
    number.
    """
    texts = {entry.quantity.key: entry.initial for entry in find_shape(shape).keys}
    if shape != UNKNOWN:
        return texts
    return {key: text or UNKNOWN for key, text in texts.items()}


OR_UNKNOWN = f", or {UNKNOWN_KEY}"
NEEDED_OF_COVER = {
    entry.quantity.key
    for shape in stated_shape_names()
    for entry in find_shape(shape).keys
    if entry.quantity.default is None
}
"""The keys of covers without a default value."""
EMPTY_FORM = FormTexts(BOARDS["checkerboard"], UNKNOWN, _initial_texts(UNKNOWN))
"""The form before anything is typed. No shape of the cover is usual, so that none is assumed."""
NOT_CHOSEN = "not chosen"
"""The word behind the shape of the cover until a person chooses one."""


class NumberField(Field):
    """A field for a number that a person may not know."""

    async def on_key(self, event: Key) -> None:
        if event.character == UNKNOWN_KEY:
            event.stop()
            event.prevent_default()
            self.replace(UNKNOWN, *self.selection)
        else:
            await super().on_key(event)


class BoardAndCover(Vertical):
    DEFAULT_CSS = """
    BoardAndCover { height: auto; }
    BoardAndCover.-locked Row { opacity: 60%; }
    BoardAndCover Grid { grid-size: 2; grid-rows: 1; grid-gutter: 0 1; height: auto; }
    """

    def __init__(self) -> None:
        super().__init__()
        self._outer: tuple[Mapping[str, object], ...] = ()
        """The covers outside of this one, as session.yaml has them."""
        self._unusual: Mapping[str, object] = {}
        """The board's keys without a field, as session.yaml has them."""
        self._typed_cover: dict[str, str] = {}
        """What was typed for covers of any shape: a change of the shape keeps it."""
        self._kind = _choice(label_of("kind"), "kind", BOARD, EMPTY_FORM.kind)
        self._shape = _choice(
            label_of("shape"), "shape", stated_shape_names(), EMPTY_FORM.shape, NOT_CHOSEN
        )

    def compose(self) -> ComposeResult:
        yield self._kind
        yield Grid(id="board")
        yield self._shape
        yield Grid(id="cover")
        note = Static(id="outer", markup=False)
        note.display = False
        yield note

    @property
    def kind(self) -> str:
        return str(self._kind.field.value)

    @property
    def shape(self) -> str:
        return str(self._shape.field.value)

    @property
    def filled(self) -> bool:
        """True once the form has fields."""
        return bool(self.query("#board Input"))

    @property
    def first(self) -> Input:
        """The first field of the board."""
        return self.query("#board Input").first(Input)

    @property
    def typed(self) -> FormTexts:
        texts = {field.name or "": field.value for field in self.query(Input)}
        board = {key: texts.get(key, "") for key in BOARD[self.kind]}
        cover = {key: texts.get(key, "") for key in _keys(self.shape)}
        outer = self._outer if cover else ()
        return FormTexts(board, self.shape, cover, self.kind, outer, self._unusual)

    async def show(self, typed: FormTexts, *, stated: bool = True) -> None:
        """Show these texts. `stated` is False if those that equal the first texts of an empty form
        are assumptions of the program.
        """
        board, cover = ({}, {}) if stated else (BOARDS[typed.kind], _initial_texts(typed.shape))
        await self._show_fields("#board", BOARD[typed.kind], typed.board, board)
        await self._show_fields("#cover", _keys(typed.shape), typed.cover, cover)
        self._kind.field.value, self._shape.field.value = typed.kind, typed.shape
        self._kind.assume("" if stated else EMPTY_FORM.kind)
        self._shape.assume("" if stated else EMPTY_FORM.shape)
        self._show_outer(typed.outer)
        self._unusual = typed.unusual

    async def reshape(self) -> None:
        """Show the fields of the chosen type and shape, if they are not on the screen yet."""
        if self._names("#board") != list(BOARD[self.kind]):
            texts = BOARDS[self.kind]
            await self._show_fields("#board", BOARD[self.kind], texts, texts)
        if self._names("#cover") != _keys(self.shape):
            for row in self.query("#cover Row").results(Row):
                if row.field.name and row.field.value and not row.is_assumed:
                    self._typed_cover[row.field.name] = str(row.field.value)
            initial_texts = _initial_texts(self.shape)
            cover_texts = initial_texts | self._typed_cover
            await self._show_fields("#cover", _keys(self.shape), cover_texts, initial_texts)
            self._show_outer(self._outer)

    def _show_outer(self, outer: tuple[Mapping[str, object], ...]) -> None:
        """Show the covers outside of this one, which cannot be changed here."""
        self._outer = outer
        note = self.query_one("#outer", Static)
        note.display = bool(outer) and bool(_keys(self.shape))
        shapes = ", then ".join(find_shape(str(cover.get("shape"))).words for cover in outer)
        note.update(f"outside of it: {shapes}, as in the session that it is taken from")

    def set_locked(self, locked: bool) -> None:
        self.set_class(locked, "-locked")
        for widget in self.query("Input, Select"):
            widget.disabled = locked

    def _names(self, place: str) -> list[str | None]:
        return [field.name for field in self.query(f"{place} Input")]

    async def _show_fields(
        self,
        place: str,
        keys: Sequence[str],
        texts: Mapping[str, str],
        assumptions: Mapping[str, str],
    ) -> None:
        grid = self.query_one(place, Grid)
        async with self.batch():
            await grid.remove_children()
            create = _field if place == "#board" else _number_field
            await grid.mount_all(
                Row(key, create(key, texts.get(key, "")), assumptions.get(key, "")) for key in keys
            )


def _choice(label: str, key: str, names: Iterable[str], first: str, note: str = ASSUMED) -> Row:
    """Return the row of a choice, in which the program assumes the first one, with a note."""
    options = [(name, name) for name in names]
    choice = Select(options, value=first, allow_blank=False, id=key, compact=True)
    return Row(label, choice, first, note)


def _keys(shape: str) -> list[str]:
    return [dimension.quantity.key for dimension in find_shape(shape).keys]


def _field(key: str, text: str) -> Field:
    suggested = SuggestFromList(DICTIONARIES, case_sensitive=False) if key == "dictionary" else None
    return Field(text, name=key, placeholder=NEEDED, suggester=suggested, compact=True)


def _number_field(key: str, text: str) -> Field:
    placeholder = f"{NEEDED}{OR_UNKNOWN}" if key in NEEDED_OF_COVER else ""
    return NumberField(text, name=key, placeholder=placeholder, compact=True)
