"""A bus that was not made for Chiplog, for the tests of its signal map."""

from pathlib import Path

from can_bus import Database, load_database

FOREIGN_DBC = """\
VERSION ""
NS_ :
BS_:
BU_: SENSORS ECU
BO_ 256 WHEELS: 8 SENSORS
 SG_ Left : 0|32@1- (1,0) [0|0] "pulses" ECU
 SG_ Right : 32|32@1- (1,0) [0|0] "" ECU
BO_ 257 DECADE: 8 SENSORS
 SG_ Left : 0|16@1+ (1,0) [0|9999] "ticks" ECU
 SG_ Right : 16|8@1+ (1,0) [0|255] "ticks" ECU
 SG_ Scaled : 24|16@1+ (2,0) [0|131070] "ticks" ECU
BO_ 258 ANGLES: 8 SENSORS
 SG_ Left : 0|16@1+ (0.01,0) [0|359.99] "deg" ECU
 SG_ Right : 23|16@0+ (0.01,0) [0|360] "deg" ECU
 SG_ LeftRad : 56|8@1+ (0.1,0) [0|6.2] "rad" ECU
 SG_ LeftPath : 32|24@1- (0.1,0) [-800000|800000] "mm" ECU
BO_ 260 YAW: 8 SENSORS
 SG_ Rate : 7|16@0- (0.01,0) [-327.68|327.67] "deg/s" ECU
 SG_ Offset : 16|16@1+ (0.0002,-6.5) [-6.5|6.607] "rad/s" ECU
 SG_ Bare : 32|16@1- (0.001,0) [-32|32] "" ECU
 SG_ Odd : 48|16@1+ (1,0) [0|65535] "furlong" ECU
BO_ 264 CLOCKWISE: 8 SENSORS
 SG_ Rate : 0|16@1- (-0.01,0) [-327.67|327.67] "deg/s" ECU
BO_ 261 FLOATS: 8 SENSORS
 SG_ Rate : 0|32@1- (1,0) [-10|10] "rad/s" ECU
BO_ 262 BODY: 8 SENSORS
 SG_ AccelX : 0|16@1- (0.01,0) [-20|20] "m/s^2" ECU
 SG_ Heat : 16|8@1+ (1,-40) [-40|215] "degC" ECU
 SG_ Battery : 24|16@1+ (1,0) [0|65535] "mV" ECU
BO_ 263 FINE: 8 SENSORS
 SG_ Rate : 0|24@1- (0.00001,0) [-80|80] "rad/s" ECU
BO_ 512 POSITION: 8 ECU
 SG_ X : 7|32@0- (0.1,0) [-1000|1000] "mm" SENSORS
 SG_ Y : 32|32@1- (0.1,0) [-1000|1000] "mm" SENSORS
BO_ 513 HEADING: 6 ECU
 SG_ Compass : 0|16@1+ (0.01,0) [0|359.99] "deg" SENSORS
 SG_ Signed : 16|16@1- (0.01,0) [-180|180] "deg" SENSORS
 SG_ Radians : 32|16@1+ (0.001,0) [0|6.283] "rad" SENSORS
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 256 20;
VAL_ 512 X 2147483647 "SNA" ;
SIG_VALTYPE_ 261 Rate : 1;
"""


def foreign_database(folder: Path) -> Database:
    file = folder / "foreign.dbc"
    file.write_text(FOREIGN_DBC, encoding="utf-8")
    return load_database(file)


def write_map(folder: Path, signals: str) -> Path:
    file = folder / "map.toml"
    file.write_text(f"[signals]\n{signals}\n", encoding="utf-8")
    return file
