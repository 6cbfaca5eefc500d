"""Files that nobody vouches for: forged sizes, wrong kinds and damage are refused, before anything large is made."""

import io
import struct
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import hostile
import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from trimesh.resolvers import FilePathResolver

from torchms.microsurface import DiffuseFacets, GaussianSurfaces, Heightfield, simulate
from torchms.microsurface.rays.grid_walk import GridTracer
from torchms.render.images import exr_bytes, read_picture
from torchms.render.scenes import load_shape
from torchms.storage import media as inputs

pytestmark = pytest.mark.usefixtures("messages")
HUGE = 10**12
ZEROS = [{"componentType": 5126, "type": "VEC3", "count": HUGE}]
GAPPED = [{"componentType": 5126, "type": "VEC3", "count": 5000, "bufferView": 0}] * 10**5


def scene(path: Path) -> object:
    return load_shape(str(path))


HEIGHTS = partial(Heightfield.from_file, spacing=1.0, height_scale=1e-3)
SCENE, PICTURE = scene, read_picture


def saved(array: object) -> bytes:
    file = io.BytesIO()
    np.save(file, np.array(array), allow_pickle=True)
    return file.getvalue()


def stl(triangles: int) -> bytes:
    return bytes(80) + struct.pack("<I", triangles) + bytes(100)


def with_a_hole() -> np.ndarray:
    heights = np.zeros((5, 5))
    heights[2, 3] = np.nan
    return heights


Reader = Callable[[Path], object]
FORGED: dict[str, tuple[tuple[Reader, ...], str, bytes | Callable[[], bytes], str]] = {
    "array of 8 TB": ((HEIGHTS,), "a.npy", hostile.npy((10**6, 10**6)), "which is not its size"),
    "array of 2^83 bytes": ((HEIGHTS,), "a.npy", hostile.npy((2**40, 2**40)), "which is not its size"),
    "array of negative size": ((HEIGHTS,), "a.npy", hostile.npy((-2, -4)), "plain .npy array"),
    "array of objects": ((HEIGHTS,), "a.npy", saved([{"a": 1}]), "holds objects, which would have to be unpickled"),
    "array of text": ((HEIGHTS,), "a.npy", saved([["a"] * 5] * 5), "must be a real 2-D array"),
    "complex array": ((HEIGHTS,), "a.npy", saved(np.ones((5, 5), complex)), "must be a real 2-D array"),
    "array of three axes": ((HEIGHTS,), "a.npy", saved(np.ones((5, 5, 2))), r"got shape \(5, 5, 2\)"),
    "array with NaN": ((HEIGHTS,), "a.npy", lambda: saved(with_a_hole()), r"got nan at index \(2, 3\)"),
    "array of nothing": ((HEIGHTS,), "a.npy", hostile.npy((0, 2**40), content=b""), "at least 4 x 4"),
    "pickle": ((HEIGHTS,), "a.npy", b"\x80\x04\x95\x00\x00.", "plain .npy array"),
    "no array": ((HEIGHTS,), "a.npy", b"", "plain .npy array"),
    "PNG of 60000 x 60000": ((HEIGHTS, PICTURE), "a.png", hostile.png(60000, 60000), "cannot be read: Image size"),
    "PNG of 12000 x 12000": ((HEIGHTS, PICTURE), "a.png", hostile.png(12000, 12000), "at most 134217728 are read"),
    "TIFF of 60000 x 60000": ((HEIGHTS, PICTURE), "a.tif", hostile.tiff(60000, 60000), "cannot be read: Image size"),
    "TIFF of 12000 x 12000": ((HEIGHTS, PICTURE), "a.tif", hostile.tiff(12000, 12000), "at most 134217728 are read"),
    "PNG without pixels": ((HEIGHTS, PICTURE), "a.png", hostile.png(8, 8), "a.png cannot be read"),
    "PostScript": ((HEIGHTS, PICTURE), "a.png", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "cannot be read"),
    "EXR of 60000 x 60000": (
        (PICTURE,),
        "a.exr",
        lambda: hostile.exr(exr_bytes(torch.ones(2, 4, 3)), 60000, 60000),
        "60000 x 60000 pixels; at most",
    ),
    "PLY of 1e12 vertices": ((HEIGHTS, SCENE), "a.ply", hostile.ply(HUGE, 1, "binary_little_endian"), "cannot be read"),
    "PLY of 1e12 faces": ((HEIGHTS, SCENE), "a.ply", hostile.ply(4, HUGE, "binary_little_endian"), "cannot be read"),
    "PLY text of 1e12": ((HEIGHTS, SCENE), "a.ply", hostile.ply(HUGE, HUGE, "ascii"), "no triangles|cannot be read"),
    "STL of 4e9 triangles": ((HEIGHTS, SCENE), "a.stl", stl(2**32 - 1), "no triangles|cannot be read"),
    "OFF of 1e12": ((HEIGHTS, SCENE), "a.off", b"OFF\n1000000000000 1000000000000 0\n0 0 0\n", "cannot be read"),
    "OBJ of vertex 1e12": ((HEIGHTS, SCENE), "a.obj", b"v 0 0 0\nf 1 2 999999999999\n", "cannot be read"),
    "GLB of 1e12 zeros": ((HEIGHTS, SCENE), "a.glb", hostile.glb(ZEROS), "1000000000000 elements has no data"),
    "GLB of 1e5 arrays": ((HEIGHTS, SCENE), "a.glb", lambda: hostile.glb(GAPPED), "too large together"),
    "GLB of text": ((HEIGHTS, SCENE), "a.glb", b"glTF", "cannot be read"),
    "scene description": ((SCENE,), "a.dae", b"<COLLADA/>", "must end in one of .ply"),
}


