"""Web server of the page: views over a WebSocket, and the driver's commands back.

A message to the page is the length of a JSON header (4 bytes, big endian), the header, and a JPEG
of all panels side by side. The page acknowledges each message; only then it gets the newest view.
"""

import asyncio
import contextlib
import errno
import hmac
import json
import socket
import threading
import weakref
from collections.abc import Awaitable, Callable
from importlib import resources
from urllib.parse import urlsplit

import cv2
import numpy as np
import pydantic
from aiohttp import WSMsgType, web

from geovp_benchmarks.display.commands import Driver
from geovp_benchmarks.display.session import Session, Shown
from geovp_classic.errors import BadData

JPEG_QUALITY = 80
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; connect-src 'self' ws: wss:; img-src data:",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class FromPage(pydantic.BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """A message of the page."""

    is_ready: bool = False  # the last view was drawn
    is_dimming: bool | None = None
    speed_m_s: float | None = pydantic.Field(None, ge=-20, le=60)
    yaw_rate_rad_s: float = pydantic.Field(0.0, ge=-2, le=2)


class Newest:
    """The newest message to all pages; nothing is queued."""

    def __init__(self) -> None:
        self.number = 0
        self._message = b""
        self._changed = asyncio.Event()

    def publish(self, message: bytes) -> None:
        """Replace the message and wake those that wait for it."""
        self._message = message
        self.number += 1
        self._changed.set()
        self._changed = asyncio.Event()

    async def newer_than(self, number: int) -> tuple[int, bytes]:
        """Wait for a message with another number; return both."""
        while self.number == number:
            await self._changed.wait()
        return self.number, self._message


class Server:
    """The page of a session, for everyone who has the token."""

    def __init__(self, session: Session, token: str) -> None:
        self.session = session
        self.newest = Newest()
        self._token = token
        self._sockets: weakref.WeakSet[web.WebSocketResponse] = weakref.WeakSet()

    def application(self) -> web.Application:
        """Return the application: the page at /, its WebSocket at /views, and nothing else."""
        application = web.Application(middlewares=[self._guard])
        application.router.add_get("/", self._page)
        application.router.add_get("/views", self._views)
        application.on_shutdown.append(self._close)
        return application

    async def run(self, listener: socket.socket) -> None:
        """Serve and play the session until this task is cancelled or the session fails."""
        loop, stop = asyncio.get_running_loop(), threading.Event()

        def publish(shown: Shown) -> None:
            loop.call_soon_threadsafe(self.newest.publish, encode(shown))

        runner = web.AppRunner(self.application(), access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            await web.SockSite(runner, listener).start()
            await asyncio.to_thread(self.session.run, publish, stop)
        finally:
            stop.set()
            await runner.cleanup()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse requests without the token, and WebSockets that another site opens."""
        token = request.query.get("token", "")
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            text = "Open the address that `geovp display` printed; it ends in a token."
            raise web.HTTPForbidden(text=text, headers=HEADERS)
        origin = urlsplit(request.headers.get("Origin", ""))
        if request.path == "/views" and origin.netloc != request.host:
            raise web.HTTPForbidden(text="The page is of another site.", headers=HEADERS)
        return await handler(request)

    async def _page(self, _: web.Request) -> web.Response:
        page = resources.files("geovp_benchmarks.display").joinpath("page.html").read_text("utf-8")
        is_driven = str(isinstance(self.session.commands, Driver)).lower()
        page = page.replace('data-driven="false"', f'data-driven="{is_driven}"')
        return web.Response(text=page, content_type="text/html", headers=HEADERS)

    async def _views(self, request: web.Request) -> web.WebSocketResponse:
        """Send views as they are acknowledged, and receive commands."""
        page = web.WebSocketResponse(heartbeat=10.0, max_msg_size=1024)
        await page.prepare(request)
        self._sockets.add(page)
        is_ready = asyncio.Event()
        is_ready.set()
        sending = asyncio.create_task(self._send(page, is_ready))
        try:
            async for message in page:
                if message.type == WSMsgType.TEXT:
                    self._receive(message.data, is_ready)
        finally:
            sending.cancel()
            if isinstance(self.session.commands, Driver):
                self.session.commands.release()
        return page

    async def _send(self, page: web.WebSocketResponse, is_ready: asyncio.Event) -> None:
        number = 0
        with contextlib.suppress(ConnectionError):
            while True:
                await is_ready.wait()
                is_ready.clear()
                number, message = await self.newest.newer_than(number)
                await page.send_bytes(message)

    def _receive(self, text: str, is_ready: asyncio.Event) -> None:
        """Follow a message of a page; ignore a malformed one."""
        try:
            message = FromPage.model_validate_json(text)
        except pydantic.ValidationError:
            return
        if message.is_ready:
            is_ready.set()
        if message.is_dimming is not None:
            self.session.is_dimming = message.is_dimming
        commands = self.session.commands
        if message.speed_m_s is not None and isinstance(commands, Driver):
            commands.steer(message.speed_m_s, message.yaw_rate_rad_s)

    async def _close(self, _: web.Application) -> None:
        for page in set(self._sockets):
            await page.close()


def encode(shown: Shown) -> bytes:
    """Return the message of a view: header and JPEG."""
    header = {
        "panels": list(shown.panels),
        "warning": shown.warning,
        "age_s": shown.age_s,
        "confidence": shown.confidence,
        "is_dimming": shown.is_dimming,
    }
    text = json.dumps(header).encode()
    strip = np.concatenate(list(shown.panels.values()), axis=1)
    _, jpeg = cv2.imencode(
        ".jpg", cv2.cvtColor(strip, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    )
    return len(text).to_bytes(4, "big") + text + jpeg.tobytes()


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket; BadData if the port is in use or the address is not ours."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except (OSError, OverflowError) as error:
        is_used = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
        problem = f"port {port} is in use" if is_used else f"cannot listen at {host}:{port}"
        raise BadData(f"{problem}: give another --port (0: any free one) or --host") from error


def address(listener: socket.socket, token: str) -> str:
    """Return the address of the page; a socket for all addresses has this computer's name."""
    host, port = listener.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = socket.gethostname()
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/?token={token}"
