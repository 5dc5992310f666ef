"""Slow and broken connections: those that do not send in time are closed, so that nobody waits for them."""

import asyncio
from typing import Any, Literal, TypeAlias

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_OPEN = 200
"""Connections that may be open at a time."""

HEAD_S, PAUSE_S = 10.0, 30.0
"""Time for the head of a request, and longest pause of a body or a reader."""

_Phase: TypeAlias = Literal["head", "body", "rest"] | None


class PromptProtocol(H11Protocol):
    """HTTP/1.1 with a clock.

    A request has ``HEAD_S`` until its head is there, and the rest of a body that was answered already as long. A body
    that is taken in, and a reader of an answer, may pause for ``PAUSE_S``. Where more than ``MOST_OPEN`` connections
    are open, the one goes that has waited longest for its request.
    """

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self._phase: _Phase = None
        self._since_s = 0.0
        self._answered = False
        self._due: asyncio.TimerHandle | None = None
        self._unread: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room, and start the clock."""
        super().connection_made(transport)
        self._since_s = self.loop.time()
        self._watch()
        others = [
            h11_protocol
            for h11_protocol in self.connections
            if isinstance(h11_protocol, PromptProtocol) and not h11_protocol.transport.is_closing()
        ]
        if len(others) > MOST_OPEN:
            waiting = [connection for connection in others if connection.conn.their_state is h11.IDLE]
            min(waiting, key=lambda connection: connection._since_s).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the clocks."""
        super().connection_lost(exc)
        for clock in (self._due, self._unread):
            if clock is not None:
                clock.cancel()

    def data_received(self, data: bytes) -> None:
        """Look at the clock with every part that comes."""
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        """What comes after an answer has its own time."""
        super().on_response_complete()
        self._answered = True
        self._watch()

    def pause_writing(self) -> None:
        """Whoever does not read an answer is not waited for."""
        super().pause_writing()
        self._unread = self.loop.call_later(PAUSE_S, self.transport.abort)

    def resume_writing(self) -> None:
        """It is read."""
        super().resume_writing()
        if self._unread is not None:
            self._unread.cancel()

    def _watch(self) -> None:
        phase = self._awaited()
        if phase == self._phase != "body":
            return
        self._phase = phase
        if self._due is not None:
            self._due.cancel()
        if phase is not None:
            self._due = self.loop.call_later(PAUSE_S if phase == "body" else HEAD_S, self._late)

    def _awaited(self) -> _Phase:
        state = self.conn.their_state
        if state is h11.SEND_BODY:
            return "rest" if self.cycle.response_complete else "body"
        # Between two requests nothing is awaited: the library closes what rests for long.
        rests = self._answered and not self.conn.trailing_data[0]
        return "head" if state is h11.IDLE and not rests else None

    def _late(self) -> None:
        if self.flow.read_paused:
            # It is this server that does not read.
            self._due = self.loop.call_later(PAUSE_S, self._late)
        else:
            self.transport.abort()
