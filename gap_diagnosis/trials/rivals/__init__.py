"""What the diagnosis is measured against: each file is a method for ``chiplog blind run``."""
