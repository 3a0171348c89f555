"""Logs of bus traffic: candump, ASC and BLF, written while running and read back."""
