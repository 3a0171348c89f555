"""Imported first where imports cost most: python-can then does without asammdf.

It and what it imports are most of the time that python-can takes.
"""

import sys

sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # bars the import
