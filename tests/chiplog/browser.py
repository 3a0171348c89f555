"""A real browser without a window: opens a page offline, and says what it did and complained of.

It is driven by Chromium's own protocol, JSON messages that end in a zero byte, over two pipes: its
file descriptors 3 and 4 (https://chromedevtools.github.io/devtools-protocol/). No driver between.
"""

from __future__ import annotations

import fcntl
import json
import os
import select
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

NAMES: Final = ("chromium-headless-shell", "chromium", "google-chrome")
"""What scripts/setup.sh looks for; it installs the first."""
_OPTIONS: Final = (
    *("--headless", "--hide-scrollbars", "--disable-gpu", "--no-first-run"),
    "--no-sandbox",  # root has none; it only opens pages of our own
    "--disable-dev-shm-usage",  # containers share little memory
    "--host-resolver-rules=MAP * ~NOTFOUND",  # there is no network
    *("--disable-background-networking", "--disable-component-update"),
    "--remote-debugging-pipe",
)
_HANG_S: Final = 300
"""Ends a browser that hangs; no test waits for it otherwise."""
_FRAMES: Final = 5
"""Until all is drawn: one in which sizes are seen, one in which charts are, and some to spare."""


def find_browser() -> str | None:
    """Return the path of the first browser found that speaks the protocol, or None."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


@contextmanager
def running(program: str) -> Iterator[Browser]:
    """Start *program* with nothing open and nothing remembered; it ends with the block."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(program, profile)
        try:
            yield browser
        finally:
            browser.close()


class Browser:
    """The process, and the messages to and from it."""

    def __init__(self, program: str, profile: str) -> None:
        """Start *program*, which keeps what it must in the folder *profile*."""
        to_read, self._out = _pipe()
        self._in, to_write = _pipe()
        null = os.open(os.devnull, os.O_RDWR)
        self._process = os.posix_spawn(
            program,
            [program, *_OPTIONS, f"--user-data-dir={profile}"],
            os.environ,
            file_actions=[
                (os.POSIX_SPAWN_DUP2, null, 1),
                (os.POSIX_SPAWN_DUP2, null, 2),
                (os.POSIX_SPAWN_DUP2, to_read, 3),
                (os.POSIX_SPAWN_DUP2, to_write, 4),
            ],
        )
        for descriptor in (to_read, to_write, null):
            os.close(descriptor)
        self._numbers = count(1)
        self._read = b""
        self.events: list[dict[str, Any]] = []

    def ask(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Return the answer to *method*; what happens until then joins `events`."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            heard = self.hear()
            if heard.get("id") == number:
                assert "error" not in heard, f"{method}: {heard['error']}"
                answer: dict[str, Any] = heard["result"]
                return answer
            self.events.append(heard)

    def hear(self) -> dict[str, Any]:
        """Return the next message, whenever it comes."""
        while b"\0" not in self._read:
            ready, _, _ = select.select([self._in], [], [], _HANG_S)
            assert ready, f"the browser said nothing for {_HANG_S} s"
            more = os.read(self._in, 1 << 20)
            assert more, "the browser ended"
            self._read += more
        first, _, self._read = self._read.partition(b"\0")
        message: dict[str, Any] = json.loads(first)
        return message

    def close(self) -> None:
        """End the process."""
        # A pipe that is closed ends the browser.
        os.close(self._out)
        os.close(self._in)
        os.waitpid(self._process, 0)

    def open(self, page: Path, width: int = 1000) -> Tab:
        """Return *page* in a tab *width* pixels wide, once it is loaded and drawn."""
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        tab = Tab(self, session, page)
        for domain in ("Page", "Runtime", "Log", "Network"):
            tab.ask(f"{domain}.enable")
        tab.ask(
            "Emulation.setDeviceMetricsOverride",
            **{"width": width, "height": 4000, "deviceScaleFactor": 1, "mobile": False},
        )
        tab.ask("Page.navigate", url=page.as_uri())
        while not tab.heard("Page.loadEventFired"):
            self.events.append(self.hear())
        tab.settle()
        return tab


class Tab:
    """One open page."""

    def __init__(self, browser: Browser, session: str, page: Path) -> None:
        """Speak to *browser* about *page*, by the name *session*."""
        self._browser = browser
        self._session = session
        self.page = page

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the answer to *method*."""
        return self._browser.ask(method, self._session, **parameters)

    def heard(self, event: str) -> list[dict[str, Any]]:
        """Return what each *event* said."""
        return [
            one["params"]
            for one in self._browser.events
            if one.get("sessionId") == self._session and one["method"] == event
        ]

    def run(self, script: str) -> Any:
        """Return the value of an expression in JavaScript, awaited."""
        answer = self.ask(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait until everything is drawn."""
        self.run(
            f"(async () => {{ for (let i = 0; i < {_FRAMES}; i++)"
            " await new Promise(requestAnimationFrame); })()"
        )

    def texts(self, selector: str) -> list[str]:
        """Return the text of each element that *selector* finds."""
        found: list[str] = self.run(
            f"[...document.querySelectorAll({json.dumps(selector)})].map((e) => e.textContent)"
        )
        return found

    def count(self, selector: str) -> int:
        """Return how many elements *selector* finds."""
        return len(self.texts(selector))

    def mouse(self, kind: str, selector: str, across: float, **more: Any) -> None:
        """Move, press or release the mouse over an element, *across* (0 to 1) its width."""
        box = self.run(
            f"(({{x, y, width, height}}) => [x, y, width, height])"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        where = {"x": box[0] + across * box[2], "y": box[1] + box[3] / 2}
        self.ask("Input.dispatchMouseEvent", type=kind, **where, **more)

    def click(self, selector: str, times: int = 1) -> None:
        """Click in the middle of an element."""
        for number in range(1, times + 1):
            more = {"button": "left", "buttons": 1, "clickCount": number}
            self.mouse("mousePressed", selector, 0.5, **more)
            self.mouse("mouseReleased", selector, 0.5, **more)
        self.settle()

    def drag(self, selector: str, start: float, stop: float) -> None:
        """Drag over an element, from *start* to *stop* (0 to 1) of its width."""
        held = {"button": "left", "buttons": 1, "clickCount": 1}
        self.mouse("mousePressed", selector, start, **held)
        self.mouse("mouseMoved", selector, (start + stop) / 2, **held)
        self.mouse("mouseMoved", selector, stop, **held)
        self.mouse("mouseReleased", selector, stop, **held)
        self.settle()

    @property
    def complaints(self) -> list[str]:
        """Return every error and warning: of scripts, of the console, of the page's own policy."""
        return [
            *(one["entry"]["text"] for one in self.heard("Log.entryAdded")),
            *(str(one["exceptionDetails"]) for one in self.heard("Runtime.exceptionThrown")),
            *(str(one["args"]) for one in self.heard("Runtime.consoleAPICalled")),
        ]

    @property
    def asked_for(self) -> set[str]:
        """Return the address of everything that was asked for."""
        return {one["request"]["url"] for one in self.heard("Network.requestWillBeSent")}


def _pipe() -> tuple[int, int]:
    """Return a pipe whose ends are none of the numbers that the browser's get."""
    ends = os.pipe()
    moved = tuple(fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in ends)
    for end in ends:
        os.close(end)
    return moved[0], moved[1]
