"""Slow and broken connections: those that do not send in time are closed, so that nobody waits for them."""

import asyncio
from typing import Any, Literal, TypeAlias

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_OPEN = 200
"""Connections that may be open at a time."""

ACCEPTED_AT_ONCE = 50
"""Connections that are taken in between two looks at what was sent, so that none must go before it is read."""

_NEW_S = 1.0
"""A client that has been let in is given as long to say anything."""

HEAD_S, PAUSE_S = 10.0, 30.0
"""Time for the head of a request, and longest pause of a body or a reader."""

_Phase: TypeAlias = Literal["head", "body", "rest"] | None


class Room:
    """The connections of a server by peer, those that were silent longest first."""

    def __init__(self) -> None:
        self._peers: dict[str, dict[PromptProtocol, None]] = {}
        self._count = 0

    def enter(self, connection: "PromptProtocol") -> None:
        """Take one in; where there are too many, the peer with the most loses the one that can best be spared."""
        self._peers.setdefault(connection.peer, {})[connection] = None
        self._count += 1
        if self._count > MOST_OPEN:
            most = max(self._peers, key=lambda peer: len(self._peers[peer]))
            spared = min(self._peers[most], key=lambda one: one.standing)
            self.leave(spared)
            spared.transport.abort()

    def heard(self, connection: "PromptProtocol") -> None:
        """Something came."""
        own = self._peers.get(connection.peer, {})
        if connection in own:
            del own[connection]
            own[connection] = None

    def leave(self, connection: "PromptProtocol") -> None:
        """It is gone."""
        own = self._peers.get(connection.peer, {})
        if connection in own:
            del own[connection]
            self._count -= 1
            if not own:
                del self._peers[connection.peer]


class PromptProtocol(H11Protocol):
    """HTTP/1.1 with a clock.

    A request has ``HEAD_S`` until its head is there, and the rest of a body that was answered already as long. A body
    that is taken in, and a reader of an answer, may pause for ``PAUSE_S``. Where more than ``MOST_OPEN`` connections
    are open, the peer with the most loses one: the one that was silent longest of those without a request, else of
    those whose body is awaited.

    Parameters
    ----------
    room
        Of all connections of the server.
    """

    def __init__(self, *given: Any, room: Room, **named: Any) -> None:
        super().__init__(*given, **named)
        self.peer, self.heard = "", False
        self._made_s = 0.0
        self._room = room
        self._phase: _Phase = None
        self._answered = False
        self._due: asyncio.TimerHandle | None = None
        self._unread: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room, and start the clock."""
        super().connection_made(transport)
        self.peer = self.client[0] if self.client else ""
        self._made_s = self.loop.time()
        self._watch()
        self._room.enter(self)

    @property
    def standing(self) -> int:
        """How well it can be spared: 0 without a request, 1 while its body comes, 2 as it is new, 3 while answered."""
        state = self.conn.their_state
        if state is h11.IDLE:
            return 2 if not self.heard and self.loop.time() - self._made_s < _NEW_S else 0
        return 1 if state is h11.SEND_BODY else 3

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the clocks."""
        super().connection_lost(exc)
        self._room.leave(self)
        for clock in (self._due, self._unread):
            if clock is not None:
                clock.cancel()

    def data_received(self, data: bytes) -> None:
        """Look at the clock with every part that comes."""
        super().data_received(data)
        self.heard = True
        self._room.heard(self)
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
