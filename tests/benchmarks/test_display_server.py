"""The page of `geovp display`: its protocol, what it refuses, and the page in a browser."""

import asyncio
import json
import random
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest
import street

from geovp_benchmarks.display.channel import Channel
from geovp_benchmarks.display.commands import Driver, PlannedCommands
from geovp_benchmarks.display.session import Publish, Session, Shown
from geovp_classic.errors import BadData
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import street_source, write_images

aiohttp = pytest.importorskip("aiohttp", reason="needs the extra: display")
from aiohttp.test_utils import TestClient, TestServer  # noqa: E402

from geovp_benchmarks.display import server  # noqa: E402

TOKEN = "a-secret"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
READY = json.dumps({"is_ready": True})


class FakeSession:
    """A session that shows grey panels, brighter by one each time `show` is called."""

    def __init__(self) -> None:
        self.commands = Driver()
        self.is_dimming = False

    def shown(self, grey: int, size_px: int = 16) -> Shown:
        panel = np.full((size_px, size_px, 3), grey, np.uint8)
        return Shown({"late image": panel, "predicted present": panel}, None, 0.5, 0.9)


@asynccontextmanager
async def connected() -> AsyncIterator[tuple[TestClient[Any, Any], server.Server, dict[str, str]]]:
    """Yield a client, its server, and the headers of a page of this server."""
    pages = server.Server(cast(Session, FakeSession()), TOKEN)
    async with TestClient(TestServer(pages.application())) as client:
        origin = f"http://{client.host}:{client.port}"
        yield client, pages, {"Origin": origin}


