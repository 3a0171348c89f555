"""Imported first where imports cost most: python-can then does without asammdf, as our commands do."""

import sys

sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # bars the import
