"""Formats of the firmware that a robot's description can ask for and no kernel can have."""

from __future__ import annotations

from error_tables.row import Row


def _robot(when: str, text: str, line: str) -> Row:
    return Row(when, "chiplog run --robot robot.toml", line, {"robot.toml": text})


FORMATS: tuple[Row, ...] = (
    _robot(
        "a number of steps that is no power of two",
        "[firmware.trig]\nentries = 1000\n",
        "robot.toml:2: firmware.trig.entries = 1000: expected a power of two, for "
        "example 512 or 1024",
    ),
    _robot(
        "a mode that does not exist",
        '[firmware]\nmode = "compass"\n',
        'robot.toml:2: firmware.mode = "compass": expected one of "wheel", "gyro", "blend"',
    ),
    Row(
        "a word wider than C's",
        "chiplog run --robot robot.toml --force --kernel c99",
        "robot.toml:2: firmware.step.word_bits = 40: expected at most 32, as many as there are in "
        "C; only --kernel python holds more, by --force",
        {"robot.toml": "[firmware.step]\nword_bits = 40\n"},
    ),
    _robot(
        "a step too long for its word",
        "[firmware.step]\nfrac_bits = 40\n",
        "robot.toml:2: firmware.step.frac_bits = 40: the longest step of a tick, 0.01927 "
        "m, does not fit 32 bits: expected at most 36",
    ),
    _robot(
        "a constant of too few bits",
        "[firmware.step]\nconstant_frac_bits = 2\n",
        "robot.toml:2: firmware.step.constant_frac_bits = 2: expected 28 to 58: no fewer "
        "than firmware.step.frac_bits keeps, no more than a product of 64 bits bears",
    ),
    _robot(
        "a constant that rounds to zero",
        "[firmware.step]\nfrac_bits = 2\nconstant_frac_bits = 5\n",
        "robot.toml:3: firmware.step.constant_frac_bits = 5: the constant 7.708e-05 m "
        "rounds to zero: expected at least 14",
    ),
    _robot(
        "a turn coarser than the heading",
        "[firmware.turn_step]\nfrac_bits = 20\n",
        "robot.toml:2: firmware.turn_step.frac_bits = 20: expected at least 32, those of "
        "firmware.heading.frac_bits",
    ),
    _robot(
        "a turn too long for its word",
        "[firmware.turn_step]\nword_bits = 16\n",
        "robot.toml:2: firmware.turn_step.word_bits = 16: the largest turn, 5.384 turn, "
        "does not fit: expected at least 52, or fewer frac_bits",
    ),
    _robot(
        "a turn that leaves 64 bits",
        "[gyro]\nsensitivity_lsb_per_rad_s = 0.1\nrange_rad_s = 1000.0\n"
        "[firmware.turn_step]\nword_bits = 63\nfrac_bits = 52\n",
        "robot.toml:6: firmware.turn_step.frac_bits = 52: a step of 3.428e+07 turn "
        "leaves 64 bits: expected at most 51; only --kernel python holds more, by --force",
    ),
    _robot(
        "a gap's turns that leave 64 bits",
        "[gyro]\nsensitivity_lsb_per_rad_s = 0.4\nrange_rad_s = 1000.0\n"
        "[firmware.turn_step]\nword_bits = 63\nfrac_bits = 52\n",
        "robot.toml:6: firmware.turn_step.frac_bits = 52: the largest turn, 132 turn, "
        "leaves 64 bits: expected at most 51; only --kernel python holds more, by --force",
    ),
    _robot(
        "a blend that leaves 64 bits",
        "[gyro]\nsensitivity_lsb_per_rad_s = 30.0\nrange_rad_s = 1000.0\n"
        '[firmware]\nmode = "blend"\n[firmware.turn_step]\nword_bits = 63\nfrac_bits = 52\n',
        "robot.toml:8: firmware.turn_step.frac_bits = 52: the blend of two turns leaves "
        "64 bits: expected at most 51; only --kernel python holds more, by --force",
    ),
    _robot(
        "a position finer than its steps",
        "[firmware.position]\nfrac_bits = 40\n[firmware.trig]\nfrac_bits = 8\n",
        "robot.toml:2: firmware.position.frac_bits = 40: expected at most 36, what "
        "step.frac_bits and trig.frac_bits give together",
    ),
    _robot(
        "a position far coarser than its steps",
        "[firmware.position]\nfrac_bits = 0\n[firmware.step]\nfrac_bits = 32\n",
        "robot.toml:2: firmware.position.frac_bits = 0: expected at least 1, given "
        "step.frac_bits and trig.frac_bits; only --kernel python holds more, by --force",
    ),
    _robot(
        "a position's word too short for a step",
        "[firmware.position]\nword_bits = 16\n",
        "robot.toml:2: firmware.position.word_bits = 16: the longest step of a tick, "
        "0.01927 m, does not fit: expected at least 28, or fewer frac_bits",
    ),
    Row(
        "a position's word too short for the drive",
        "chiplog run --scenario straight --robot robot.toml",
        "robot.toml:2: firmware.position.word_bits = 25: 10.01 m by the wheels do not fit with 21 "
        "fraction bits: expected at least 26 bits",
        {"robot.toml": "[firmware.position]\nword_bits = 25\nfrac_bits = 21\n"},
    ),
    Row(
        "a position's word too short for the mission",
        "chiplog export-c --robot robot.toml",
        "robot.toml:2: firmware.position.word_bits = 25: 5427 m in a mission of 3600 s do not fit "
        "with 21 fraction bits: expected at least 35 bits, or less in [design]",
        {"robot.toml": "[firmware.position]\nword_bits = 25\nfrac_bits = 21\n"},
    ),
    _robot(
        "a firmware made for another tick",
        "[design]\ntick_period_us = 2500\n",
        "robot.toml:2: design.tick_period_us = 2500: the tick of chiplog.dbc is 10000 µs: expected "
        "--dbc with the tick that the firmware was made for",
    ),
    _robot(
        "a velocity finer than its steps",
        "[firmware.velocity]\nfrac_bits = 24\n[firmware.step]\nfrac_bits = 2\n",
        "robot.toml:2: firmware.velocity.frac_bits = 24: expected at most 18, given step.frac_bits",
    ),
    _robot(
        "a velocity finer than its turns",
        "[firmware.velocity]\nfrac_bits = 24\n[firmware.heading]\nfrac_bits = 4\n"
        "[firmware.turn_step]\nfrac_bits = 4\n",
        "robot.toml:2: firmware.velocity.frac_bits = 24: expected at most 20, given "
        "turn_step.frac_bits",
    ),
    _robot(
        "a turn rate that its 32 bits do not hold",
        "[wheels]\nradius_m = 0.02\nwheelbase_m = 0.05\n[drive]\nmax_wheel_rate_rad_s = 200.0\n"
        "[firmware.velocity]\nfrac_bits = 24\n",
        "robot.toml:7: firmware.velocity.frac_bits = 24: the fastest turn, 200.5 rad/s, does not "
        "fit 32 bits: expected at most 23",
    ),
    _robot(
        "a filter that leaves 64 bits",
        "[gyro]\nsensitivity_lsb_per_rad_s = 30.0\nrange_rad_s = 1000.0\n"
        "[firmware.turn_step]\nword_bits = 63\nfrac_bits = 52\n"
        "[firmware.velocity]\nfilter_log2 = 8\n",
        "robot.toml:8: firmware.velocity.filter_log2 = 8: the filter of the largest turn "
        "leaves 64 bits: expected at most 7, or fewer turn_step.frac_bits; only --kernel python "
        "holds more, by --force",
    ),
    _robot(
        "a longest average shorter than the first",
        "[firmware.standstill]\nmax_log2 = 3\n",
        "robot.toml:2: firmware.standstill.max_log2 = 3: expected at least 7, that of "
        "firmware.standstill.block_log2",
    ),
    _robot(
        "a code beyond the converter",
        "[adc]\nbits = 12\n",
        "robot.toml:2: gyro.zero_rate_code = 32768: expected at most 4095, the largest "
        "code of adc.bits = 12",
    ),
    _robot(
        "a gyro range of less than a code",
        "[gyro]\nrange_rad_s = 1e-5\n",
        "robot.toml:2: gyro.range_rad_s = 1e-05: 0.075 LSB: expected a range of at least "
        "one code of gyro.sensitivity_lsb_per_rad_s",
    ),
    _robot(
        "a gyro whose rest is no code",
        "[gyro]\nzero_rate_code = 0\n",
        "robot.toml: gyro_zero_rate_code = 0: expected a code between gyro_min_code = 0 "
        "and gyro_max_code = 32750",
    ),
    _robot(
        "a wheel too fast for its counter",
        "[encoder]\ncounter_bits = 8\nticks_per_rev = 65535\n",
        "robot.toml:2: at drive.max_wheel_rate_rad_s = 30 a wheel makes 3129 ticks in "
        "10000 µs, and 8 bits tell directions apart below 128: expected more "
        "encoder.counter_bits, fewer encoder.ticks_per_rev or a slower drive",
    ),
    _robot(
        "a wheel too fast for its counter with the margin",
        "[encoder]\ncounter_bits = 8\n[drive]\nmax_wheel_rate_rad_s = 36\n",
        "robot.toml:4: max_wheel_rate_rad_s = 36: 149 encoder ticks in one tick of 0.01 "
        "s, but a counter of 8 bits tells at most 127 apart: expected a wider counter, "
        "fewer ticks_per_rev, a shorter tick or a slower wheel",
    ),
    _robot(
        "a counter whose noise makes a way forward one backward",
        "[encoder]\ncounter_bits = 8\nnoise_ticks = 3.0\n",
        "robot.toml:2: encoder.counter_bits = 8: with noise a wheel counts up to 134 in a gap of 1 "
        "tick, of which 8 bits make 122 backward that are believed: expected at least 9, less "
        "encoder.noise_ticks or a slower wheel",
    ),
)
