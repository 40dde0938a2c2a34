"""Web server of the page: the newest view for a page that asks, and the driver's commands.

A view is a JSON object with the panels as data URLs. A page asks for another view when it has drawn
the last one. Connections that do not present the token in time are closed, and so are those that
take a view too slowly; the oldest without a token makes room for a new one.
"""

import asyncio
import base64
import hmac
import json
import socket
import threading
from collections.abc import Callable
from importlib import resources
from typing import Any, Self
from urllib.parse import unquote

import cv2
import pydantic
from aiohttp import web

from geovp.display.session import Session, Shown
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray


class FromPage(pydantic.BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """A message of the page."""

    is_dimming: bool | None = None
    is_marking: bool | None = None
    speed_m_s: float | None = pydantic.Field(None, ge=-20, le=60)
    yaw_rate_rad_s: float = pydantic.Field(0.0, ge=-2, le=2)


class Server:
    """The page of a session, for everyone who has the token."""

    def __init__(
        self,
        session: Session,
        host: str,
        port: int,
        token: str,
        timeout_s: float = 10.0,  # until a connection presents the token, or has taken a view
        max_strangers: int = 64,  # connections that have not presented the token
        max_bytes: int = 1024,  # of a message
    ) -> None:
        """Listen at an IPv4 address; BadData if the port is in use or the address is not ours."""
        self.session = session
        self.root = f"/{token}/"
        self.timeout_s = timeout_s
        self.max_strangers = max_strangers
        self.max_bytes = max_bytes
        self._view = 0, b""  # number, content
        self._strangers: dict[Any, None] = {}  # by age
        try:
            self._socket = socket.create_server((host, port), backlog=512)
        except (OSError, OverflowError) as error:
            advice = "give another --port (0: any free one) or --host"
            raise BadData(f"cannot listen at {host}:{port} ({error}): {advice}") from error
        self._loop = asyncio.new_event_loop()
        self._changed = asyncio.Event()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(
            target=lambda: self._loop.run_until_complete(self._serve()), daemon=True
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def address(self) -> tuple[str, int]:
        """Return host and port."""
        host, port = self._socket.getsockname()
        return host, port

    @property
    def url(self) -> str:
        """Return the address of the page; a server at all addresses has this computer's name."""
        host, port = self.address
        if host == "0.0.0.0":
            host = socket.gethostname()
        return f"http://{host}:{port}{self.root}"

    def play(self, stop: threading.Event) -> None:
        """Serve and play the session until `stop` is set or the session fails."""
        self.start()
        try:
            self.session.run(self.publish, stop)
        finally:
            self.close()

    def start(self) -> None:
        """Serve in another thread."""
        self._thread.start()

    def close(self) -> None:
        """Close all connections and the port."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()
        self._socket.close()

    def publish(self, shown: Shown) -> None:
        """Replace the view and wake the pages that wait for it; nothing is queued."""
        panels = {name: data_url(frame) for name, frame in shown.panels.items()}
        is_driven = self.session.driver is not None
        number = self._view[0] + 1
        view = {**vars(shown), "panels": panels, "is_driven": is_driven, "number": number}
        self._view = number, json.dumps(view).encode()
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def _serve(self) -> None:
        """Serve until the server is stopped."""
        server = web.Server(self._answer, handler_cancellation=True, access_log=None)
        listener = await self._loop.create_server(self._admitting(server), sock=self._socket)
        await self._stop.wait()
        listener.close()
        await server.shutdown(0.1)

    def _admitting(self, server: web.Server) -> Callable[[], asyncio.Protocol]:
        """Return a function that makes a connection, and limits those without a token."""

        def admit() -> asyncio.Protocol:
            connection = server()
            if len(self._strangers) >= self.max_strangers:
                self._expel(next(iter(self._strangers)))
            self._strangers[connection] = None
            self._loop.call_later(self.timeout_s, self._expel, connection)
            return connection

        return admit

    def _expel(self, connection: Any) -> None:
        """Close a connection unless it has presented the token."""
        if connection in self._strangers:
            del self._strangers[connection]
            # later, because the newest ones have no transport yet
            self._loop.call_later(0.1, _abort, connection)

    async def _answer(self, request: web.BaseRequest) -> web.StreamResponse:
        """Answer a request; below the token are the page, views/NUMBER, and nothing else."""
        path = unquote(request.raw_path.partition("?")[0])
        has_token = hmac.compare_digest(path[: len(self.root)].encode(), self.root.encode())
        host = request.headers.get("Host", "")
        origin = request.headers.get("Origin", f"http://{host}")
        if not has_token or origin.partition("//")[2] != host:  # of a page of another site
            advice = "Open the address that `geovp display` printed, with its token."
            return web.Response(status=403, text=advice)
        self._strangers.pop(request.protocol, None)
        path = path[len(self.root) :]
        folder, _, number = path.rpartition("/")
        if request.method == "POST":
            return await self._follow(request)
        if request.method not in ("GET", "HEAD"):
            return web.Response(status=405)
        if path == "":
            page = resources.files(__package__).joinpath("page.html")
            return await self._send(request, "text/html; charset=utf-8", page.read_bytes())
        if folder == "views" and number.isdecimal():
            view = await self._newer_than(int(number))
            return await self._send(request, "application/json", view)
        return web.Response(status=404)

    async def _newer_than(self, number: int) -> bytes:
        """Wait for a view with another number, and return it."""
        while self._view[0] == number:
            await self._changed.wait()
        return self._view[1]

    async def _follow(self, request: web.BaseRequest) -> web.StreamResponse:
        """Follow a message of the page; refuse a malformed one."""
        try:
            async with asyncio.timeout(self.timeout_s):
                text = await request.content.read(self.max_bytes + 1)
            message = FromPage.model_validate_json(text[: self.max_bytes + 1])
        except (pydantic.ValidationError, TimeoutError):
            return web.Response(status=400)
        session = self.session
        if message.is_dimming is not None:
            session.is_dimming = message.is_dimming
        if message.is_marking is not None:
            session.is_marking = message.is_marking
        if message.speed_m_s is not None and session.driver is not None:
            session.driver.steer(message.speed_m_s, message.yaw_rate_rad_s)
        return await self._send(request, "text/plain", b"")

    async def _send(
        self, request: web.BaseRequest, content_type: str, content: bytes
    ) -> web.StreamResponse:
        """Send a response; close a connection that does not take it in time."""
        headers = {
            "Content-Type": content_type,
            "Content-Length": str(len(content)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; "
            "style-src 'unsafe-inline'; connect-src 'self'; img-src data:",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
        response = web.StreamResponse(headers=headers)
        try:
            async with asyncio.timeout(self.timeout_s):
                await response.prepare(request)
                if request.method != "HEAD":
                    await response.write(content)
                await response.write_eof()
        except TimeoutError:
            _abort(request.protocol)
        return response


def _abort(connection: Any) -> None:
    """Close a connection at once, unless it is closed."""
    if connection.transport is not None:
        connection.transport.abort()


def data_url(frame: ByteArray) -> str:
    """Return a frame [H, W, 3] as JPEG in an address."""
    _, jpeg = cv2.imencode(".jpg", frame[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode()
