"""Stage bus: timing, loss and clocks between the sensors and whoever receives or logs them."""

from __future__ import annotations

from typing import Final

from can_bus import SENSORS
from hil_harness.effects.model import Effect, EffectParameter, Settings, Twins, Typical, Values
from hil_harness.effects.sources import BOSCH_CAN, KOBUKI, ROBOJACKETS

_FRAME: Final = EffectParameter(
    "frame",
    "",
    SENSORS,
    f"name of the message; {SENSORS}: every message that carries a sensor",
    kind="message",
)


def _level(
    name: str, unit: str, meaning: str, typical: Typical | None = None, *, maximum: float
) -> EffectParameter:
    return EffectParameter(name, unit, 0.0, meaning, minimum=0.0, maximum=maximum, typical=typical)


def _frame_latency(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(latency_frame=values["frame"], latency_s=values["delay"])


def _frame_jitter(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(jitter_frame=values["frame"], jitter_s=values["sigma"])


def _frame_loss(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(
        loss_frame=values["frame"],
        loss_probability=values["probability"],
        loss_burst=values["burst"],
    )


def _frame_duplication(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(
        duplication_frame=values["frame"], duplication_probability=values["probability"]
    )


def _frame_reordering(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(
        reordering_frame=values["frame"], reordering_probability=values["probability"]
    )


def _stale_producer(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(
        stale_frame=values["frame"],
        stale_cycles=values["cycles"],
        stale_probability=values["probability"],
    )


def _clock_skew(settings: Settings, values: Values) -> Settings:
    return settings.with_plant(clock_skew=values["skew"])


def _reception_stamp(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(
        poll_frame=values["frame"],
        poll_delay_s=values["delay"],
        poll_period_s=values["period"],
    )


def _bus_gap(settings: Settings, values: Values) -> Settings:
    return settings.with_bus(gap_start_s=values["start_s"], gap_stop_s=values["stop_s"])


EFFECTS: Final[tuple[Effect, ...]] = (
    Effect(
        "frame_latency",
        "bus",
        (
            _FRAME,
            _level(
                "delay",
                "s",
                "arrival (and stamp) later than sampling by this constant",
                Typical(0.0003, 0.02, f"{BOSCH_CAN}; gateways"),
                maximum=10.0,
            ),
        ),
        "The pose lags by speed and turn rate times the delay: antisymmetric in the acceleration, "
        "nothing at rest.",
        _frame_latency,
        twins=(
            Twins(("reference_time_offset",), "on all sensor frames (opposite sign)"),
            Twins(("gyro_lag",), "turns are slow; of the gyro's frame"),
            Twins(("reception_stamp",), "the period is 0"),
        ),
    ),
    Effect(
        "frame_jitter",
        "bus",
        (
            _FRAME,
            _level(
                "sigma",
                "s",
                "standard deviation of the delay about its mean",
                Typical(0.0009, 0.0034, KOBUKI),
                maximum=1.0,
            ),
        ),
        "Stamps scatter late about the ECU's even ticks; counts that are cumulative do not drift.",
        _frame_jitter,
        is_noise=True,
    ),
    Effect(
        "frame_loss",
        "bus",
        (
            _FRAME,
            _level(
                "probability",
                "1",
                "share of the frames that never arrive",
                Typical(1e-6, 0.01, "engineering estimate"),
                maximum=1.0,
            ),
            EffectParameter(
                "burst",
                "1",
                1.0,
                "mean number of frames lost in a row; 1: each by itself",
                minimum=1.0,
                maximum=1e6,
            ),
        ),
        "Alive counters jump; cumulative counts lose nothing, the gyro's turn of the tick is gone.",
        _frame_loss,
    ),
    Effect(
        "frame_duplication",
        "bus",
        (_FRAME, _level("probability", "1", "a frame comes twice", maximum=1.0)),
        "The same alive counter twice in a row.",
        _frame_duplication,
    ),
    Effect(
        "frame_reordering",
        "bus",
        (_FRAME, _level("probability", "1", "a frame comes after its successor", maximum=1.0)),
        "Alive counters step back by one, in pairs.",
        _frame_reordering,
    ),
    Effect(
        "stale_producer",
        "bus",
        (
            _FRAME,
            EffectParameter(
                "cycles",
                "1",
                0,
                "the payload is repeated for so many cycles",
                kind="whole",
                minimum=0,
                maximum=10_000,
            ),
            _level("probability", "1", "chance per cycle that this begins", maximum=1.0),
        ),
        "Payloads repeat while the alive counter goes on; then the counts jump to where they are.",
        _stale_producer,
    ),
    Effect(
        "clock_skew",
        "bus",
        (
            EffectParameter(
                "skew",
                "1",
                0.0,
                "ECU clock rate over log clock rate − 1; + is a fast ECU clock",
                minimum=-0.05,
                maximum=0.05,
                typical=Typical(1e-5, 0.0132, f"{KOBUKI}; {BOSCH_CAN}"),
            ),
        ),
        "Ticks come closer together than described: all that is multiplied by the tick period "
        "grows by the same share, and the lag against the log's clock grows with time.",
        _clock_skew,
    ),
    Effect(
        "reception_stamp",
        "bus",
        (
            _FRAME,
            _level("delay", "s", "from sampling until it can be polled", maximum=10.0),
            _level(
                "period",
                "s",
                "frames are stamped at multiples of this, when they are polled",
                Typical(0.001, 0.02, ROBOJACKETS),
                maximum=10.0,
            ),
        ),
        "Stamps fall on the grid of whoever polls: a delay that saws between nothing and a period.",
        _reception_stamp,
        twins=(Twins(("frame_latency", "frame_jitter")),),
    ),
    Effect(
        "bus_gap",
        "bus",
        (
            EffectParameter("start_s", "s", float("inf"), "bus off from here"),
            EffectParameter("stop_s", "s", float("inf"), "until here"),
        ),
        "No frame of any message for a while; a gap of 10 to 500 ms is a bus-off.",
        _bus_gap,
    ),
)
