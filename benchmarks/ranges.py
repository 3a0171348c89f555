"""Counts what `chiplog ranges` says of x and y of random firmwares: proved, shown, or neither.

    .venv/bin/python benchmarks/ranges.py 60 1        60 of seed 1

Steps are made coarse (2^-2 to 2^-11 m) and words up to three bits narrower than what is proved, so
that remainders, trembling and rounding decide. Each that is neither is printed, with its bound as a
multiple of what the word holds.
"""

from __future__ import annotations

import random
import sys
from collections import Counter
from typing import Any, Final

from firmware_model import FirmwareConstants, FirmwareDescription, FirmwareError, build_config
from precision_study.ranges import Envelope, find_ranges, intermediates

ROUNDINGS: Final = ("floor", "half_up", "half_even", "toward_zero")
Table = dict[str, Any]


def main() -> None:
    """Print each that is neither proved nor shown, and the counts."""
    count, generator = int(sys.argv[1]), random.Random(int(sys.argv[2]))
    said: Counter[str] = Counter()
    while said.total() < count:
        known, table, limits = _robot(generator), _firmware(generator), _limits(generator)
        narrower = generator.choice((0, 1, 1, 1, 2, 2, 3))
        try:
            wide = build_config(_description(table, 60), known, allow_overflow=True)
            rows = intermediates(wide, Envelope.of(wide, **limits))
            (need,) = (one.least_word_bits for one in rows if one.word == "position")
            description = _description(table, max(need - narrower, 8))
            config = build_config(description, known, allow_overflow=True)
        except FirmwareError:
            continue  # formats that do not go together
        if config.beyond_c:
            continue  # nor in 64 bits
        found = find_ranges(config, Envelope.of(config, **limits))
        (one,) = (one for one in found if one.intermediate.word == "position")
        said[one.verdict] += 1
        if one.verdict not in ("impossible", "overflows"):
            excess = one.intermediate.bound / (config.position_high_q + 1)
            print(
                f"{one.verdict}: {excess:.3f} times the word, {limits}, {description}", flush=True
            )
    print(dict(said))


def _robot(generator: random.Random) -> FirmwareConstants:
    """Return a robot of any size and sensors."""
    pick, draw = generator.choice, generator.uniform
    return FirmwareConstants(
        wheel_radius_m=draw(0.01, 0.5),
        wheelbase_m=draw(0.1, 3.0),
        ticks_per_rev=pick((60, 360, 2048, 8192)),
        counter_bits=16,
        tick_period_s=pick((0.001, 0.01, 0.02)),
        gyro_sensitivity_rad_s_per_lsb=draw(1e-5, 1e-2),
        gyro_zero_rate_code=32768,
        gyro_min_code=18,
        gyro_max_code=65518,
        max_wheel_rate_rad_s=pick((3.0, 30.0, 100.0)),
    )


def _firmware(generator: random.Random) -> Table:
    """Return formats whose step is coarse and carried."""
    pick, draw = generator.choice, generator.randint

    def format_(least: int, most: int, carry: bool) -> Table:
        bits, rounding = draw(least, most), pick(ROUNDINGS)
        return {"frac_bits": bits, "rounding": rounding, "carry_remainder": carry}

    return {
        "mode": pick(("wheel", "gyro", "blend")),
        "integration": pick(("euler_before", "midpoint", "euler_after")),
        "position": format_(4, 30, pick((True, False))),
        "step": format_(2, 11, True) | {"word_bits": draw(24, 32)},
        "turn_step": format_(32, 48, pick((True, False))) | {"word_bits": draw(24, 64)},
        "trig": {
            "method": pick(("table", "cordic")),
            "entries": pick((1, 16, 1024)),
            "iterations": draw(1, 30),
            "interpolated": pick((True, False)),
        },
    }


def _limits(generator: random.Random) -> Table:
    pick = generator.choice
    return {
        "mission_s": pick((2.0, 20.0, 200.0, 1000.0)),
        "distance_m": pick((None, None, 1.0, 20.0)),
        "acceleration_rad_s2": pick((None, 5.0, 60.0)),
        "turn_rate_rad_s": pick((None, 0.5, 3.0)),
    }


def _description(table: Table, word_bits: int) -> FirmwareDescription:
    return FirmwareDescription.from_table(
        table | {"position": table["position"] | {"word_bits": word_bits}}
    )


if __name__ == "__main__":
    main()
