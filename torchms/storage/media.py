"""Pictures and meshes that nobody vouches for, through Pillow and trimesh.

What a file says about its size is checked before anything of that size is allocated, no other file is followed from it,
and whatever is wrong with it is a ValueError that names it.
"""

import json
import struct
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from torchms.extras import missing

if TYPE_CHECKING:
    import trimesh
    from PIL import Image

MOST_PIXELS = 1 << 27
"""16384 × 8192."""

MOST_TRIANGLES = 1 << 26
"""Twice what a height map of 4096 × 4096 has."""

MESHES = (".ply", ".obj", ".stl", ".off", ".glb")
"""Mesh files by their suffixes."""


def check_pixels(path: str | Path, width: int, height: int) -> None:
    """Raise ValueError for a picture that is too large."""
    if width * height > MOST_PIXELS:
        raise ValueError(
            f"{path} says that it is {width} x {height} pixels; at most {MOST_PIXELS} are read. Scale it down or crop it."
        )


def read_image(path: str | Path, formats: tuple[str, ...]) -> "Image.Image":
    """The picture, in memory, if it is of one of these `formats` (Pillow's names)."""
    try:
        from PIL import Image
    except ImportError as error:
        raise missing("a picture", "Pillow") from error
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit here is another
        try:
            with Image.open(path, formats=formats) as image:
                width, height = image.size
                if width * height <= MOST_PIXELS:
                    image.load()
        except Exception as error:  # Pillow raises a dozen kinds for as many kinds of damage
            raise _unreadable(path, "picture", error) from error
    check_pixels(path, width, height)
    return image


def read_mesh(path: str | Path, *, process: bool = False) -> "trimesh.Trimesh":
    """All triangles of the file as one mesh, without materials; `process` as trimesh means it (vertices are merged).

    ValueError also for a suffix that is not among `MESHES`, for no triangles at all and for faces without vertices.
    """
    trimesh = import_trimesh()
    suffix = Path(path).suffix.lower()
    if suffix not in MESHES:
        raise ValueError(f"the mesh {path} must end in one of {', '.join(MESHES)}. Convert it first.")
    try:
        # An open file has no neighbours: textures, materials and buffers elsewhere are not followed.
        with open(path, "rb") as file:
            if suffix == ".glb":
                _check_glb(file.read())
                file.seek(0)
            scene = trimesh.load_scene(file, file_type=suffix[1:], process=process, skip_materials=True)
        shapes = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
        triangles = sum(len(shape.faces) for shape in shapes if isinstance(shape, trimesh.Trimesh))
        if triangles > MOST_TRIANGLES:
            raise ValueError(f"it holds {triangles} triangles; at most {MOST_TRIANGLES} are read")
        mesh = scene.to_mesh()
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except Exception as error:  # trimesh's readers raise whatever they meet
        raise _unreadable(path, "mesh", error) from error
    fits = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3 and faces.size
    if not fits or not 0 <= int(faces.min()) <= int(faces.max()) < len(vertices):
        raise ValueError(f"the mesh {path} holds no triangles, or some without vertices. Export it as a triangle mesh.")
    return mesh


def import_trimesh() -> Any:
    """trimesh, or an ImportError that says how to get it."""
    try:
        import trimesh
    except ImportError as error:
        raise missing("a mesh", "trimesh") from error
    return trimesh


def _check_glb(content: bytes) -> None:
    """Raise ValueError if the arrays that a binary glTF describes are larger than itself: some need no data at all."""
    (length,) = struct.unpack_from("<I", content, 12)
    described: Any = json.loads(content[20 : 20 + length])
    for accessor in described.get("accessors", ()):
        if "bufferView" not in accessor or not 0 <= accessor["count"] <= len(content):
            raise ValueError(f"an array of {accessor['count']} elements has no data in it")
    if sum(accessor["count"] for accessor in described.get("accessors", ())) > 6 * MOST_TRIANGLES:
        raise ValueError(f"its arrays are too large together; at most {MOST_TRIANGLES} triangles are read")


def _unreadable(path: str | Path, what: str, error: Exception) -> ValueError:
    return ValueError(f"the {what} {path} cannot be read: {error or type(error).__name__}. Export it again.")
