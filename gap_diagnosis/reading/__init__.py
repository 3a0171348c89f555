"""Logs, tables and reference trajectories, read into recordings."""

from gap_diagnosis.reading.recordings import read_recording, read_recordings
from gap_diagnosis.reading.reference_file import read_reference

__all__ = ["read_recording", "read_recordings", "read_reference"]
