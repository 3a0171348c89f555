"""What can go wrong when a firmware is configured or driven."""


class FirmwareError(ValueError):
    """A wrong configuration or argument; the text is one line with what would be right."""
