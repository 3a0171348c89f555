"""What can go wrong when a plant is described or driven."""


class PlantError(ValueError):
    """A wrong description, mechanism or argument; the text is one line with what would be right."""
