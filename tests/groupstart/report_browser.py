"""A headless Chromium spoken to over a pipe: no driver, no port, no package. One page at a time."""

from __future__ import annotations

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
    "--hide-scrollbars", "--mute-audio", "--force-color-profile=srgb", "--remote-debugging-pipe",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
"""The last one makes sure that a page which asks for the network gets an error, and the test sees it."""
ANSWER_S = 90.0


def find_chromium() -> str | None:
    """Path of a Chromium on this computer."""
    wanted = os.environ.get("CHROMIUM")
    return wanted or next((path for name in NAMES if (path := shutil.which(name))), None)


class BrowserError(Exception):
    """The browser or the page did not do what was asked."""


class Browser:
    """Use as a context. ``faults``: console errors and exceptions of the pages opened so far."""

    def __init__(self, executable: str, width: int = 1500, height: int = 950) -> None:
        self.faults: list[str] = []
        self._profile = tempfile.mkdtemp(prefix="page-test-")
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        ours = [fcntl.fcntl(fd, fcntl.F_DUPFD, 100) for fd in (to_browser, from_browser)]
        arguments = [executable, *FLAGS, f"--window-size={width},{height}", f"--user-data-dir={self._profile}"]
        quiet = [(os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_RDWR, 0) for fd in (1, 2)]
        pipes = [(os.POSIX_SPAWN_DUP2, fd, wanted) for fd, wanted in zip(ours, (3, 4), strict=True)]
        self._pid = os.posix_spawn(executable, [*arguments, "about:blank"], os.environ, file_actions=[*quiet, *pipes])
        for fd in (to_browser, from_browser, *ours):
            os.close(fd)
        self._held, self._number = b"", 0
        target = self._call("Target.createTarget", {"url": "about:blank"})
        attached = self._call("Target.attachToTarget", {"targetId": target["targetId"], "flatten": True})
        self._session: str | None = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._call("Emulation.setDeviceMetricsOverride", metrics)

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the browser that this object started."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        os.waitpid(self._pid, 0)
        os.close(self._write)
        os.close(self._read)
        shutil.rmtree(self._profile, ignore_errors=True)

    def open(self, path: Path, ready: str = "window.__state && (window.__state.ready || window.__state.fault)") -> None:
        """Open a file and wait until ``ready`` is true in it."""
        self._call("Page.navigate", {"url": path.resolve().as_uri()})
        self.wait(ready)

    def wait(self, condition: str) -> Any:
        """Wait until a condition holds in the page; its value."""
        script = (
            "new Promise((done, fail) => { const end = performance.now() + 60000; const look = () => { let v; "
            f"try {{ v = {condition}; }} catch (e) {{ v = null; }} if (v) done(v); "
            "else if (performance.now() > end) fail(new Error('waited too long')); else setTimeout(look, 20); }; "
            "look(); })"
        )
        return self.run(script)

    def run(self, script: str) -> Any:
        """Value of an expression in the page; a promise is awaited."""
        asked = {"expression": script, "awaitPromise": True, "returnByValue": True}
        answer = self._call("Runtime.evaluate", asked)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise BrowserError(details.get("exception", {}).get("description", details["text"]))
        return answer["result"].get("value")

    def click(self, x: float, y: float) -> None:
        """A click of the left button at a place of the page."""
        for kind in ("mousePressed", "mouseReleased"):
            self._call("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1})

    def click_on(self, selector: str) -> None:
        """A click on the middle of an element, scrolled into view."""
        find = f"document.querySelector({json.dumps(selector)})"
        self.run(f"{find}.scrollIntoView({{block: 'nearest'}})")
        self.settle()  # what follows the scrolling is drawn in the next frame
        place = self.run(f"(() => {{ const b = {find}.getBoundingClientRect(); "
                         "return [b.x + b.width / 2, b.y + b.height / 2]; })()")  # fmt: skip
        self.click(*place)

    def settle(self) -> None:
        """Let the page draw two frames."""
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def picture(self, path: Path) -> bytes:
        """A screenshot as PNG, kept in ``path``."""
        data = base64.b64decode(self._call("Page.captureScreenshot", {"format": "png"})["data"])
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        return data

    def _call(self, method: str, parameters: dict[str, Any] | None = None) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters or {}}
        if getattr(self, "_session", None):
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._write, data) :]
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise BrowserError(f"{method}: {answer['error']['message']}")
                result: dict[str, Any] = answer["result"]
                return result
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        method, values = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = values["exceptionDetails"]
            self.faults.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Runtime.consoleAPICalled" and values["type"] in ("error", "assert"):
            self.faults.append(" ".join(str(a.get("value", a.get("description"))) for a in values["args"]))
        elif method == "Log.entryAdded" and values["entry"]["level"] == "error":
            self.faults.append(values["entry"]["text"] + " " + values["entry"].get("url", ""))

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._held:
            readable, _, _ = select.select([self._read], [], [], ANSWER_S)
            if not readable:
                raise BrowserError(f"no answer within {ANSWER_S:g} s")
            piece = os.read(self._read, 1 << 16)
            if not piece:
                raise BrowserError("the browser has ended")
            self._held += piece
        message, _, self._held = self._held.partition(b"\0")
        answer: dict[str, Any] = json.loads(message)
        return answer
