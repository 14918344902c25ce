"""A headless browser, driven over a pipe: what a page does, asks for and looks like.

Purpose: open an address, wait for an expression, evaluate, collect requests and console errors,
take a picture. Speaks the DevTools protocol over the two pipes of `--remote-debugging-pipe`, so it
needs no package. Everything is a file or on this machine.
Non-goals: other browsers than Chromium.
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import processes

if TYPE_CHECKING:
    from collections.abc import Iterator

FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --hide-scrollbars "
    "--disable-background-networking --disable-component-update --disable-sync "
    "--disable-default-apps --disable-extensions --remote-debugging-pipe"
)
NOWHERE, HERE = "MAP * ~NOTFOUND", "MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
"""Which names are resolved: none; or none but this machine, for pages that a test serves."""


def chromium() -> str | None:
    """The browser of this machine, if there is one."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


class Page:
    """One page. `requests`: every address that was asked for; `errors`: of the console."""

    def __init__(self, read: int, write: int, process: int) -> None:
        self._read, self._write, self._process = read, write, process
        self._buffer = b""
        self._number = 0
        self._session: str | None = None
        self.requests: list[str] = []
        self.errors: list[str] = []
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self._ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self._ask(f"{domain}.enable")

    def open(self, address: str) -> None:
        """Go there; returns at once."""
        self._ask("Page.navigate", url=address)

    def size(self, width: int, height: int) -> None:
        """The window, in px."""
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def media(self, name: str) -> None:
        """As on a "screen" or in "print"."""
        self._ask("Emulation.setEmulatedMedia", media=name)

    def scheme(self, name: str) -> None:
        """Colours as somebody prefers them: "light" or "dark"."""
        features = [{"name": "prefers-color-scheme", "value": name}]
        self._ask("Emulation.setEmulatedMedia", features=features)

    def value(self, expression: str) -> Any:
        """What an expression of JavaScript gives, waiting for a promise."""
        done = self._ask(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in done:
            raise AssertionError(done["exceptionDetails"])
        return done["result"].get("value")

    def wait(self, expression: str, seconds: float = processes.TIMEOUT_S) -> float:
        """Wait until an expression is true; how long that took, in s."""
        began = time.monotonic()
        while not self.value(expression):
            if time.monotonic() - began > seconds:
                raise AssertionError(f"not within {seconds} s: {expression}")
            time.sleep(0.05)
        return time.monotonic() - began

    def cpu_s(self) -> float:
        """What the processes of the browser have computed so far, in s; others do not count."""
        ticks = 0
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == self._process:
                ticks += int(fields[11]) + int(fields[12])
        return ticks / os.sysconf("SC_CLK_TCK")

    def picture(self, path: Path, clip: dict[str, float] | None = None) -> None:
        """A PNG of all of the page, or of a part: `x`, `y`, `width`, `height`, `scale`."""
        part = {} if clip is None else {"clip": clip}
        shown = self._ask("Page.captureScreenshot", captureBeyondViewport=True, **part)
        path.write_bytes(base64.b64decode(shown["data"]))

    def _ask(self, method: str, **params: Any) -> dict[str, Any]:
        self._number += 1
        number = self._number
        message = {"id": number, "method": method, "params": params}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                result: dict[str, Any] = answer["result"]
                return result
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        method, params = event.get("method"), event.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"])

    def _next(self, seconds: float = processes.TIMEOUT_S) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], seconds)
            if not ready:
                raise AssertionError("the browser is silent")
            part = os.read(self._read, 1 << 20)
            if not part:
                raise AssertionError("the browser is gone")
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        payload: dict[str, Any] = json.loads(message)
        return payload


@contextmanager
def page(*, served: bool = False) -> Iterator[Page]:
    """A page of a browser that ends with the block; `served`: it may ask this machine."""
    browser = chromium()
    assert browser is not None
    to_read, to_write = os.pipe()
    from_read, from_write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        rules = f"--host-resolver-rules='{HERE if served else NOWHERE}'"
        profiled = f"{rules} --user-data-dir={profile}"
        line = f"exec {browser} {FLAGS} {profiled} 3<&{to_read} 4>&{from_write}"
        try:
            with processes.started(
                ["bash", "-c", line],
                pass_fds=(to_read, from_write),
                stdout=processes.DEVNULL,
                stderr=processes.DEVNULL,
            ) as started:
                yield Page(from_read, to_write, started.pid)
        finally:
            for end in (to_read, to_write, from_read, from_write):
                os.close(end)
