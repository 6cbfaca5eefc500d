"""`torchms lab`: serve the built lobe lab on loopback, and open a browser on it."""

import webbrowser
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from torchms.cli.plain_options import LabOptions

BUILT = Path(__file__).parents[2] / "build" / "lab"
"""Where `make lab` puts it in a checkout."""

LOOPBACK = "127.0.0.1"


class Handler(SimpleHTTPRequestHandler):
    """Files of one folder, with the types that a browser asks for; nothing is kept by it, and nothing is logged."""

    extensions_map = SimpleHTTPRequestHandler.extensions_map | {
        ".js": "text/javascript",
        ".mjs": "text/javascript",
        ".wasm": "application/wasm",
        ".onnx": "application/octet-stream",
    }

    def end_headers(self) -> None:
        # A lab that was built anew is seen at the next reload.
        self.send_header("Cache-Control", "no-cache")
        super().end_headers()

    def list_directory(self, path: Any) -> None:
        self.send_error(404, "There is no such file")

    def log_message(self, format: str, *args: Any) -> None:
        pass


def server(folder: Path, port: int) -> ThreadingHTTPServer:
    """A server of `folder` on 127.0.0.1; port 0 is any that is free. ValueError if no lab is built there."""
    for name, remedy in (
        ("index.html", "Build it with `make lab` (needs Node 20 and npm)."),
        ("models/models.json", "It has no evaluators: build it with `make lab`, which exports them."),
    ):
        if not (folder / name).is_file():
            raise ValueError(f"torchms lab: there is no lobe lab in {folder}, {name} is missing. {remedy}")
    if not 0 <= port <= 65535:
        raise ValueError(f"--port must be in [0, 65535]; got {port}. 0 takes any that is free.")
    try:
        return ThreadingHTTPServer((LOOPBACK, port), partial(Handler, directory=str(folder)))
    except OSError as error:
        raise ValueError(
            f"--port {port} cannot be taken: {error.strerror}. Leave it out to take a free one."
        ) from error


def run_lab(options: LabOptions) -> None:
    """Serve until Ctrl-C. Raises ValueError if the lab is not built or the port is taken."""
    with server(options.folder or BUILT, options.port) as running:
        address = f"http://{LOOPBACK}:{running.server_address[1]}/"
        print(f"The lobe lab: {address} (Ctrl-C ends it)", flush=True)
        if options.browser:
            webbrowser.open(address)
        try:
            running.serve_forever()
        except KeyboardInterrupt:
            print("The lobe lab has ended.")
