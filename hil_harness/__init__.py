"""The loop: robot description, scenarios, effects, nodes, lockstep, real time, batch."""
