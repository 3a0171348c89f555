"""How far simulated and real lie apart, where along the data, and how far an explanation closes it.

Nothing here fits anything: metrics, shares and intervals of paths that others predict.
"""
