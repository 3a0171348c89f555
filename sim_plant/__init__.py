"""The world and its sensors: SI floats inside, raw counts out."""
