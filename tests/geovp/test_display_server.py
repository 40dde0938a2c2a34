"""The page of `geovp display`: its protocol, what it refuses, and the page in a browser."""

import asyncio
import base64
import contextlib
import http.client
import json
import random
import resource
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from email.message import Message
from pathlib import Path
from typing import Any, cast

import aiohttp
import cv2
import numpy as np
import pytest
import street

from geovp.display import server
from geovp.display.channel import Channel
from geovp.display.commands import Driver
from geovp.display.session import Publish, Session, Shown
from geovp_classic.errors import BadData
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import street_source, write_images

TOKEN = "a-secret"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


class FakeSession:
    """A session that shows grey panels."""

    def __init__(self) -> None:
        self.driver = Driver()
        self.is_dimming = False
        self.is_marking = False

    def shown(self, grey: int, size_px: int = 16) -> Shown:
        panel = np.full((size_px, size_px, 3), grey, np.uint8)
        return Shown({"late image": panel, "predicted present": panel}, None, None, 0.5, 0.9)


class Client:
    """One connection to the server of a fake session."""

    def __init__(self, pages: server.Server) -> None:
        host, port = pages.address
        self.origin = f"http://{host}:{port}"
        self.connection = http.client.HTTPConnection(str(host), port, timeout=5)

    def ask(
        self, path: str, content: bytes | None = None, origin: str | None = None
    ) -> tuple[int, bytes, Message]:
        """Return status, content and headers of the response."""
        headers = {} if origin is None else {"Origin": origin}
        self.connection.request("GET" if content is None else "POST", path, content, headers)
        response = self.connection.getresponse()
        return response.status, response.read(), response.headers

    def view(self, number: int) -> tuple[dict[str, Any], int]:
        """Return the view after this one, and the grey value of its last panel."""
        status, message, _ = self.ask(f"/{TOKEN}/views/{number}")
        assert status == 200
        view = json.loads(message)
        for url in view["panels"].values():
            jpeg = base64.b64decode(url.removeprefix("data:image/jpeg;base64,"))
            image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
            assert image.shape == (16, 16, 3)
        return view, round(image.mean())


@pytest.fixture
def pages() -> Iterator[server.Server]:
    """Serve a fake session."""
    with server.Server(cast(Session, FakeSession()), "127.0.0.1", 0, TOKEN) as pages:
        pages.start()
        yield pages


def test_a_slow_page_neither_delays_another_nor_fills_a_queue(pages: server.Server) -> None:
    slow, fast, session = Client(pages), Client(pages), cast(FakeSession, pages.session)
    pages.publish(session.shown(0))
    assert slow.view(0)[1] == 0
    number = 1
    for grey in range(1, 100):
        pages.publish(session.shown(grey))
        view, shown = fast.view(number)
        number = view["number"]
        assert shown == grey
    assert list(view["panels"]) == ["late image", "predicted present"]
    assert (view["warning"], view["age_s"], view["confidence"]) == (None, 0.5, 0.9)
    assert view["is_driven"]
    assert slow.view(1)[1] == 99
    assert Client(pages).view(0)[1] == 99
    threading.Timer(0.2, pages.publish, [session.shown(100)]).start()
    assert slow.view(number)[1] == 100  # after it has waited for it


