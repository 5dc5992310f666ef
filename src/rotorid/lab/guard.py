"""Who may ask the lab is settled before any route is looked at.

The guard knows the names by which this server may be called (a page of another origin that had its name point here
comes with another ``Host``), refuses requests that another page made, and lets in whose browser holds the secret of the
session. The address that is printed carries a token, which a browser exchanges for that secret.
"""

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

BODY_BYTES = 1 << 16
"""Largest body of a request."""

UPLOAD_BYTES = 2 << 30
"""Largest log."""

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)
# What has a policy of its own is a report. It lives in a sandbox, whose origin is opaque: with a policy of openers the
# HTML specification makes a network error of it.
_OWN_PAGE = ((b"content-security-policy", _POLICY.encode()), (b"cross-origin-opener-policy", b"same-origin"))

_MOST_QUERY, _MOST_FIELDS = 4096, 20
"""Longest query, in bytes, and most fields in it."""

# From a file or another site a redirection would not carry the cookie; from this page the way on does.
_WAY_IN = (
    b'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url=/"><title>rotorid lab</title>'
)

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


class Guard:
    """Lets in who calls the server by its name, from its own page, with the secret of the session.

    Parameters
    ----------
    app
        What is guarded.
    token
        Of the address; exchanged for the secret.
    secret
        What the cookie carries.
    hosts
        Values of ``Host`` that name this server.
    cookie
        Name of the cookie.
    once
        Whether the token lets one browser in, and no other after it.
    """

    def __init__(
        self, app: App, *, token: str, secret: str, hosts: frozenset[str], cookie: str, once: bool = False
    ) -> None:
        self._app, self._token, self._secret = app, token, secret
        self._hosts, self._cookie = hosts, cookie
        self._once, self._used = once, False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, exchange the token for a cookie, or pass on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return

        begun = False

        async def answer(message: MutableMapping[str, Any]) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                kept = [(name, value) for name, value in message.get("headers", []) if name.lower() != b"server"]
                own = any(name == b"content-security-policy" for name, _ in kept)
                message["headers"] = [*kept, *(() if own else _OWN_PAGE), *_HEADERS]
            await send(message)

        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value)
        hosts = [value.decode("latin-1").lower() for value in headers.get(b"host", [])]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            await _refuse(answer, 421, "This server has another name.")
            return
        if self._is_foreign(scope["method"], hosts[0], headers):
            await _refuse(answer, 403, "Another page asked.")
            return
        if scope["path"] == "/" and scope["method"] == "GET" and _is(self._token, _fields(scope).get("token", [])):
            await self._let_in(answer, headers)
            return
        if not _is(self._secret, _cookies(headers.get(b"cookie", []), self._cookie)):
            await _refuse(
                answer,
                401,
                "Open the address that rotorid lab printed, which lets one browser in. If another browser used it, go "
                "on in that one, or start rotorid lab again.",
            )
            return
        if not self._fits(scope, headers):
            await _say(answer, 413, "The request is too large.")
            return
        try:
            await self._app(scope, _limited(receive, scope["path"]), answer)
        except TooLargeError:
            if not begun:
                await _say(answer, 413, "The request is too large.")
        except Exception:
            # The application says what went wrong; what failed even there is this server's own matter.
            if not begun:
                await _say(answer, 500, "The server could not answer that.")

    async def _let_in(self, answer: Send, headers: dict[bytes, list[bytes]]) -> None:
        """Give the cookie, and lead on to the page; who has the cookie already is led on alone."""
        cookie = f"{self._cookie}={self._secret}; Path=/; HttpOnly; SameSite=Strict"
        given = () if self._once and self._used else ((b"set-cookie", cookie.encode()),)
        self._used = True
        if headers.get(b"sec-fetch-site") in ([b"none"], [b"same-origin"]):
            await _answer(answer, 303, b"", (b"location", b"/"), *given)
        else:
            await _answer(answer, 200, _WAY_IN, (b"content-type", b"text/html; charset=utf-8"), *given)

    @staticmethod
    def _is_foreign(method: str, host: str, headers: dict[bytes, list[bytes]]) -> bool:
        """Whether a page of another origin asked, or had its visitor's browser ask."""
        origins = [value.decode("latin-1").lower() for value in headers.get(b"origin", [])]
        site = headers.get(b"sec-fetch-site", [b"none"])[0]
        own = all(origin == f"http://{host}" for origin in origins)
        return not own or (method not in ("GET", "HEAD") and site not in (b"same-origin", b"none"))

    @staticmethod
    def _fits(scope: Scope, headers: dict[bytes, list[bytes]]) -> bool:
        most = UPLOAD_BYTES if scope["path"] == "/api/upload" else BODY_BYTES
        length = headers.get(b"content-length", [b"0"])[-1]
        return length.isdigit() and len(length) < 16 and int(length) <= most


class TooLargeError(Exception):
    """More came than was announced or allowed."""


def _is(secret: str, given: list[str]) -> bool:
    return len(given) == 1 and hmac.compare_digest(given[0].encode("utf-8", "replace"), secret.encode())


def _fields(scope: Scope) -> dict[str, list[str]]:
    """The query, where it is one that somebody would make."""
    query = scope["query_string"]
    if len(query) >= _MOST_QUERY or query.count(b"&") >= _MOST_FIELDS:
        return {}
    return parse_qs(query.decode("latin-1"))


def _limited(receive: Receive, path: str) -> Receive:
    left = UPLOAD_BYTES if path == "/api/upload" else BODY_BYTES

    async def counted() -> MutableMapping[str, Any]:
        nonlocal left
        message = await receive()
        left -= len(message.get("body", b""))
        if left < 0:
            raise TooLargeError
        return message

    return counted


def _cookies(values: list[bytes], name: str) -> list[str]:
    pairs = (part.strip().partition("=") for value in values for part in value.decode("latin-1").split(";"))
    return [value for key, _, value in pairs if key == name]


async def _refuse(send: Send, status: int, sentence: str) -> None:
    """Say no to a stranger, and keep no connection for one."""
    await _say(send, status, sentence, (b"connection", b"close"))


async def _say(send: Send, status: int, sentence: str, *headers: tuple[bytes, bytes]) -> None:
    await _answer(send, status, sentence.encode(), (b"content-type", b"text/plain; charset=utf-8"), *headers)


async def _answer(send: Send, status: int, body: bytes, *headers: tuple[bytes, bytes]) -> None:
    shown = [(b"content-length", str(len(body)).encode()), *headers]
    await send({"type": "http.response.start", "status": status, "headers": shown})
    await send({"type": "http.response.body", "body": body})
