"""Sweeps: which configuration holds what is asked, and which of those is cheapest."""
