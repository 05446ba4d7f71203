"""Exit statuses, and the one exception by which a verb ends early with words for the user."""

from __future__ import annotations

EXIT_GOOD = 0
EXIT_REFUSED = 1
EXIT_FAULT = 2


class VerbError(Exception):
    """End with ``status`` after printing ``text`` on stderr. 1: the input was refused; 2: the environment failed."""

    def __init__(self, text: str, status: int = EXIT_REFUSED) -> None:
        super().__init__(text)
        self.text = text
        self.status = status
