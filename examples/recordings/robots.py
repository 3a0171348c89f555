"""What is known of the recorded robots, as robot.toml."""

_KOBUKI_BODY = """\
[wheels]
radius_m = 0.0349955  # 35 mm, times 2578/2578.33: a turn here has a whole number of ticks
wheelbase_m = 0.230

[encoder]
ticks_per_rev = 2578
counter_bits = 16

[drive]
max_wheel_rate_rad_s = 20.0  # 0.7 m/s
"""

KOBUKI = f"""\
# Yujin Kobuki, as its maker describes it: wheels of 35 mm, 230 mm apart, 2578.33 ticks a turn.
schema = 1

[robot]
name = "Kobuki"

{_KOBUKI_BODY}
[gyro]
sensitivity_lsb_per_rad_s = 6548.0890  # 8.75 m°/s per digit, as in the driver
zero_rate_code = 32768                 # the table's codes are digits + 32768
range_rad_s = 4.363323                 # 250 °/s
noise_density_rad_per_sqrt_s = 0.0005
"""

LAWNMOWER = """\
# A lawnmower of which only distance and heading increments were recorded: radius, wheelbase and
# ticks are any numbers, as the table has the distances of two wheels this far apart.
schema = 1

[robot]
name = "lawnmower"

[wheels]
radius_m = 0.1
wheelbase_m = 0.5

[encoder]
ticks_per_rev = 60000

[drive]
max_wheel_rate_rad_s = 40.0
"""

LAWNMOWER_MAP = """\
[columns]
time = "t_s"
left_count = { column = "left_m", unit = "m" }
right_count = { column = "right_m", unit = "m" }
"""

CAR = """\
# A Toyota RAV4: its rear track, and wheels of about the size of its tyres. Ticks are any number, as
# the table has speeds.
schema = 1

[robot]
name = "car"

[wheels]
radius_m = 0.316
wheelbase_m = 1.563

[encoder]
ticks_per_rev = 4096

[drive]
max_wheel_rate_rad_s = 150.0
"""

SPEEDS_MAP = """\
[columns]
time = { column = "t_s", unit = "s" }
left_count = { column = "left_m_s", unit = "m/s" }
right_count = { column = "right_m_s", unit = "m/s" }
"""

CAR_MAP = f"""\
{SPEEDS_MAP}gyro = {{ column = "yaw_rad_s", unit = "rad/s" }}
"""

OPTITRACK = """\
# A robot of two driven wheels of 84 mm, 200 mm apart, each with 64 counts behind a gear of 43.7.
schema = 1

[robot]
name = "optitrack"

[wheels]
radius_m = 0.042003  # 42 mm, times 2797/2796.8: a turn here has a whole number of ticks
wheelbase_m = 0.2

[encoder]
ticks_per_rev = 2797

[drive]
max_wheel_rate_rad_s = 20.0
"""

CHEMNITZ = """\
# A robot of which only speeds and turn rates were recorded: radius, wheelbase and ticks are any
# numbers, as the table has the speeds of two wheels this far apart.
schema = 1

[robot]
name = "chemnitz"

[wheels]
radius_m = 0.1
wheelbase_m = 0.4

[encoder]
ticks_per_rev = 60000

[drive]
max_wheel_rate_rad_s = 40.0
"""

LABYRINTH = """\
# A robot whose wheels are said to stand 78.5 mm apart, of which only their speeds were recorded:
# radius and ticks are any numbers.
schema = 1

[robot]
name = "labyrinth"

[wheels]
radius_m = 0.03
wheelbase_m = 0.0785

[encoder]
ticks_per_rev = 4096

[drive]
max_wheel_rate_rad_s = 40.0
"""

BERLIN = """\
# A car of which only speed and turn rate were recorded: radius, track and ticks are any numbers, as
# the table has the speeds of two wheels this far apart.
schema = 1

[robot]
name = "berlin"

[wheels]
radius_m = 0.3
wheelbase_m = 1.5

[encoder]
ticks_per_rev = 4096

[drive]
max_wheel_rate_rad_s = 150.0
"""

WPI = f"""\
# A Kobuki, as its maker describes it, with the gyro of a navX.
schema = 1

[robot]
name = "Kobuki of WPI"

{_KOBUKI_BODY}"""

WPI_MAP = """\
[columns]
time = { column = "t_s", unit = "s" }
left_count = { column = "left_ticks", wrap = 65536 }
right_count = { column = "right_ticks", wrap = 65536 }
gyro = { column = "yaw_rad_s", unit = "rad/s" }
"""
