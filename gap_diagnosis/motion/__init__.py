"""The motion block: wheels, gyro and reference in one likelihood."""
