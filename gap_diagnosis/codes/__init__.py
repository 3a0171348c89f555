"""The gyro's converter: what the codes alone say, with the wheels as witness."""

from gap_diagnosis.codes.block import CodesBlock, codes_block

__all__ = ["CodesBlock", "codes_block"]
