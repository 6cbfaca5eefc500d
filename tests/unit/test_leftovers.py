"""Temporary files of writers that were killed: they do not pile up, and nobody else's is touched."""

import glob
import os
import subprocess
import sys
import time
from typing import IO

import pytest

from torchms.storage import write as files
from torchms.storage.write import remove_leftovers, write_whole


def test_what_a_kill_left_goes(tmp_path):
    """A file that a killed writer left half written is removed by the next one; that of a living one is not."""
    path, other = tmp_path / "a.bin", tmp_path / ".mine.part"
    other.write_bytes(b"mine")
    slow = (
        "import os, sys, time; from torchms.storage.write import write_whole; os.fsync = lambda file: time.sleep({})\n"
    )
    slow += "write_whole(sys.argv[1], bytes(1000))"

    def parts() -> list[str]:
        return glob.glob(str(tmp_path / ".a.bin.*.part"))

    def half_written(seconds: float) -> subprocess.Popen[bytes]:
        before = set(parts())
        process = subprocess.Popen([sys.executable, "-c", slow.format(seconds), str(path)])
        until = time.monotonic() + 60
        while not any(os.path.getsize(part) for part in set(parts()) - before):
            assert time.monotonic() < until and process.poll() is None
            time.sleep(0.01)
        return process

    for kills in range(3):
        dead = half_written(600.0)
        assert remove_leftovers(tmp_path, "*") == 0 and len(parts()) == 1, kills
        dead.kill()
        dead.wait()
    assert remove_leftovers(tmp_path, "b*") == 0 and remove_leftovers(tmp_path, "a*") == 1
    living = half_written(3.0)
    write_whole(path, b"new", force=True)
    assert path.read_bytes() == b"new" and len(parts()) == 1
    assert living.wait() == 0 and path.read_bytes() == bytes(1000)
    assert sorted(p.name for p in tmp_path.iterdir()) == [".mine.part", "a.bin"]


def test_a_file_taken_for_a_leftover_is_written_again(tmp_path, monkeypatch):
    """Between making its temporary file and locking it, a writer may lose it to another."""
    lock, taken = files._locked, []

    def late(file: IO[bytes], wait: bool) -> bool:
        if wait and len(taken) < 2:
            taken.append(remove_leftovers(tmp_path, "a.bin"))
        return lock(file, wait)

    monkeypatch.setattr(files, "_locked", late)
    write_whole(tmp_path / "a.bin", b"content")
    assert taken == [1, 1] and [p.name for p in tmp_path.iterdir()] == ["a.bin"]


def test_two_writers_who_drew_one_name(tmp_path, monkeypatch):
    """The temporary file that is there stays as it is; the second writer takes another name."""
    names = iter(["00000000", "00000000", "11111111"])
    monkeypatch.setattr(files.secrets, "token_hex", lambda n: next(names))
    first = tmp_path / ".a.bin.00000000.part"
    first.write_bytes(b"first")
    write_whole(tmp_path / "a.bin", b"content", sweep=False)
    assert (tmp_path / "a.bin").read_bytes() == b"content" and first.read_bytes() == b"first"


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_permissions_are_those_of_any_new_file(umask, tmp_path):
    before = os.umask(umask)
    try:
        write_whole(tmp_path / "a.bin", b"content")
    finally:
        os.umask(before)
    assert (tmp_path / "a.bin").stat().st_mode & 0o777 == 0o666 & ~umask


def test_without_locks(tmp_path, monkeypatch):
    """Where the system has none, files are written as well, and nothing is removed."""
    monkeypatch.setattr("torchms.storage.write.fcntl", None)
    left = tmp_path / ".a.bin.abcd1234.part"
    left.write_bytes(b"")
    write_whole(tmp_path / "a.bin", b"content")
    assert (tmp_path / "a.bin").read_bytes() == b"content" and left.exists()
