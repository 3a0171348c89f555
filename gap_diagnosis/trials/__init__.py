"""Blind trials: data whose effect is sealed, its diagnosis, and the scores once the seal is opened.

Nothing of the diagnosis imports this package.
"""
