"""Drives a headless Chromium by its DevTools protocol: one tab, its console, mouse and pictures."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
START_S = 30.0
MOST_ERRORS = 3


def program() -> str | None:
    """Return the path of a Chromium; None: there is none."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Tab:
    """A tab.

    Attributes:
        errors: What the page has complained of on its console.
    """

    def __init__(self, link: ClientConnection) -> None:
        self._link = link
        self._count = 0
        self.errors: list[str] = []

    def call(self, method: str, **parameters: object) -> Any:
        """Call a method of the protocol, and return its result."""
        self._count += 1
        self._link.send(json.dumps({"id": self._count, "method": method, "params": parameters}))
        while True:
            said = json.loads(self._link.recv(timeout=START_S))
            if said.get("id") == self._count:
                assert "error" not in said, said["error"]
                return said["result"]
            self._hear(said)

    def _hear(self, said: dict[str, Any]) -> None:
        if len(self.errors) > MOST_ERRORS:
            return
        details = said.get("params", {})
        match said["method"]:
            case "Runtime.exceptionThrown":
                self.errors.append(json.dumps(details["exceptionDetails"])[:600])
            case "Runtime.consoleAPICalled" if details["type"] in ("error", "assert"):
                self.errors.append(json.dumps(details["args"])[:600])
            case "Log.entryAdded" if details["entry"]["level"] == "error":
                self.errors.append(details["entry"]["text"])

    def value(self, expression: str) -> Any:
        """Return the value of an expression in the page, and that of a promise once it is there."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str, seconds: float = 60.0) -> Any:
        """Wait until an expression is true; return its value."""
        end_s = time.monotonic() + seconds
        while not (found := self.value(expression)):
            text = self.value("document.body?.innerText ?? ''")
            assert time.monotonic() < end_s, f"{expression}\n{text}\n{self.errors}"
            time.sleep(0.02)
        return found

    def open(self, address: str) -> None:
        """Open an address, and wait until it is loaded."""
        self.call("Page.navigate", url=address)
        self.wait(f"document.readyState === 'complete' && location.href === {json.dumps(address)}")

    def look(self, width: int, height: int, *, dark: bool = False, phone: bool = False) -> None:
        """Set size and colours."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if phone else 1,
            mobile=phone,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def mouse(self, kind: str, x: float, y: float, **more: object) -> None:
        """Send an event of the mouse: ``mousePressed``, ``mouseMoved``, ``mouseReleased``."""
        button = {"button": "left", "buttons": 0 if kind == "mouseReleased" else 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, clickCount=1, **(button | more))

    def shot(self, *, whole: bool = False) -> bytes:
        """Return what is seen as PNG; ``whole``: the page, as far as it goes."""
        found = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        return base64.b64decode(found["data"])

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Save what is seen as PNG."""
        path.write_bytes(self.shot(whole=whole))


@contextlib.contextmanager
def chromium(folder: Path) -> Iterator[Tab]:
    """A browser with one tab, as long as the block lasts.

    Args:
        folder: Empty; keeps its profile.
    """
    path = program()
    assert path is not None
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"]
    options += ["--disable-background-networking", "--disable-component-update"]
    options += ["--remote-debugging-port=0", f"--user-data-dir={folder}", "about:blank"]
    browser = subprocess.Popen(
        [path, *options], process_group=0, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        port = _port(folder / "DevToolsActivePort", browser)
        with connect(f"ws://127.0.0.1:{port}{_tab(port)}", max_size=1 << 26) as link:
            tab = Tab(link)
            for domain in ("Runtime", "Log", "Page"):
                tab.call(f"{domain}.enable")
            yield tab
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(browser.pid, 9)
        browser.wait()


def _port(file: Path, browser: subprocess.Popen[bytes]) -> int:
    end_s = time.monotonic() + START_S
    while not (file.exists() and "\n" in file.read_text()):
        assert browser.poll() is None, f"Chromium ended with {browser.returncode}"
        assert time.monotonic() < end_s, "Chromium does not start"
        time.sleep(0.02)
    return int(file.read_text().split()[0])


def _tab(port: int) -> str:
    from urllib.parse import urlsplit
    from urllib.request import urlopen

    with urlopen(f"http://127.0.0.1:{port}/json/list") as found:
        tabs = json.load(found)
    address: str = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
    return urlsplit(address).path
