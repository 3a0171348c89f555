"""The ECU: an integer-only dead-reckoning kernel and its float64 twin."""
