"""What goes wrong in a study, in one line a person can act on."""


class StudyError(ValueError):
    """A question that cannot be answered; the text is one line with what would be right."""
