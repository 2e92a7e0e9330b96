"""A real browser without a window: Chromium over its debugging pipe, for tests of the pages we write."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

PROGRAM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
needs_browser = pytest.mark.skipif(PROGRAM is None, reason="no Chromium on this machine")

# what a page may ask for without leaving the machine
_LOCAL = ("file:", "data:", "blob:", "about:")
# advice on speed: of the driver, and on how plotly measures its texts
_SLOW = ("GL Driver Message (OpenGL, Performance", "Canvas2D: Multiple readback operations")


class Browser:
    """One Chromium process; `page` opens files in it."""

    def __init__(self, folder: Path) -> None:
        # above the numbers 3 and 4, which the browser wants
        ours = [os.dup(fd) for fd in os.pipe()]
        theirs = [os.dup(fd) for fd in os.pipe()]
        switches = [
            "--headless=new", "--no-sandbox", "--remote-debugging-pipe", f"--user-data-dir={folder}",
            "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
            "--disable-background-networking", "--no-first-run", "--hide-scrollbars", "--force-device-scale-factor=1",
        ]  # fmt: skip
        self._process = subprocess.Popen(
            [
                "/bin/bash",
                "-c",
                f'exec "$@" 3<&{ours[0]} 4>&{theirs[1]}',
                "bash",
                PROGRAM,
                *switches,
            ],
            pass_fds=(ours[0], theirs[1]),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(ours[0])
        os.close(theirs[1])
        self._out = ours[1]
        self._in = theirs[0]
        self._rest = b""
        self._number = 0
        self.events = []

    def call(self, method, session=None, timeout_s=60.0, **params):
        """Send a command; return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            answer = self._read(end)
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self.events.append(answer)
        raise TimeoutError(method)

    def _read(self, end):
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], max(end - time.monotonic(), 0))
            block = os.read(self._in, 1 << 20) if ready else b""
            if not block:
                raise TimeoutError("the browser does not answer")
            self._rest += block
        line, _, self._rest = self._rest.partition(b"\0")
        return json.loads(line)

    def page(self, path, width=1200, height=800):
        return Page(self, Path(path).resolve().as_uri(), width, height)

    def open(self, address, width=1200, height=800):
        """Open a page of a server on this machine."""
        return Page(self, address, width, height)

    def close(self):
        """End the process and everything it started."""
        try:
            self.call("Browser.close", timeout_s=10.0)
            self._process.wait(10)
        except (TimeoutError, OSError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        os.close(self._out)
        os.close(self._in)


class Page:
    """A file or a page of a server in the browser, with what it said and asked for."""

    def __init__(self, browser, address, width, height):
        self._browser = browser
        self._address = address
        self.width = width
        self.height = height
        target = browser.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = browser.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        self._target = target
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 500,
        )
        self.call("Page.navigate", url=address)
        self.wait("document.readyState === 'complete'")

    def call(self, method, **params):
        return self._browser.call(method, self._session, **params)

    def run(self, script):
        """Return the value of a script."""
        result = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, condition, timeout_s=40.0):
        """Wait until a script's value is true."""
        end = time.monotonic() + timeout_s
        while not self.run(condition):
            assert time.monotonic() < end, f"not true in time: {condition}"
            time.sleep(0.05)

    def mouse(self, kind, x, y, **more):
        button = "left" if kind != "mouseMoved" or more.get("buttons") else "none"
        self.call(
            "Input.dispatchMouseEvent", **{"type": kind, "x": x, "y": y, "button": button, **more}
        )

    def click(self, x, y, count=1):
        self.mouse("mouseMoved", x, y)
        for n in range(1, count + 1):
            self.mouse("mousePressed", x, y, clickCount=n)
            self.mouse("mouseReleased", x, y, clickCount=n)

    def drag(self, start, end, modifiers=0, steps=4):
        """Drag from a point to another; modifiers: 1 Alt, 2 Ctrl, 8 Shift."""
        self.mouse("mousePressed", *start, clickCount=1, modifiers=modifiers)
        for n in range(1, steps + 1):
            x, y = (a + (b - a) * n / steps for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", x, y, buttons=1, modifiers=modifiers)
        self.mouse("mouseReleased", *end, clickCount=1, modifiers=modifiers)

    def _events(self, method):
        return [
            e["params"]
            for e in self._browser.events
            if e.get("sessionId") == self._session and e["method"] == method
        ]

    @property
    def complaints(self):
        """Errors and warnings: of scripts, of the console and of the browser itself."""
        told = [str(e["exceptionDetails"]) for e in self._events("Runtime.exceptionThrown")]
        told += [
            str(e)
            for e in self._events("Runtime.consoleAPICalled")
            if e["type"] in ("error", "warning", "assert")
        ]
        entries = [e["entry"] for e in self._events("Log.entryAdded")]
        # that drawing without a graphics card is slow says nothing about the page
        return told + [
            entry["text"]
            for entry in entries
            if entry["level"] in ("error", "warning")
            and not any(slow in entry["text"] for slow in _SLOW)
        ]

    @property
    def requests(self):
        """Addresses asked for that are not on this machine."""
        sent = [e["request"]["url"] for e in self._events("Network.requestWillBeSent")]
        assert self._address in sent
        here = self._address[: self._address.index("/", len("https://"))]
        return [url for url in sent if not url.startswith((*_LOCAL, here))]

    def screenshot(self, path, full=False):
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=full)
        Path(path).write_bytes(base64.b64decode(shot["data"]))

    def close(self):
        self._browser.call("Target.closeTarget", targetId=self._target)