def test_idle_connections_and_a_slow_client_leave_a_page_its_views() -> None:
    """2,000 connections send nothing; another asks for a view of 12 MB and reads none of it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 5000:
        pytest.skip("5,000 open files are not permitted here")
    resource.setrlimit(resource.RLIMIT_NOFILE, (5000, hard))
    session = FakeSession()
    with (
        contextlib.ExitStack() as stack,
        server.Server(cast(Session, session), "127.0.0.1", 0, TOKEN, timeout_s=2) as pages,
    ):
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        pages.start()
        num_threads = threading.active_count()
        idle = [stack.enter_context(socket.create_connection(pages.address)) for _ in range(2000)]
        slow = stack.enter_context(socket.create_connection(pages.address))
        noise = np.random.default_rng(0).integers(0, 256, (2000, 2000, 3), np.uint8)
        pages.publish(Shown({"late image": noise}, None, None, 0.5, 0.9))
        slow.sendall(f"GET /{TOKEN}/views/0 HTTP/1.1\r\nHost: a\r\n\r\n".encode())
        pages.publish(session.shown(7))
        page = Client(pages)
        start_s = time.monotonic()
        assert page.view(1)[1] == 7
        assert time.monotonic() - start_s < 2
        assert threading.active_count() == num_threads
        time.sleep(3)
        for connection in idle:
            connection.settimeout(5)
            with contextlib.suppress(ConnectionResetError):
                assert connection.recv(1) == b""  # closed
        pages.publish(session.shown(8))
        assert page.view(2)[1] == 8  # a connection with the token stays open


@pytest.mark.parametrize("token", ["", "/", "/a-secre", "/a-secrets", "/%F0%9F%98%80"])
def test_without_the_token_nothing_is_served(pages: server.Server, token: str) -> None:
    for path in ("/", "/views/0", "/page.html", "/../pyproject.toml"):
        for content in (None, b"{}"):
            status, text, _ = Client(pages).ask(token + path, content)
            assert status == 403
            assert b"secret" not in text


def test_pages_of_other_sites_are_refused(pages: server.Server) -> None:
    client = Client(pages)
    for origin in ("http://evil.example", "null", f"{client.origin}.evil.example", ""):
        for content in (None, b"{}"):
            assert Client(pages).ask(f"/{TOKEN}/", content, origin)[0] == 403
    status, text, headers = client.ask(f"/{TOKEN}/", origin=client.origin)
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert b"GeoVP display" in text


@pytest.mark.parametrize(
    "path",
    ["/server.py", "/../session.py", "/%2e%2e/%2e%2e/pyproject.toml", "//etc/passwd", "/views/x"],
)
def test_no_file_is_served(pages: server.Server, path: str) -> None:
    assert Client(pages).ask(f"/{TOKEN}{path}")[0] == 404


def test_other_methods_are_refused(pages: server.Server) -> None:
    client = Client(pages).connection
    for method, status in {"HEAD": 200, "PUT": 405, "DELETE": 405}.items():
        client.request(method, f"/{TOKEN}/")
        response = client.getresponse()
        assert (response.status, response.read()) == (status, b"")


def test_malformed_messages_are_refused(pages: server.Server) -> None:
    generator = random.Random(0)
    session = cast(FakeSession, pages.session)
    wrong = ["", "[", "null", "[" * 1000, '{"speed_m_s": 1e999}', '{"speed_m_s": NaN}']
    wrong += ['{"speed_m_s": "3"}', '{"speed_m_s": 1000}', '{"is_dimming": 1}', '{"open": "file"}']
    while len(wrong) < 200:
        wrong.append("".join(chr(generator.randrange(1, 0x2FF)) for _ in range(40)))
    for text in [*wrong, "x" * 100_000]:
        assert Client(pages).ask(f"/{TOKEN}/", text.encode())[0] == 400
    assert not session.driver.at(0.0)
    assert not session.is_dimming
    good = b'{"speed_m_s": 8.0, "yaw_rate_rad_s": 0.25, "is_dimming": true, "is_marking": true}'
    assert Client(pages).ask(f"/{TOKEN}/", good)[0] == 200
    [command] = session.driver.at(0.0)
    assert (command.speed_m_s, command.yaw_rate_rad_s) == (8.0, 0.25)
    assert session.is_dimming
    assert session.is_marking


def test_a_port_in_use_gets_one_sentence(tmp_path: Path, refused: Says) -> None:
    write_images(tmp_path, street.clip().frames[:3])
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = ["--fps", "10", "--fov", "70", "--port", port]
        assert f"cannot listen at 127.0.0.1:{port}" in refused("display", tmp_path, *words)


def test_addresses() -> None:
    session = cast(Session, FakeSession())
    with server.Server(session, "127.0.0.1", 0, "abc") as pages:
        assert pages.url == f"http://127.0.0.1:{pages.address[1]}/abc/"
    with server.Server(session, "0.0.0.0", 0, "abc") as pages:
        assert pages.url.startswith(f"http://{socket.gethostname()}:")
    for host, port in [("192.0.2.1", 0), ("127.0.0.1", 70000), ("no.such.host.invalid", 0)]:
        with pytest.raises(BadData, match="give another --port"):
            server.Server(session, host, port, "abc")


def test_a_failed_session_ends_the_server() -> None:
    class Failing(FakeSession):
        def run(self, publish: Publish, stop: threading.Event) -> None:
            publish(self.shown(10))
            raise BadData("the camera is gone")

    pages = server.Server(cast(Session, Failing()), "127.0.0.1", 0, TOKEN)
    with pages, pytest.raises(BadData, match="is gone"):
        pages.play(threading.Event())


class Browser:
    """A page in headless Chromium, over the DevTools protocol."""

    def __init__(self, tab: Any) -> None:
        self._tab = tab
        self._number = 0

    async def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._number += 1
        await self._tab.send_json({"id": self._number, "method": method, "params": params})
        while (answer := await self._tab.receive_json(timeout=20)).get("id") != self._number:
            pass
        return dict(answer["result"])

    async def value(self, script: str) -> Any:
        """Return the value of a script in the page."""
        answer = await self.call("Runtime.evaluate", expression=script, returnByValue=True)
        return answer["result"].get("value")

    async def wait(self, script: str, timeout_s: float = 60.0) -> Any:
        """Wait until the value of a script is true, and return it."""
        end_s = time.monotonic() + timeout_s
        while not (value := await self.value(script)):
            assert time.monotonic() < end_s, f"never true: {script}"
            await asyncio.sleep(0.05)
        return value

    async def resize(self, width_px: int) -> None:
        """Show the page at a width, of a phone below 500 px."""
        size = {"width": width_px, "height": 900, "deviceScaleFactor": 1, "mobile": width_px < 500}
        await self.call("Emulation.setDeviceMetricsOverride", **size)


@asynccontextmanager
async def browsing(url: str, profile: Path) -> AsyncIterator[Browser]:
    """Yield a page in a browser that is closed at the end."""
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    options += ["--remote-debugging-port=0", f"--user-data-dir={profile}"]
    process = subprocess.Popen([CHROMIUM, *options, url], stderr=subprocess.DEVNULL)
    try:
        port_file = profile / "DevToolsActivePort"
        end_s = time.monotonic() + 30
        while not (port_file.exists() and port_file.read_text().count("\n")):
            assert time.monotonic() < end_s, "chromium does not start"
            await asyncio.sleep(0.05)
        port = port_file.read_text().splitlines()[0]
        async with aiohttp.ClientSession() as client:
            tabs: list[dict[str, str]] = []
            while not tabs:
                async with client.get(f"http://127.0.0.1:{port}/json") as response:
                    tabs = [tab for tab in await response.json() if tab["type"] == "page"]
            async with client.ws_connect(tabs[0]["webSocketDebuggerUrl"], max_msg_size=0) as tab:
                yield Browser(tab)
    finally:
        process.terminate()
        process.wait(10)


async def served(pages: server.Server, use: Callable[[], Awaitable[None]]) -> None:
    """Serve a session while something is done."""
    stop = threading.Event()
    with pages:
        serving = asyncio.create_task(asyncio.to_thread(pages.play, stop))
        try:
            await use()
        finally:
            stop.set()
            await serving


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome on the PATH")
def test_the_page_in_a_browser(tmp_path: Path) -> None:
    """Views arrive and change, a blackout raises the warning, and a restart is survived."""
    frames = street.clip(num_frames=70).frames.copy()
    frames[50:] = 0  # five seconds are enough for a busy machine
    warning = "document.getElementById('warning')"
    shown = "document.querySelectorAll('figure img')[2].src"
    warned, advised = "warn('late')", "warn('unsure', 'caution')"
    colour = f"getComputedStyle({warning}).backgroundColor"

    def listening(port: int) -> server.Server:
        session = Session(street_source(frames), Channel(0.1), driver=Driver())
        return server.Server(session, "127.0.0.1", port, TOKEN)

    pages = listening(0)
    port = pages.address[1]  # the second server listens there, too

    async def check() -> None:
        async with browsing(pages.url, tmp_path) as browser:

            async def watch() -> None:
                await browser.wait("document.querySelectorAll('figure img').length === 3")
                first = await browser.value(shown)
                await browser.wait(f"{shown} !== {json.dumps(first)}")
                await browser.wait(f"{warning}.textContent.includes('No warning')")
                await browser.wait(f"{warning}.textContent.includes('blank')")
                await browser.value("hold('ArrowUp', true)")
                await browser.wait("document.getElementById('order').textContent.includes('km/h')")
                while not pages.session.driver.at(0.0):
                    await asyncio.sleep(0.01)
                await browser.value(
                    "hold('ArrowUp', false); element('dim').click(); element('mark').click()"
                )
                await browser.wait("element('dim').checked && !isSending")
                while not (pages.session.is_dimming and pages.session.is_marking):
                    await asyncio.sleep(0.01)
                assert await browser.value(f"{warning}.className") == "alert"
                assert await browser.value(f"{warned}; {colour}") == "rgb(179, 32, 31)"  # red
                assert await browser.value(f"{advised}; {colour}") == "rgb(148, 87, 10)"  # amber
                assert await browser.value(
                    "parseFloat(document.getElementById('rate').textContent)"
                )

            async def watch_again() -> None:
                await browser.wait(f"!{warning}.textContent.includes('connection')")
                await browser.wait(f"{shown} !== {json.dumps(await browser.value(shown))}")
                wide = "document.documentElement.scrollWidth > document.documentElement.clientWidth"
                await browser.resize(400)
                assert not await browser.value(wide)

            await served(pages, watch)
            await browser.wait(f"{warning}.textContent.includes('connection is lost')")
            await served(listening(port), watch_again)

    asyncio.run(check())
