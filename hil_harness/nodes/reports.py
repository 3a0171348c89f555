"""What the firmware reports besides the pose: velocity and status, in the shipped DBC's words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction

from can_bus import Database, MessageSpec, Raw, SignalSpec
from firmware_model import Kernel, StatusBit
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.signal_map import SignalMap

Source = Callable[[], Raw]

_REPORTS: Mapping[str, frozenset[str]] = {
    "ODOMETRY_VELOCITY": frozenset({"v_m_s", "w_rad_s"}),
    "STATUS": frozenset(
        {str(bit.name).lower() for bit in StatusBit} | {"mode", "heading_source", "gyro_offset_raw"}
    ),
}
"""Messages without a role, and the signals by which they are known to be ours."""


def firmware_messages(database: Database, signal_map: SignalMap) -> tuple[MessageSpec, ...]:
    """Return all that the firmware sends: odometry by the map, and the reports beside it.

    A report counts only when the sender of the odometry sends it and it has the shipped DBC's
    signals: many a foreign DBC has a STATUS of somebody else's.
    """
    odometry = signal_map.messages(ODOMETRY_ROLES)
    senders = {sender for spec in odometry for sender in spec.senders}
    reports = (
        spec
        for name, signals in _REPORTS.items()
        if (spec := database.messages.get(name)) is not None
        and spec not in odometry
        and senders & set(spec.senders)
        and signals <= set(spec.signals)
    )
    return (*odometry, *reports)


def report_values(spec: MessageSpec, kernel: Kernel) -> Mapping[str, Source]:
    """Return the source of each signal of a report."""
    return (
        velocity_values(spec, kernel)
        if spec.name == "ODOMETRY_VELOCITY"
        else (status_values(spec, kernel))
    )


def velocity_values(spec: MessageSpec, kernel: Kernel) -> Mapping[str, Source]:
    """Return the source of each signal of ODOMETRY_VELOCITY."""
    unit = Fraction(1, 1 << kernel.config.velocity_frac_bits)
    return {
        "v_m_s": _rescaled(
            spec.signal("v_m_s"), lambda: kernel.v_m_s_q if kernel.v_is_valid else None, unit
        ),
        "w_rad_s": _rescaled(
            spec.signal("w_rad_s"), lambda: kernel.w_rad_s_q if kernel.w_is_valid else None, unit
        ),
    }


def status_values(spec: MessageSpec, kernel: Kernel) -> Mapping[str, Source]:
    """Return the source of each signal of STATUS: one per status bit, mode, source, gyro offset."""
    values: dict[str, Source] = {
        str(bit.name).lower(): _status_bit(kernel, bit) for bit in StatusBit
    }
    values["mode"] = lambda: kernel.config.mode
    values["heading_source"] = lambda: kernel.heading_source
    values["gyro_offset_raw"] = _rescaled(
        spec.signal("gyro_offset_raw"),
        lambda: kernel.gyro_offset_q,
        Fraction(1, 1 << kernel.config.offset_frac_bits),
    )
    return values


def _status_bit(kernel: Kernel, bit: StatusBit) -> Source:
    shift = bit.value.bit_length() - 1
    return lambda: kernel.status_word >> shift & 1


def _rescaled(signal: SignalSpec, value: Callable[[], int | None], unit: Fraction) -> Source:
    """Return the value in the signal's steps, rounded half up; out of range it is not available."""
    ratio = unit / Fraction(signal.factor)
    numerator, denominator = ratio.numerator, ratio.denominator
    low, high = signal.low_raw, signal.high_raw
    invalid = signal.initial_raw if signal.invalid_raw is None else signal.invalid_raw

    def raw() -> Raw:
        now = value()
        if now is None:
            return invalid
        scaled = (now * numerator + denominator // 2) // denominator
        return scaled if low <= scaled <= high else invalid

    return raw
