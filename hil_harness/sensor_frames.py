"""From what the plant's sensors read to frames of any DBC."""

from collections.abc import Callable
from operator import itemgetter
from typing import Final, cast

from can_bus import MessageSpec, protect
from can_bus.signals import Raw
from hil_harness.errors import HarnessError
from hil_harness.signal_map import MappedSignal, SignalMap
from hil_harness.signal_roles import Role
from hil_harness.wheel_counter import count_to_raw
from sim_plant import PlantDescription, SensorCounts

SENSOR_ROLES: Final[tuple[Role, ...]] = (
    "left_count",
    "right_count",
    "gyro",
    "accel_x",
    "accel_y",
    "temperature",
    "supply",
)
"""Roles that the plant fills, in the order of ``SensorCounts``."""

_T_REFERENCE_K: Final = 298.15

Reader = Callable[[SensorCounts], Raw]


class SensorFrames:
    """Writes the plant's readings into frames, as the sensors' own electronics would.

    A quantity in a unit is computed from the code by the *described* sensitivity, rounded to the
    signal's step, and stops at the ends of the signal's range as the real sensor does.

    Raises HarnessError for a signal that cannot carry its sensor.
    """

    def __init__(self, signal_map: SignalMap, plant: PlantDescription) -> None:
        """Prepare one reader per signal."""
        self.messages = signal_map.messages(SENSOR_ROLES)
        self._readers: dict[str, tuple[tuple[str, Raw | Reader], ...]] = {}
        by_signal = {
            mapped.path: (index, mapped)
            for index, role in enumerate(SENSOR_ROLES)
            if (mapped := signal_map.get(role)) is not None
        }
        for message in self.messages:
            self._readers[message.name] = tuple(
                (signal.name, _reader(*by_signal[signal.path], plant))
                if signal.path in by_signal
                else (signal.name, signal.initial_raw)
                for signal in message.payload
            )

        # A plain message has no float signal: its counts and codes are whole numbers.
        self._plain_readers = {
            message.name: [_whole(source) for _, source in self._readers[message.name]]
            for message in self.messages
            if message.is_plain
        }

    def raw_values(self, message: MessageSpec, counts: SensorCounts) -> dict[str, Raw]:
        """Return the raw value of each signal of *message*; those without a role stand as started.

        Wheel counters on foreign buses are followed across their wraps: each message must be asked
        for often enough that a wheel makes less than half a counter between two calls.
        """
        return {
            name: source(counts) if callable(source) else source
            for name, source in self._readers[message.name]
        }

    def encode(self, message: MessageSpec, counts: SensorCounts, counter: int) -> bytearray:
        """Return the frame of *message* with *counter* and CRC where it is protected."""
        plain = self._plain_readers.get(message.name)
        if plain is not None:
            values = [read(counts) for read in plain]
            return message.pack(values, None if message.e2e is None else counter)
        raw = self.raw_values(message, counts)
        data = message.encode_raw(raw)
        if message.e2e is not None:
            protect(message, data, counter)
        return data


def _whole(source: Raw | Reader) -> Callable[[SensorCounts], int]:
    if callable(source):
        return cast(Callable[[SensorCounts], int], source)
    constant = int(source)
    return lambda counts: constant


def _reader(index: int, mapped: MappedSignal, plant: PlantDescription) -> Reader:
    read: Callable[[SensorCounts], int] = itemgetter(index)
    if mapped.role in {"left_count", "right_count"}:
        convert = count_to_raw(mapped, plant)
        return read if convert is None else lambda counts: convert(read(counts))
    if mapped.kind == "adc_code":
        return _code_reader(read, mapped, plant)
    return _quantity_reader(read, mapped, plant)


def _code_reader(
    read: Callable[[SensorCounts], int], mapped: MappedSignal, plant: PlantDescription
) -> Reader:
    signal = mapped.signal
    if signal.low_raw > 0 or signal.high_raw < plant.adc.max_code:
        raise HarnessError(
            f"{signal.path} holds codes from {signal.low_raw} to {signal.high_raw}, the robot's "
            f"ADC gives 0 to {plant.adc.max_code}: expected adc.bits = "
            f"{max((signal.high_raw + 1).bit_length() - 1, 1)} in robot.toml, or a wider signal"
        )
    return read


def _quantity_reader(
    read: Callable[[SensorCounts], int], mapped: MappedSignal, plant: PlantDescription
) -> Reader:
    si_per_code, si_at_zero = code_scale(mapped.role, plant)
    signal = mapped.signal
    step = si_per_code / mapped.si_per_lsb
    start = ((si_at_zero - mapped.si_offset) / mapped.si_factor - signal.offset) / signal.factor
    if signal.is_float:
        return lambda counts: read(counts) * step + start
    low, high = signal.low_raw, signal.high_raw
    return lambda counts: min(max(round(read(counts) * step + start), low), high)


def code_scale(role: Role, plant: PlantDescription) -> tuple[float, float]:
    """Return what a sensor's code means as described: SI per code, and SI at code 0."""
    match role:
        case "gyro":
            per_code = 1 / plant.gyro.sensitivity_lsb_per_rad_s
            return per_code, -plant.gyro.zero_rate_code * per_code
        case "accel_x" | "accel_y":
            per_code = 1 / plant.accelerometer.sensitivity_lsb_per_m_s2
            return per_code, -plant.accelerometer.zero_code * per_code
        case "temperature":
            per_code = 1 / plant.temperature.sensitivity_lsb_per_k
            return per_code, _T_REFERENCE_K - plant.temperature.code_at_298_k * per_code
        case "supply":
            return 1 / plant.supply.sensitivity_lsb_per_v, 0.0
        case _:
            raise HarnessError(f"{role} is no sensor behind the ADC")
