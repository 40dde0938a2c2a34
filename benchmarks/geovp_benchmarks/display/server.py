"""Web server of the page: the newest view for a page that asks, and the driver's commands.

A view is the length of a JSON header (4 bytes, big endian), the header, and a JPEG of all panels
side by side. A page asks for another view when it has drawn the last one.
"""

import hmac
import json
import logging
import socket
import threading
from http.server import BaseHTTPRequestHandler
from importlib import resources
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import cv2
import numpy as np
import pydantic

from geovp_benchmarks.display.session import Session, Shown
from geovp_classic.errors import BadData

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; connect-src 'self'; img-src data:",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
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
        """Listen at an address; BadData if the port is in use or the address is not ours."""
        self.session = session
        self.token = token
        self._number = 0
        self._view = b""
        self._changed = threading.Condition()
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as error:
            advice = "give another --port (0: any free one) or --host"
            raise BadData(f"cannot listen at {host}:{port} ({error}): {advice}") from error

    @property
    def url(self) -> str:
        """Return the address of the page; a server at all addresses has this computer's name."""
        address, port, *_ = self.server_address
        host = socket.gethostname() if address in ("0.0.0.0", "::") else str(address)
        return f"http://{f'[{host}]' if ':' in host else host}:{port}/?token={self.token}"

    def play(self, stop: threading.Event) -> None:
        """Serve and play the session until `stop` is set or the session fails."""
        threading.Thread(target=self.serve_forever, daemon=True).start()
        try:
            self.session.run(self.publish, stop)
        finally:
            self.shutdown()

    def publish(self, shown: Shown) -> None:
        """Replace the view and wake the pages that wait for it; nothing is queued."""
        view = encode(shown, self._number + 1)
        with self._changed:
            self._number += 1
            self._view = view
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
    """One connection of a page: its page at /, views at /views, messages to /, and nothing else."""

    protocol_version = "HTTP/1.1"
    server: Server

    def parse_request(self) -> bool:
        """Refuse requests without the token, and those of a page of another site."""
        if not super().parse_request():
            return False
        parts = urlsplit(self.path)
        self.path = parts.path
        self.query = dict(parse_qsl(parts.query))
        token = self.query.get("token", "")
        origin = self.headers.get("Origin")
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            self.send_error(403, "Open the address that `geovp display` printed, with its token.")
        elif origin is not None and urlsplit(origin).netloc != self.headers.get("Host"):
            self.send_error(403, "The page is of another site.")
        else:
            return True
        return False

    def do_GET(self) -> None:
        """Send the page, or a newer view than the one with the number `after`."""
        if self.path == "/":
            text = resources.files(__package__).joinpath("page.html").read_text("utf-8")
            is_driven = "false" if self.server.session.driver is None else "true"
            text = text.replace('data-driven="false"', f'data-driven="{is_driven}"')
            self._send("text/html; charset=utf-8", text.encode())
        elif self.path == "/views":
            view = self.server.newer_than(int(self.query["after"]))
            self._send("application/octet-stream", view)
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
        headers = {"Content-Type": content_type, "Content-Length": str(len(content)), **HEADERS}
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Log no requests."""


def encode(shown: Shown, number: int) -> bytes:
    """Return a view with its number: header and JPEG."""
    header = json.dumps({**vars(shown), "panels": list(shown.panels), "number": number}).encode()
    strip = np.concatenate(list(shown.panels.values()), axis=1)
    _, jpeg = cv2.imencode(
        ".jpg", cv2.cvtColor(strip, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 80]
    )
    return len(header).to_bytes(4, "big") + header + jpeg.tobytes()
