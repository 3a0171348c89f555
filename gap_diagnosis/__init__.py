"""The gap between simulated and real: where it lies, which effect causes it, how far it shrinks."""
