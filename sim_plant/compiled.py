"""How the functions of a tick are compiled."""

from numba import njit

# Part of its caller, so that the compiler sees a tick as a whole. numpy's division: no exception on
# the way, and validated parameters never divide by zero. No fast-math, here or anywhere.
inlined = njit(error_model="numpy", forceinline=True)
