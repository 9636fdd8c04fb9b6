"""Chromium without a window, spoken to through a pair of pipes: opens a page of ours, runs script in it, listens."""

import json
import os
import shutil
import subprocess
import sys
from base64 import b64decode
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

__all__ = ["CHROMIUM", "Page", "opened"]

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe",
)


# the browser reads commands from file 3 and answers on file 4
LAUNCH = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(number), fcntl.F_DUPFD, 10) for number in sys.argv[1:3]]
for end, place in zip(ends, (3, 4)):
    os.dup2(end, place)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Page:
    """One page: what it fetched, what it complained of, and answers to script."""

    def __init__(self, commands, answers):
        self._commands, self._answers = commands, answers
        self._session, self._number, self._left = None, 0, b""
        self.fetched, self.complaints = [], []

    def open(self, path, *, width=1280, height=800):
        """Load a file and wait until its view has been drawn, where it has one."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=Path(path).resolve().as_uri())
        self.run(
            "new Promise(done => { const look = () => { const view = document.getElementById('view');"
            " document.readyState === 'complete' && (!view || Number(view.dataset.drawn) > 1)"
            " ? done(true) : setTimeout(look, 50); }; look(); })"
        )

    def run(self, script):
        """Value of an expression; a promise is waited for."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def screenshot(self, path, **clip):
        Path(path).write_bytes(b64decode(self.call("Page.captureScreenshot", format="png", **clip)["data"]))

    def call(self, method, **parameters):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        self._commands.write(json.dumps(message).encode() + b"\0")
        self._commands.flush()
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self._hear(answer)

    def _next(self):
        while b"\0" not in self._left:
            more = os.read(self._answers, 1 << 16)
            assert more, "the browser is gone"
            self._left += more
        line, _, self._left = self._left.partition(b"\0")
        return json.loads(line)

    def _hear(self, event):
        method, told = event.get("method"), event.get("params", {})
        if method == "Network.requestWillBeSent":
            self.fetched.append(told["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(str(told["exceptionDetails"].get("exception", told)))
        elif method == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.complaints.append(str([entry.get("value") for entry in told["args"]]))
        elif method == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.complaints.append(told["entry"]["text"])


@contextmanager
def opened(path, **size):
    """The page of a file, in a browser of its own that ends with the block."""
    ours, theirs = os.pipe(), os.pipe()
    with TemporaryDirectory() as profile:
        ends = str(ours[0]), str(theirs[1])
        words = [sys.executable, "-c", LAUNCH, *ends, CHROMIUM, *FLAGS, f"--user-data-dir={profile}"]
        process = subprocess.Popen(
            words, pass_fds=(ours[0], theirs[1]), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(ours[0])
        os.close(theirs[1])
        try:
            with os.fdopen(ours[1], "wb") as commands:
                page = Page(commands, theirs[0])
                page.open(path, **size)
                yield page
        finally:
            process.terminate()
            process.wait(20)
            os.close(theirs[0])
