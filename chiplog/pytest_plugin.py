"""The pytest plugin: imports nothing heavy until a fixture is asked for."""
