"""Who may ask the lab is settled before any route is looked at.

The guard knows the names by which this server may be called (a page of another origin that had its name point here
comes with another ``Host``), refuses requests that another page made, and lets in whose browser holds the secret of the
session. The address that is printed carries a token, which a browser exchanges for that secret.
"""

import hmac
from collections.abc import MutableMapping
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

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
_WAY_IN = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url=/"><title>rotorid lab</title>'


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
    once
        Whether the token lets one browser in, and no other after it.
    """

    def __init__(
        self, app: ASGIApp, *, token: str, secret: str, hosts: frozenset[str], cookie: str, once: bool = False
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

        started = False

        async def answer(message: MutableMapping[str, Any]) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                kept = [(name, value) for name, value in message.get("headers", []) if name.lower() != b"server"]
                own = any(name == b"content-security-policy" for name, _ in kept)
                message["headers"] = [*kept, *(() if own else _OWN_PAGE), *_HEADERS]
            await send(message)

        own = self._own_answer(scope, Headers(scope=scope))
        if own is not None:
            await own(scope, receive, answer)
            return
        try:
            await self._app(scope, _limited(receive, scope["path"]), answer)
        except TooLargeError:
            if not started:
                await PlainTextResponse(_TOO_LARGE, 413)(scope, receive, answer)
        except Exception:
            # The application says what went wrong; what failed even there is this server's own matter.
            if not started:
                await PlainTextResponse("The server could not answer that.", 500)(scope, receive, answer)

    def _own_answer(self, scope: Scope, headers: Headers) -> Response | None:
        """The guard's own answer; ``None`` passes the request on."""
        hosts = [host.lower() for host in headers.getlist("host")]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return _refusal(421, "This server has another name.")
        if self._is_foreign(scope["method"], hosts[0], headers):
            return _refusal(403, "Another page asked.")
        if scope["path"] == "/" and scope["method"] == "GET" and _is(self._token, _fields(scope).get("token", [])):
            return self._let_in(headers)
        if not _is(self._secret, _cookies(headers.getlist("cookie"), self._cookie)):
            return _refusal(
                401,
                "Open the address that rotorid lab printed, which lets one browser in. If another browser used it, go "
                "on in that one, or start rotorid lab again.",
            )
        return None if self._fits(scope, headers) else PlainTextResponse(_TOO_LARGE, 413)

    def _let_in(self, headers: Headers) -> Response:
        """Give the cookie, and lead on to the page; who has the cookie already is led on alone."""
        cookie = f"{self._cookie}={self._secret}; Path=/; HttpOnly; SameSite=Strict"
        given = {} if self._once and self._used else {"set-cookie": cookie}
        self._used = True
        if headers.getlist("sec-fetch-site") in (["none"], ["same-origin"]):
            return Response(status_code=303, headers={"location": "/", **given})
        return HTMLResponse(_WAY_IN, headers=given)

    @staticmethod
    def _is_foreign(method: str, host: str, headers: Headers) -> bool:
        """Whether a page of another origin asked, or had its visitor's browser ask."""
        own = all(origin.lower() == f"http://{host}" for origin in headers.getlist("origin"))
        site = headers.get("sec-fetch-site", "none")
        return not own or (method not in ("GET", "HEAD") and site not in ("same-origin", "none"))

    @staticmethod
    def _fits(scope: Scope, headers: Headers) -> bool:
        most = UPLOAD_BYTES if scope["path"] == "/api/upload" else BODY_BYTES
        length = (headers.getlist("content-length") or ["0"])[-1]
        return length.isascii() and length.isdigit() and len(length) < 16 and int(length) <= most


_TOO_LARGE = "The request is too large."


class TooLargeError(Exception):
    """A request is larger than announced or allowed."""


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


def _cookies(values: list[str], name: str) -> list[str]:
    pairs = (part.strip().partition("=") for value in values for part in value.split(";"))
    return [value for key, _, value in pairs if key == name]


def _refusal(status: int, sentence: str) -> Response:
    """The answer to a stranger, for whom no connection is kept."""
    return PlainTextResponse(sentence, status, {"connection": "close"})
