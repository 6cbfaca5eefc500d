"""Where machine code is kept: never loaded from a folder that others may write."""

import os

import pytest

from torchms.machine import build


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("TORCHINDUCTOR_CACHE_DIR", str(tmp_path))
    return tmp_path / "torchms"


def test_it_is_made_for_this_user_alone(cache):
    assert build.folder() == cache
    assert cache.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="permissions of this kind are POSIX's")
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_may_write_is_not_used(cache, mode):
    cache.mkdir()
    cache.chmod(mode)
    place = build.folder()
    assert place != cache and build.is_private(place)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="permissions of this kind are POSIX's")
def test_a_folder_of_somebody_else_is_not_used(cache, monkeypatch):
    cache.mkdir(mode=0o700)
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    assert not build.is_private(cache)
