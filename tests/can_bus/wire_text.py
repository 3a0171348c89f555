"""An independent encoder: a frame written as text, bit by bit, as ISO 11898-1 draws it."""

import re


def frame_as_text(
    frame_id: int, is_extended: bool, data: bytes, remote_dlc: int | None = None
) -> str:
    """CRC by long division, stuffing by regular expression."""
    dlc = len(data) if remote_dlc is None else remote_dlc
    rtr = "0" if remote_dlc is None else "1"
    if is_extended:
        identifier = f"{frame_id:029b}"
        head = "0" + identifier[:11] + "1" + "1" + identifier[11:] + rtr + "00"
    else:
        head = "0" + f"{frame_id:011b}" + rtr + "0" + "0"
    body = head + f"{dlc:04b}" + "".join(f"{byte:08b}" for byte in data)
    remainder = int(body + "0" * 15, 2)
    divisor = 0b1100010110011001
    for position in range(len(body) - 1, -1, -1):
        if remainder >> position + 15 & 1:
            remainder ^= divisor << position
    stuffed = body + f"{remainder:015b}"
    place = 0
    while match := re.compile("00000|11111").search(stuffed, place):
        end = match.end()
        stuffed = stuffed[:end] + ("1" if match[0] == "00000" else "0") + stuffed[end:]
        place = end
    return stuffed + "1" + "0" + "1" + "1" * 7
