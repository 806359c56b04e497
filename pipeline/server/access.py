"""Who may ask: this machine's own pages, and elsewhere whoever has the token.

A page of another site can make a visitor's browser send requests here, and can have its own name point to
this machine. So the name in Host must be one of this machine's, what changes anything must come from a page
of this server, and a token is asked for where others can reach it.
"""

import hmac
from collections.abc import Awaitable, Callable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "latent_nerf_token"
LOCAL = frozenset({"127.0.0.1", "localhost", "[::1]"})
READING = frozenset({"GET", "HEAD"})
HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "SAMEORIGIN",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-cache",
}
POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self' "
    "blob: data:; frame-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'self'"
)
"""Of pages that do not bring one of their own."""


class Access:
    """Wraps an application: refuses what must not be asked, and marks every answer."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self.app = app
        self.token = token
        """Empty: none is asked for, and only this machine's own names are answered to."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("content-security-policy", POLICY)
            await send(message)

        refused = self._refusal(scope)
        answer: Callable[[Scope, Receive, Send], Awaitable[None]] = self.app if refused is None else refused
        await answer(scope, receive, marked)

    def _refusal(self, scope: Scope) -> Response | None:
        headers, method = Headers(scope=scope), scope["method"]
        host = headers.get("host", "")
        if not self.token and _name(host) not in LOCAL:
            return _refuse(421, f"this server answers to {', '.join(sorted(LOCAL))}, not to {host[:80]!r}")
        site = headers.get("sec-fetch-site", "none")
        origin = headers.get("origin")
        foreign = (origin is not None and urlsplit(origin).netloc != host) or site in (
            "cross-site",
            "same-site",
        )
        opened = method == "GET" and headers.get("sec-fetch-mode") == "navigate"
        if foreign and not opened:
            return _refuse(403, "a page of another site may not ask this server")
        if not self.token:
            return None
        asked = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if asked and opened_at_root(scope) and _same(asked, self.token):
            answer = RedirectResponse("/", 303)
            answer.set_cookie(COOKIE, self.token, httponly=True, samesite="strict", max_age=30 * 86_400)
            return answer
        bearer = headers.get("authorization", "").removeprefix("Bearer ")
        if _same(bearer, self.token) or _same(_cookie(headers.get("cookie", "")), self.token):
            return None
        return _refuse(
            401, "open the address that the server printed, with its token, or send it as a bearer"
        )


def opened_at_root(scope: Scope) -> bool:
    """Say whether a request is for the page itself."""
    return bool(scope["method"] == "GET" and scope["path"] == "/")


def _name(host: str) -> str:
    return host[: host.find("]") + 1] if host.startswith("[") else host.partition(":")[0].lower()


def _same(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode("utf-8", "replace"), other.encode())


def _cookie(text: str) -> str:
    try:
        jar = SimpleCookie(text)
    except CookieError:
        return ""
    return jar[COOKIE].value if COOKIE in jar else ""


def _refuse(status: int, reason: str) -> Response:
    return JSONResponse({"error": reason}, status)
