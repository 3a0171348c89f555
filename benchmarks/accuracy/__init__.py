"""How accurate the motion block is, given the right name: worlds, fits, bounds, figures, page."""
