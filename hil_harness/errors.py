"""The one error of the harness: something a person gave us is wrong."""


class HarnessError(ValueError):
    """One line that says what is wrong, where, and what would be right.

    Attributes:
        problems: every problem found in the same input, one line each, the first of them
            being the one that ``str(error)`` shows.
    """

    def __init__(self, message: str, problems: tuple[str, ...] = ()) -> None:
        """Keep *message* (one line) and, where there are several, all *problems*."""
        super().__init__(message)
        self.problems = problems or (message,)