def peak() -> int:
    """Most memory of this process since `fresh` [bytes]."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) * 1024 for line in status if line.startswith("VmHWM"))


@pytest.fixture
def fresh() -> Iterator[int]:
    """The peak starts again here."""
    Path("/proc/self/clear_refs").write_text("5")
    yield peak()


@pytest.mark.parametrize("name", FORGED)
def test_forged_files_are_refused(name: str, tmp_path: Path, fresh: int) -> None:
    """By ValueError that says why, without the memory that they ask for."""
    readers, file, content, says = FORGED[name]
    path = tmp_path / file
    path.write_bytes(content() if callable(content) else content)
    for read in readers:
        with pytest.raises(ValueError, match=says) as caught:
            read(path)
        assert len(str(caught.value)) < 1000
    assert peak() - fresh < 1 << 28


def small_files() -> dict[str, bytes]:
    """One of each kind that is read."""
    generator = np.random.default_rng(1)
    heights = 0.5 + 0.4 * np.add.outer(np.cos(np.arange(8) * np.pi / 8), np.zeros(8))
    surface = Heightfield.from_heights(np.add.outer(np.cos(np.arange(8) * np.pi / 4), np.zeros(8)), 1.0, periodic=True)
    found = {".npy": saved(heights), ".exr": exr_bytes(torch.from_numpy(generator.random((8, 16, 3))))}
    for suffix in inputs.MESHES:
        data = surface.mesh.export(file_type=suffix[1:])
        found[suffix] = data.encode() if isinstance(data, str) else bytes(data)
    for suffix, kind, pixels in (
        (".png", "PNG", (heights * 65535).astype(np.uint16)),
        (".tif", "TIFF", heights.astype(np.float32)),
    ):
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, kind)
        found[suffix] = file.getvalue()
    return found


TRUNCATIONS, FLIPS = 20, 80
CHECKED = {".npy", ".exr", ".glb", ".stl"}
"""Kinds whose length is known from their headers: cut short, they are refused."""


@pytest.mark.parametrize("suffix", [".npy", ".png", ".tif", ".exr", *inputs.MESHES])
def test_damaged_files(suffix: str, tmp_path: Path, seed: int) -> None:
    """Refused by ValueError, or read: nothing else is raised, nothing crashes."""
    good = small_files()[suffix]
    path = tmp_path / f"a{suffix}"
    readers: tuple[Reader, ...] = (HEIGHTS, SCENE) if suffix in inputs.MESHES else (HEIGHTS, PICTURE)
    readers = {".npy": (HEIGHTS,), ".exr": (PICTURE,)}.get(suffix, readers)
    refused = 0
    for i, content in enumerate([good, *hostile.damaged(good, seed, TRUNCATIONS, FLIPS)]):
        path.write_bytes(content)
        for read in readers:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    read(path)
                except ValueError as error:
                    assert i > 0, error
                    refused += 1
                else:
                    assert not 1 <= i <= TRUNCATIONS or suffix not in CHECKED, f"cut to {len(content)} bytes"
    assert refused > 0


def test_a_mesh_of_many_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small file may place one mesh many times: counted before they are put together."""
    both = trimesh.Scene()
    box = both.add_geometry(trimesh.creation.box())
    both.graph.update(
        "again", geometry=both.graph[box][1], matrix=trimesh.transformations.translation_matrix([3, 0, 0])
    )
    path = tmp_path / "two.glb"
    path.write_bytes(both.export(file_type="glb"))
    assert len(inputs.read_mesh(path).faces) == 24
    monkeypatch.setattr(inputs, "MOST_TRIANGLES", 20)
    with pytest.raises(ValueError, match="holds 24 triangles; at most 20 are read"):
        inputs.read_mesh(path)


