"""What a node has to send: mailboxes by priority or in order, and the queue behind them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Final, Literal, get_args

import can

from can_bus.errors import CanBusError
from can_bus.simulated.frame_bits import FrameContent

TransmitOrder = Literal["priority", "fifo"]
TRANSMIT_ORDERS: Final[tuple[TransmitOrder, ...]] = get_args(TransmitOrder)


class Pending:
    """A frame that waits for the bus.

    Attributes:
        key: its arbitration field as a number: the smaller one wins.
        number: of its turn in the node.
        message: what receivers get, a copy of what was sent.
        length_bits: on the wire, without intermission.
        on_sent: called once it has been sent, at the end of the frame.
    """

    __slots__ = ("key", "length_bits", "message", "number", "on_sent")

    def __init__(
        self,
        key: int,
        message: can.Message,
        length_bits: int,
        on_sent: Callable[[], None] | None = None,
    ) -> None:
        """Without a turn yet."""
        self.key = key
        self.number = 0
        self.message = message
        self.length_bits = length_bits
        self.on_sent = on_sent

    @property
    def content(self) -> FrameContent:
        """What goes over the wire."""
        message = self.message
        return FrameContent(
            message.arbitration_id,
            message.is_extended_id,
            message.is_remote_frame,
            message.dlc,
            bytes(message.data),
        )


def arbitration_key(arbitration_id: int, is_extended: bool, is_remote: bool) -> int:
    """Return a frame's arbitration field as a number: on the wire the smaller one wins.

    Identifier, RTR and IDE of a standard frame stand where base identifier, SRR and IDE of an
    extended one stand, so that a standard frame wins against an extended one of equal base.
    """
    if is_extended:
        base, extension = arbitration_id >> 18, arbitration_id & (1 << 18) - 1
        return base << 21 | 0b11 << 19 | extension << 1 | is_remote
    return arbitration_id << 21 | is_remote << 20


class TransmitQueue:
    """The frames of one node on their way out.

    Args:
        order: `priority`: of the frames in the mailboxes the one with the lowest identifier takes
            part in arbitration (equal ones in the order sent); `fifo`: the oldest.
        mailboxes: how many frames the controller holds; None: as many as there are. A frame in a
            mailbox is not taken back for a more urgent one that waits behind.
        backlog: how many more wait behind the mailboxes, in the order sent; None: no limit.

    Attributes:
        held: the frames in the mailboxes as a heap of (rank, turn, frame); not to be changed.
        capacity: how many frames there is room for; None: no limit.

    Raises CanBusError for an order that there is not, or counts that make no sense.
    """

    __slots__ = ("_behind", "_count", "_is_fifo", "_mailboxes", "_sending", "capacity", "held")

    def __init__(
        self, order: TransmitOrder, mailboxes: int | None = None, backlog: int | None = None
    ) -> None:
        """Start empty."""
        if order not in TRANSMIT_ORDERS:
            raise CanBusError(f"tx_order = {order!r}: expected {' or '.join(TRANSMIT_ORDERS)}")
        if mailboxes is not None and mailboxes < 1:
            raise CanBusError(f"tx_mailboxes = {mailboxes}: expected 1 or more")
        if backlog is not None and backlog < 0:
            raise CanBusError(f"tx_backlog = {backlog}: expected 0 or more")
        self._is_fifo = order == "fifo"
        self._mailboxes = mailboxes
        self.capacity = None if mailboxes is None or backlog is None else mailboxes + backlog
        self.held: list[tuple[int, int, Pending]] = []
        self._behind: deque[Pending] = deque()
        self._count = 0
        self._sending = 0

    def __len__(self) -> int:
        """Return how many frames there are, the one on the wire included."""
        return len(self.held) + len(self._behind) + self._sending

    @property
    def is_full(self) -> bool:
        """Tell whether there is no room for another frame."""
        return self.capacity is not None and len(self) >= self.capacity

    def push(self, pending: Pending) -> None:
        """Take a frame in."""
        pending.number = self._count
        self._count += 1
        if self._mailboxes is None or len(self.held) + self._sending < self._mailboxes:
            heappush(self.held, (0 if self._is_fifo else pending.key, pending.number, pending))
        else:
            self._behind.append(pending)

    def start(self) -> Pending:
        """Take the head out: it is on the wire, still in its mailbox."""
        self._sending += 1
        return heappop(self.held)[2]

    def finish(self) -> None:
        """Free the mailbox of the frame that was on the wire."""
        self._sending -= 1
        if self._behind:
            self._hold(self._behind.popleft())

    def pass_head(self) -> None:
        """Take the head out and free its mailbox: it has been sent at once."""
        heappop(self.held)
        if self._behind:
            self._hold(self._behind.popleft())

    def take_back(self, pending: Pending) -> None:
        """Put the frame that was on the wire back into its mailbox, for another attempt."""
        self._sending -= 1
        self._hold(pending)

    def clear(self) -> None:
        """Drop all that is not on the wire."""
        self.held.clear()
        self._behind.clear()

    def _hold(self, pending: Pending) -> None:
        key = 0 if self._is_fifo else pending.key
        heappush(self.held, (key, pending.number, pending))
