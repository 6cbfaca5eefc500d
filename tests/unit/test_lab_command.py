"""`torchms lab`: it serves a built folder on loopback, and says what to do where there is none."""

import threading
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path

import pytest

from torchms.cli import lab, main
from torchms.cli.lab import server
from torchms.cli.plain_options import LabOptions


@pytest.fixture
def built(tmp_path: Path) -> Path:
    """A folder that looks like a built lab, beside a file that is none of its business."""
    folder = tmp_path / "lab"
    (folder / "models").mkdir(parents=True)
    (folder / "index.html").write_text("<!doctype html>lab")
    (folder / "models" / "models.json").write_text("{}")
    (folder / "engine.wasm").write_bytes(b"\0asm")
    (folder / "main.js").write_text("1")
    (tmp_path / "secret.txt").write_text("secret")
    return folder


@pytest.fixture
def connection(built: Path) -> Iterator[HTTPConnection]:
    with server(built, 0) as running:
        threading.Thread(target=running.serve_forever, daemon=True).start()
        yield HTTPConnection(*running.server_address[:2], timeout=10)
        running.shutdown()


def get(connection: HTTPConnection, path: str) -> tuple[int, str, bytes]:
    connection.request("GET", path)
    answer = connection.getresponse()
    return answer.status, answer.headers.get_content_type(), answer.read()


def test_it_serves_the_folder(connection: HTTPConnection) -> None:
    assert get(connection, "/") == (200, "text/html", b"<!doctype html>lab")
    assert get(connection, "/engine.wasm")[:2] == (200, "application/wasm")
    assert get(connection, "/main.js")[:2] == (200, "text/javascript")
    assert get(connection, "/models/models.json")[0] == 200
    assert connection.host == "127.0.0.1"


@pytest.mark.parametrize("path", ["/../secret.txt", "/%2e%2e/secret.txt", "/models/", "/none.js"])
def test_and_nothing_else(connection: HTTPConnection, path: str) -> None:
    status, _, body = get(connection, path)
    assert status == 404 and b"secret" not in body


@pytest.mark.parametrize(("gone", "says"), [("index.html", "make lab"), ("models/models.json", "no evaluators")])
def test_what_is_not_built(built: Path, gone: str, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    (built / gone).unlink()
    assert main(["lab", "--folder", str(built), "--no-browser"]) == 2
    error = capsys.readouterr().err
    assert says in error and str(built) in error and gone in error


def test_ports(built: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "--folder", str(built), "--port", "70000"]) == 2
    assert "--port must be in [0, 65535]; got 70000" in capsys.readouterr().err
    with server(built, 0) as running:
        taken = running.server_address[1]
        assert main(["lab", "--folder", str(built), "--port", str(taken)]) == 2
    assert f"--port {taken} cannot be taken" in capsys.readouterr().err


def test_the_browser_is_sent_there(
    built: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Once the server stands; Ctrl-C ends it without an error."""
    opened: list[str] = []

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(lab.webbrowser, "open", opened.append)
    monkeypatch.setattr(lab.ThreadingHTTPServer, "serve_forever", interrupt)
    lab.run_lab(LabOptions(folder=built))
    out = capsys.readouterr().out
    assert len(opened) == 1 and opened[0] in out and "has ended" in out
    lab.run_lab(LabOptions(folder=built, browser=False))
    assert len(opened) == 1