def test_no_other_file_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Materials and textures that a mesh names stay closed."""

    def fail(self: object, name: str) -> bytes:
        raise AssertionError(f"{name} was opened")

    monkeypatch.setattr(FilePathResolver, "get", fail)
    (tmp_path / "secret.mtl").write_text("newmtl a\nKd 1 0 0\nmap_Kd secret.png\n")
    path = tmp_path / "a.obj"
    path.write_text("mtllib secret.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(inputs.read_mesh(path).faces) == 1


def test_a_mesh_along_a_diagonal(fresh: int) -> None:
    """n vertices can name n x n points of a grid: said before an array of that size is made."""
    n = 30_000
    vertices = np.stack([np.arange(n), np.random.default_rng(1).permutation(n), np.zeros(n)], -1)
    faces = np.arange(n).reshape(-1, 3)
    (x, y), (u, v) = ((vertices[faces[:, k], :2] - vertices[faces[:, 0], :2]).T for k in (1, 2))
    turned = x * v < y * u
    faces[turned] = faces[turned][:, ::-1]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    with pytest.raises(ValueError, match=r"a vertex at each point of its grid; it has 30000 for 30000 x 30000"):
        Heightfield.from_mesh(mesh)
    assert peak() - fresh < 1 << 28


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"[]", r"no configuration \(it holds \[\]\)"),
        (b"null", "it holds None"),
        (b"NaN", "it holds nan"),
        (b"1e999", "it holds inf"),
        (b'"' + b"x" * 10_000 + b'"', "it holds x+ \\.\\.\\."),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"seed": NaN}', "seed = nan where this run has 1"),
        (b'{"seed": ' + b"9" * 5000 + b"}", "no configuration"),
        (b'{"seed": "' + b"x" * 10_000 + b'"}', "seed = x+ \\.\\.\\. where this run has 1"),
        (b"{" + b",".join(b'"%d": 1' % i for i in range(10_000)) + b"}", "0 = 1 where this run has nothing"),
        (b"\xff\xfe\x00", "no configuration"),
        (b" " * (1 << 24) + b"{}", "16777218 bytes, 16777216 are expected at most"),
    ],
    ids=range(12),
)
def test_forged_configurations(content: bytes, says: str, tmp_path: Path) -> None:
    """A checkpoint's configuration may hold anything: refused in a message of bounded length."""
    (tmp_path / "configuration.json").write_bytes(content)
    surface, arguments = GaussianSurfaces(0.8, count=1, size=128), dict(n_rays=10, seed=1, tracer=GridTracer())
    with pytest.raises(ValueError, match=says) as caught:
        simulate(surface, DiffuseFacets(0.9), (0.6, 0.0, 0.8), checkpoint=tmp_path, **arguments)
    assert "configuration" in str(caught.value) and len(str(caught.value)) < 12_000
