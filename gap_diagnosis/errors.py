"""What goes wrong in a diagnosis, in one line a person can act on."""


class DiagnosisError(ValueError):
    """Data that cannot be diagnosed, or settings that contradict it.

    `str(error)` is one line: what was wrong, where, and what would be right.
    """
