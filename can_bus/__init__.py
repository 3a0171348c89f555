"""The wire: codec, python-can backends, faults, end-to-end protection, logs."""
