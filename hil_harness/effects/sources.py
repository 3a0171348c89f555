"""Who says how large an effect is in real robots: the sources that the catalogue quotes."""

from typing import Final

BORENSTEIN_FENG: Final = (
    "Borenstein and Feng, Measurement and correction of systematic odometry errors in mobile "
    "robots, IEEE T-RA 12(6), 1996"
)
CENSI: Final = (
    "Censi, Franchi, Marchionni and Oriolo, Simultaneous calibration of odometry and sensor "
    "parameters for mobile robots, IEEE T-RO 29(2), 2013"
)
CLEARPATH: Final = "Clearpath Robotics, public issue reports of Husky, Jackal and A300"
HUSKY: Final = "measured on a public Husky log: odometry against RTK on five routes"
KOBUKI: Final = "measured on public Kobuki logs"
MPU_6050: Final = "InvenSense, MPU-6000/6050 product specification, revision 3.4"
GYRO_DATA_SHEETS: Final = "data sheets of BMI160, BMI055, ICM-20602 and ICM-42688"
MSP430: Final = "Texas Instruments, MSP430FR ADC data sheet, scaled to 16 bits of 3.3 V"
COURSE_NOTES: Final = "public LEGO robot course notes: a 10-bit encoder, a geared motor"
DESIGN: Final = "docs/design.md, section 5"
BOSCH_CAN: Final = "Bosch, CAN specification 2.0, part B: frame lengths and clock tolerance"
ROBOJACKETS: Final = "RoboJackets, public issue 361: stamps one period late"
VICON: Final = "published accuracy studies of Vicon motion capture"
