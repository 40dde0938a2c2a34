"""Web server of the page: the newest view for a page that asks, and the driver's commands.

A view is a JSON object with the panels as data URLs. A page asks for another view when it has drawn
the last one.
"""

import base64
import hmac
import json
import logging
import socket
import threading
from http.server import BaseHTTPRequestHandler
from importlib import resources
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import unquote

import cv2
import pydantic

from geovp.display.session import Session, Shown
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray

logger = logging.getLogger(__name__)


class FromPage(pydantic.BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """A message of the page."""

    is_dimming: bool | None = None
    speed_m_s: float | None = pydantic.Field(None, ge=-20, le=60)
    yaw_rate_rad_s: float = pydantic.Field(0.0, ge=-2, le=2)


class Server(ThreadingTCPServer):
    """The page of a session, for everyone who has the token."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, session: Session, host: str, port: int, token: str) -> None:
        """Listen at an IPv4 address; BadData if the port is in use or the address is not ours."""
        self.session = session
        self.root = f"/{token}/"
        self._number = 0
        self._view = b""
        self._changed = threading.Condition()
        try:
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as error:
            advice = "give another --port (0: any free one) or --host"
            raise BadData(f"cannot listen at {host}:{port} ({error}): {advice}") from error

    @property
    def url(self) -> str:
        """Return the address of the page; a server at all addresses has this computer's name."""
        host, port = self.socket.getsockname()
        if host == "0.0.0.0":
            host = socket.gethostname()
        return f"http://{host}:{port}{self.root}"

    def play(self, stop: threading.Event) -> None:
        """Serve and play the session until `stop` is set or the session fails."""
        threading.Thread(target=self.serve_forever, daemon=True).start()
        try:
            self.session.run(self.publish, stop)
        finally:
            self.shutdown()

    def publish(self, shown: Shown) -> None:
        """Replace the view and wake the pages that wait for it; nothing is queued."""
        panels = {name: data_url(frame) for name, frame in shown.panels.items()}
        is_driven = self.session.driver is not None
        number = self._number + 1
        view = {**vars(shown), "panels": panels, "is_driven": is_driven, "number": number}
        with self._changed:
            self._number = number
            self._view = json.dumps(view).encode()
            self._changed.notify_all()

    def newer_than(self, number: int) -> bytes:
        """Wait for a view with another number, and return it."""
        with self._changed:
            self._changed.wait_for(lambda: self._number != number)
            return self._view

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log an error, such as of a page that was closed."""
        logger.info("connection of %s", client_address, exc_info=True)


class Handler(BaseHTTPRequestHandler):
    """One connection of a page; below the token are the page, views/NUMBER, and nothing else."""

    protocol_version = "HTTP/1.1"
    server: Server

    def parse_request(self) -> bool:
        """Refuse requests without the token, and those of a page of another site."""
        if not super().parse_request():
            return False
        path, root = unquote(self.path), self.server.root
        self.path = path[len(root) :]
        has_token = hmac.compare_digest(path[: len(root)].encode(), root.encode())
        origin = self.headers.get("Origin", f"http://{self.headers['Host']}")
        is_allowed = has_token and origin.partition("//")[2] == self.headers["Host"]
        if not is_allowed:
            self.send_error(403, "Open the address that `geovp display` printed, with its token.")
        return is_allowed

    def do_GET(self) -> None:
        """Send the page, or a newer view than the one with the number in the path."""
        folder, _, number = self.path.rpartition("/")
        if self.path == "":
            page = resources.files(__package__).joinpath("page.html")
            self._send("text/html; charset=utf-8", page.read_bytes())
        elif folder == "views" and number.isdecimal():
            self._send("application/json", self.server.newer_than(int(number)))
        else:
            self.send_error(404)

    def do_POST(self) -> None:
        """Follow a message of the page; refuse a malformed one."""
        length = int(self.headers.get("Content-Length", "0"))
        session = self.server.session
        try:
            text = self.rfile.read(length) if 0 < length <= 1024 else b""
            message = FromPage.model_validate_json(text)
        except pydantic.ValidationError:
            self.send_error(400)
            return
        if message.is_dimming is not None:
            session.is_dimming = message.is_dimming
        if message.speed_m_s is not None and session.driver is not None:
            session.driver.steer(message.speed_m_s, message.yaw_rate_rad_s)
        self._send("text/plain", b"")

    def _send(self, content_type: str, content: bytes) -> None:
        self.send_response(200)
        headers = {
            "Content-Type": content_type,
            "Content-Length": str(len(content)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; "
            "style-src 'unsafe-inline'; connect-src 'self'; img-src data:",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Log no requests."""


def data_url(frame: ByteArray) -> str:
    """Return a frame [H, W, 3] as JPEG in an address."""
    _, jpeg = cv2.imencode(".jpg", frame[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode()