def parsed(message: bytes) -> tuple[dict[str, Any], int]:
    """Return the header of a message, and the grey value of its image."""
    length = int.from_bytes(message[:4], "big")
    image = cv2.imdecode(np.frombuffer(message[4 + length :], np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (16, 32, 3)
    return json.loads(message[4 : 4 + length]), round(image.mean())


def test_a_slow_page_neither_delays_another_nor_fills_a_queue() -> None:
    async def check() -> None:
        async with connected() as (client, pages, headers):
            slow = await client.ws_connect(f"/views?token={TOKEN}", headers=headers)
            fast = await client.ws_connect(f"/views?token={TOKEN}", headers=headers)
            session = cast(FakeSession, pages.session)
            for grey in range(100):
                pages.newest.publish(server.encode(session.shown(grey)))
                header, shown = parsed(await fast.receive_bytes(timeout=5))
                assert shown == grey
                await fast.send_str(READY)
            assert header["panels"] == ["late image", "predicted present"]
            assert (header["warning"], header["age_s"], header["confidence"]) == (None, 0.5, 0.9)
            assert parsed(await slow.receive_bytes(timeout=5))[1] == 0
            await slow.send_str(READY)
            assert parsed(await slow.receive_bytes(timeout=5))[1] == 99
            late = await client.ws_connect(f"/views?token={TOKEN}", headers=headers)
            assert parsed(await late.receive_bytes(timeout=5))[1] == 99

    asyncio.run(check())


@pytest.mark.parametrize("token", ["", "?token=", "?token=a-secre", "?token=%F0%9F%98%80"])
def test_without_the_token_nothing_is_served(token: str) -> None:
    async def check() -> None:
        async with connected() as (client, _, headers):
            for path in ("/", "/views", "/page.html", "/../pyproject.toml"):
                response = await client.get(path + token, headers=headers)
                assert response.status == 403
                assert "secret" not in await response.text()
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await client.ws_connect("/views" + token, headers=headers)

    asyncio.run(check())


def test_pages_of_other_sites_are_refused() -> None:
    async def check() -> None:
        async with connected() as (client, _, headers):
            path = f"/views?token={TOKEN}"
            origins = ("http://evil.example", "null", headers["Origin"] + ".evil.example", "")
            for origin in origins:
                with pytest.raises(aiohttp.WSServerHandshakeError):
                    await client.ws_connect(path, headers={"Origin": origin})
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await client.ws_connect(path)
            page = await client.get(f"/?token={TOKEN}")
            assert "default-src 'none'" in page.headers["Content-Security-Policy"]
            assert 'data-driven="true"' in await page.text()

    asyncio.run(check())


def test_no_file_is_served() -> None:
    paths = ["server.py", "../session.py", "%2e%2e/%2e%2e/pyproject.toml", "/etc/passwd"]

    async def check(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, path: str) -> bytes:
        writer.write(f"GET /{path}?token={TOKEN} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        return await reader.readline()

    async def check_all() -> None:
        async with connected() as (client, _, _):
            for path in paths:  # written as they are, because clients normalise paths
                reader, writer = await asyncio.open_connection(client.host, client.port)
                assert b" 404 " in await check(reader, writer, path)
                writer.close()

    asyncio.run(check_all())


def test_malformed_messages_are_ignored() -> None:
    generator = random.Random(0)
    wrong = ["", "[", "null", "[" * 1000, '{"speed_m_s": 1e999}', '{"speed_m_s": NaN}']
    wrong += ['{"speed_m_s": "3"}', '{"speed_m_s": 1000}', '{"is_ready": 1}', '{"open": "file"}']
    while len(wrong) < 1000:
        wrong.append("".join(chr(generator.randrange(1, 0x2FF)) for _ in range(40)))

    async def check() -> None:
        async with connected() as (client, pages, headers):
            page = await client.ws_connect(f"/views?token={TOKEN}", headers=headers)
            session = cast(FakeSession, pages.session)
            for text in wrong:
                await page.send_str(text)
                await page.send_bytes(text.encode())
            await page.send_str('{"speed_m_s": 8.0, "yaw_rate_rad_s": 0.25, "is_dimming": true}')
            pages.newest.publish(server.encode(session.shown(10)))
            assert parsed(await page.receive_bytes(timeout=5))[1] == 10
            while not session.is_dimming:
                await asyncio.sleep(0.01)
            [command] = session.commands.at(0.0)
            assert (command.speed_m_s, command.yaw_rate_rad_s) == (8.0, 0.25)
            huge = await client.ws_connect(f"/views?token={TOKEN}", headers=headers)
            await huge.send_str("x" * 100_000)
            while (answer := await huge.receive(timeout=5)).type is not aiohttp.WSMsgType.CLOSE:
                pass
            assert answer.data == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
            await page.close()
            while session.commands.at(0.0):  # a driver who leaves releases the wheel
                await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(check(), 20))


def test_a_port_in_use_gets_one_sentence(tmp_path: Path, refused: Says) -> None:
    write_images(tmp_path, street.clip().frames[:3])
    with server.listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        words = ["--fps", "10", "--fov", "70", "--port", port]
        assert f"port {port} is in use" in refused("display", tmp_path, *words)


def test_addresses() -> None:
    with server.listen("127.0.0.1", 0) as listener:
        port = listener.getsockname()[1]
        assert server.address(listener, "abc") == f"http://127.0.0.1:{port}/?token=abc"
    with server.listen("0.0.0.0", 0) as listener:
        assert server.address(listener, "abc").startswith(f"http://{socket.gethostname()}:")
    for host, port in [("192.0.2.1", 0), ("127.0.0.1", 70000), ("no.such.host.invalid", 0)]:
        with pytest.raises(BadData, match="give another --port"):
            server.listen(host, port)


def test_a_failed_session_ends_the_server() -> None:
    class Failing(FakeSession):
        def run(self, publish: Publish, stop: threading.Event) -> None:
            publish(self.shown(10))
            raise BadData("the camera is gone")

    with server.listen("127.0.0.1", 0) as listener, pytest.raises(BadData, match="is gone"):
        asyncio.run(server.Server(cast(Session, Failing()), TOKEN).run(listener))


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

    async def wait(self, script: str, timeout_s: float = 15.0) -> Any:
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
    assert CHROMIUM is not None
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


async def served(
    session: Session, listener: socket.socket, use: Callable[[], Awaitable[None]]
) -> None:
    """Serve a session while something is done."""
    serving = asyncio.create_task(server.Server(session, TOKEN).run(listener))
    try:
        await use()
    finally:
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome on the PATH")
def test_the_page_in_a_browser(tmp_path: Path) -> None:
    """Views arrive and change, a blackout raises the warning, and a restart is survived."""
    frames = street.clip(num_frames=70).frames.copy()
    frames[50:] = 0  # five seconds are enough for a busy machine
    listener = server.listen("127.0.0.1", 0)
    port = listener.getsockname()[1]
    warning = "document.getElementById('warning')"
    shown = "document.querySelectorAll('canvas')[2].toDataURL()"

    def session() -> Session:
        return Session(street_source(frames), Channel(0.1), PlannedCommands())

    async def check() -> None:
        async with browsing(server.address(listener, TOKEN), tmp_path) as browser:

            async def watch() -> None:
                await browser.wait("document.querySelectorAll('canvas').length === 3")
                first = await browser.value(shown)
                await browser.wait(f"{shown} !== {json.dumps(first)}")
                await browser.wait(f"{warning}.textContent.includes('No warning')")
                await browser.wait(f"{warning}.textContent.includes('blank')")
                assert await browser.value(f"{warning}.className") == "is-on"
                assert await browser.value(
                    "parseFloat(document.getElementById('rate').textContent)"
                )

            async def watch_again() -> None:
                await browser.wait(f"!{warning}.textContent.includes('connection')")
                await browser.wait(f"{shown} !== {json.dumps(await browser.value(shown))}")
                wide = "document.documentElement.scrollWidth > document.documentElement.clientWidth"
                await browser.resize(400)
                assert not await browser.value(wide)

            await served(session(), listener, watch)
            await browser.wait(f"{warning}.textContent.includes('connection is lost')")
            await served(session(), server.listen("127.0.0.1", port), watch_again)

    asyncio.run(check())
