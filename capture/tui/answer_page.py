"""A page whose process ends with an answer in words, which may be longer than the screen."""

from textual.binding import Binding

from capture.tui.child import Event
from capture.tui.working_page import WorkingPage

SCROLL = (
    Binding("up", "scroll(-1)", "Up", key_display="↑"),
    Binding("down", "scroll(1)", "Down", key_display="↓"),
)


class AnswerPage(WorkingPage):
    """A page that shows the `text` of its process's result, and can start again until there is one.

    A subclass binds SCROLL among its keys.
    """

    def __init__(self) -> None:
        super().__init__()
        self.result: Event = {}
        """The result of the process; empty until it has ended."""

    def step(self) -> str:
        return "Results"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        match action:
            case "scroll":
                return bool(self.result)
            case "again":
                return self.child is None and not self.result
        return super().check_action(action, parameters)

    def finished(self, result: Event) -> None:
        self.result = result
        self.refresh_bindings()
        self.show(result["text"])

    def action_scroll(self, by: int) -> None:
        self.query_one("VerticalScroll").scroll_relative(y=by, animate=False)
