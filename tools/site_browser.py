"""Looks at a built site in headless Chromium: one page that loads all others in a frame, and reports what it saw."""

import json
import os
import queue
import shutil
import subprocess
import tempfile
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

LONGEST = 900.0
"""Seconds that a look at the whole site may take."""

DRIVER = (Path(__file__).parent / "site_browser.html").read_text()

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--window-size=1400,1000",
)


def find_chromium() -> str | None:
    """That of $CHROMIUM, or the first there is."""
    names = (os.environ.get("CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((path for name in names if name and (path := shutil.which(name))), None)


class Handler(SimpleHTTPRequestHandler):
    """Serves the site and the driver; remembers what was asked for in vain, and takes the report."""

    missing: list[str]
    reports: "queue.Queue[dict[str, Any]]"
    plan: dict[str, Any]

    def do_GET(self) -> None:
        if self.path == "/__check__.html":
            self._answer(DRIVER.replace("__PLAN__", json.dumps(self.plan)).encode(), "text/html; charset=utf-8")
        elif self.path == "/favicon.ico":
            self._answer(b"", "image/x-icon")
        else:
            super().do_GET()

    def do_POST(self) -> None:
        self.reports.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self._answer(b"", "text/plain")

    def _answer(self, content: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        self.missing.append(f"{self.path}: {code}, asked for by {self.headers.get('Referer', 'the browser')}")
        super().send_error(code, message, explain)

    def log_message(self, format: str, *args: Any) -> None:
        pass


def browse(folder: Path, pages: list[str], searches: dict[str, str], chromium: str) -> list[str]:
    """What is wrong with `pages` of the site in `folder`, and with its search: words and the page each must find."""
    handler = type("Checked", (Handler,), {"missing": [], "reports": queue.Queue()})
    handler.plan = {"pages": pages, "searches": searches}
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_address[1]}/__check__.html"
    with tempfile.TemporaryDirectory(prefix="torchms-site-", ignore_cleanup_errors=True) as profile:
        command = [chromium, *FLAGS, f"--user-data-dir={profile}", "--remote-debugging-port=0", address]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            seen = handler.reports.get(timeout=LONGEST)
        except queue.Empty:
            return [f"{chromium} did not look through {len(pages)} pages in {LONGEST:.0f} s"]
        finally:
            browser.terminate()
            browser.wait(30)
            server.shutdown()
    return [*handler.missing, *seen["faults"]]
