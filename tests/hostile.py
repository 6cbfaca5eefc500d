"""Files as somebody might damage or forge them."""

import json
import random
import struct
import zlib
from collections.abc import Iterator

TRUNCATIONS, FLIPS = 60, 240


def damaged(content: bytes, seed: int, truncations: int = TRUNCATIONS, flips: int = FLIPS) -> Iterator[bytes]:
    """Cut anywhere, and with one bit or a run of bytes changed anywhere; half of the changes where the headers are."""
    rng = random.Random(seed)
    for _ in range(truncations):
        yield content[: rng.randrange(len(content))]
    for i in range(flips):
        anywhere = rng.randrange(len(content))
        header = rng.choice([rng.randrange(400), len(content) - 1 - rng.randrange(400)])
        changed = bytearray(content)
        where = (anywhere if i % 2 else header) % len(content)
        changed[where] ^= 1 << rng.randrange(8)
        if i % 5 == 0:
            changed[where : where + 8] = rng.randbytes(len(changed[where : where + 8]))
        yield bytes(changed)


def npy(shape: tuple[int, ...], kind: str = "<f8", content: bytes = bytes(64)) -> bytes:
    """An array file that promises this shape."""
    header = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + content


def png(width: int, height: int, content: bytes = b"") -> bytes:
    """A picture of 16 bits that promises this size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    parts = (b"IHDR", header), (b"IDAT", zlib.compress(content)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def tiff(width: int, height: int) -> bytes:
    """A float picture that promises this size."""
    tags = {256: width, 257: height, 258: 32, 259: 1, 262: 1, 273: 8, 277: 1, 278: height, 279: 64, 339: 3}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    return b"II*\x00" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4 + 64)


def ply(vertices: int, faces: int, kind: str) -> bytes:
    """A mesh that promises so many vertices and faces."""
    return (
        f"ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode() + bytes(64)


def glb(accessors: list[dict], **more: object) -> bytes:
    """A binary glTF of one triangle mesh, with these arrays."""
    described = {
        "asset": {"version": "2.0"},
        "accessors": accessors,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    text = json.dumps(described | more).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", 64) + b"BIN\x00" + bytes(64)
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def exr(content: bytes, width: int, height: int) -> bytes:
    """The .exr file with another data window."""
    key = b"dataWindow\x00box2i\x00" + struct.pack("<I", 16)
    where = content.index(key) + len(key)
    return content[:where] + struct.pack("<iiii", 0, 0, width - 1, height - 1) + content[where + 16 :]
