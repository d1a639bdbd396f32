"""One key of a cover in session.yaml, and all that the program has to know of its numbers."""

from dataclasses import dataclass

from calib.session.schema import Quantity
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class Dimension:
    """A number of a cover, or a vector of numbers."""

    quantity: Quantity
    """The key in session.yaml, with the limits of the numbers."""
    words: str
    """The words for it in a sentence, such as "the glass's thickness"."""
    explanation: str
    """The explanation for people who have never seen a session.yaml."""
    typed_explanation: str = ""
    """The explanation of an option or a field of a form, if that differs from the key's."""
    tolerance: Tolerance | None = None
    """The tolerance of a number that is stated without a sigma. None: a fit holds such a number."""
    option: str = ""
    """The name by which `--free` frees it."""
    effect: str = ""
    """The effect of the diagnosis that lets its numbers differ from the stated ones, if any."""
    usual: str = ""
    """The usual value, where there is one, as a person would write it. A form begins with it."""

    @property
    def typed(self) -> str:
        """The explanation of its option, and of its field in a form."""
        return self.typed_explanation or self.explanation

    @property
    def initial(self) -> str:
        """The first text of its field in a form: the usual value, or the default."""
        default = self.quantity.default
        if default is None:
            return self.usual
        return ", ".join(f"{default:g}" for _ in self.quantity.names)
