"""The simulated bus: its arguments, its faults, and its load."""

from __future__ import annotations

from can_bus import shipped_path
from error_tables.row import DBC, Row

_RUN = "chiplog run --interface chiplog --channel bench --bus-arg"
_OPEN = "cannot open chiplog channel 'bench': "
_FILE = f"{_OPEN}faults.toml: "
_SHIPPED = shipped_path().read_text(encoding="utf-8")


def _dbc_at(bitrate: int) -> str:
    """Return the shipped DBC with another bit rate."""
    return _SHIPPED.replace('BA_ "Baudrate" 500000;', f'BA_ "Baudrate" {bitrate};')


def _fault(when: str, text: str, line: str) -> Row:
    """Return the row of a fault that is wrong."""
    return Row(when, f"{_RUN} faults=faults.toml", _FILE + line, {"faults.toml": text})


SIMULATED: tuple[Row, ...] = (
    Row(
        "real time on a bus with a clock of its own",
        "chiplog run --interface chiplog --time real",
        "--time real --interface chiplog: that bus has a clock of its own; expected "
        "--time lockstep, or another --interface",
    ),
    Row(
        "a bit rate beyond classic CAN on the simulated bus",
        "chiplog run --interface chiplog --channel bench --dbc mine.dbc",
        f"{_OPEN}bitrate = 5000000: expected 1 to 1000000 [bit/s]",
        {"mine.dbc": _dbc_at(5_000_000)},
    ),
    Row(
        "the load of a bus that stands still",
        "chiplog busload --dbc mine.dbc",
        "bitrate = 0: expected more than 0 [bit/s]",
        {"mine.dbc": _dbc_at(0)},
    ),
    Row(
        "an argument that the simulated bus has not",
        f"{_RUN} speed=1",
        "chiplog has no argument 'speed': it has node, receive_own_messages, "
        "ignore_rx_error_frames, tx_order, tx_mailboxes, tx_backlog, clock_skew, retransmit, "
        "restart, seed, faults",
    ),
    Row(
        "a transmit queue in no known order",
        f"{_RUN} tx_order=last",
        f"{_OPEN}tx_order = 'last': expected priority or fifo",
    ),
    Row(
        "a controller without a mailbox",
        f"{_RUN} tx_mailboxes=0",
        f"{_OPEN}tx_mailboxes = 0: expected 1 or more",
    ),
    Row(
        "a queue of less than nothing",
        f"{_RUN} tx_mailboxes=1 --bus-arg tx_backlog=-1",
        f"{_OPEN}tx_backlog = -1: expected 0 or more",
    ),
    Row(
        "a clock far too fast",
        f"{_RUN} clock_skew=2",
        f"{_OPEN}clock_skew = 2: expected -0.5 to 0.5",
    ),
    Row(
        "two nodes of one name",
        f"{_RUN} node=ecu",
        f"{_OPEN}there is a node 'ecu' on this channel already",
    ),
    Row(
        "a file of faults that is not there",
        f"{_RUN} faults=nowhere.toml",
        f"{_OPEN}nowhere.toml: cannot read these faults: No such file or directory",
    ),
    _fault(
        "a file of faults that is no TOML",
        "kind =\n",
        "this is no TOML file: Invalid value (at line 1, column 7)",
    ),
    _fault(
        "a file of faults with one table",
        '[fault]\nkind = "loss"\n',
        "expected [[fault]] tables and nothing else",
    ),
    _fault("faults that are no tables", "fault = [1]\n", "fault 1: expected a [[fault]] table"),
    _fault("a fault without its kind", "[[fault]]\ncount = 1\n", "fault 1: kind is missing"),
    _fault(
        "a fault with a field that there is not",
        '[[fault]]\nkind = "loss"\nrate = 1\n',
        "fault 1: no field 'rate': there are kind, node, arbitration_id, receivers, start_s, "
        "stop_s, turns, count, probability, bits, delay_s, data, is_extended",
    ),
    _fault(
        "a fault with a word for a number",
        '[[fault]]\nkind = "loss"\ncount = "two"\n',
        "fault 1: count = 'two': expected int",
    ),
    _fault(
        "a fault with a number for a list",
        '[[fault]]\nkind = "loss"\nturns = 1\n',
        "fault 1: turns: expected a list of int",
    ),
    _fault(
        "a fault with data that is no hex",
        '[[fault]]\nkind = "babbling"\ndata = "zz"\n',
        'fault 1: data: expected bytes as hex, as in "01ff"',
    ),
    _fault(
        "a fault of no known kind",
        '[[fault]]\nkind = "rain"\n',
        "fault 1: no bus fault 'rain': there are loss, corruption, delay, jitter, duplication, "
        "reordering, babbling, silence",
    ),
    _fault(
        "silence of nobody",
        '[[fault]]\nkind = "silence"\n',
        "fault 1: bus fault 'silence' needs the name of a node",
    ),
    _fault(
        "babble without an identifier",
        '[[fault]]\nkind = "babbling"\nnode = "ecu"\n',
        "fault 1: bus fault 'babbling' needs an arbitration_id",
    ),
    _fault(
        "a delay of nothing",
        '[[fault]]\nkind = "delay"\n',
        "fault 1: bus fault 'delay': delay_s = 0.0: expected more than 0",
    ),
    _fault(
        "a delay for one receiver",
        '[[fault]]\nkind = "delay"\ndelay_s = 0.1\nreceivers = ["ecu"]\n',
        "fault 1: bus fault 'delay': receivers: it strikes a frame before anyone receives it",
    ),
    _fault(
        "babble with a negative pause",
        '[[fault]]\nkind = "babbling"\nnode = "ecu"\narbitration_id = 1\ndelay_s = -1\n',
        "fault 1: bus fault 'babbling': delay_s = -1: expected 0 or more",
    ),
    _fault(
        "corruption of no bit",
        '[[fault]]\nkind = "corruption"\n',
        "fault 1: bus fault 'corruption' needs bits: places on the wire, 0 is the start of frame",
    ),
    _fault(
        "corruption beyond every frame",
        '[[fault]]\nkind = "corruption"\nbits = [900]\n',
        "fault 1: bus fault 'corruption': bits = (900,): expected 0 to 511",
    ),
    _fault(
        "a fault before the beginning",
        '[[fault]]\nkind = "loss"\nstart_s = -1\n',
        "fault 1: bus fault 'loss': start_s = -1: expected 0 or more",
    ),
    _fault(
        "a fault more than certain",
        '[[fault]]\nkind = "loss"\nprobability = 2\n',
        "fault 1: bus fault 'loss': probability = 2: expected 0 to 1",
    ),
    _fault(
        "a fault less than never",
        '[[fault]]\nkind = "loss"\ncount = -1\n',
        "fault 1: bus fault 'loss': count = -1: expected 0 or more",
    ),
    Row(
        "the load of a bus without a bit rate",
        "chiplog busload --dbc mine.dbc",
        "mine.dbc names no Baudrate: expected --bitrate",
        {"mine.dbc": DBC},
    ),
    Row(
        "the load of a bus without a cycle",
        "chiplog busload --dbc mine.dbc --bitrate 500000",
        "mine.dbc: no classic CAN message has a cycle time: expected GenMsgCycleTime",
        {"mine.dbc": DBC},
    ),
    Row(
        "frames queued before they are due",
        "chiplog busload --jitter-us -1",
        "--jitter-us -1: expected a whole number from 0 to 10000000 [µs]",
    ),
)
