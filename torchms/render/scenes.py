"""Scenes by name, or from a mesh file: a shape and a camera that shows it."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from torchms.render.camera import Camera, Point
from torchms.render.mesh import Mesh
from torchms.render.shapes import Shape, Sphere
from torchms.storage.media import read_mesh

if TYPE_CHECKING:
    import trimesh

BUILT_IN = ("slab", "sphere", "plane")

SLAB = (0.7, 1.4, 0.04)
"""Edges of the Single Slab of [Wang2022, Fig. 17]; it is turned by 110° about x, then by 45° about y."""


def load_shape(scene: str, crease: float = 30.0) -> tuple[Shape, Camera]:
    """The shape called `scene`, or in that file, and the camera it is looked at with.

    crease: edges of a file's mesh that bend by less [degrees] are shaded smoothly; 0 keeps all faces flat. A closed
    mesh is turned so that its normals point outwards. Raises ValueError for a file that holds no triangles or a name
    that is neither, and ImportError without trimesh.
    """
    if scene == "sphere":
        return Sphere(), Camera((0.0, 0.0, 3.0))
    if scene == "slab":
        return slab(), Camera((1.5, 1.5, 1.5))
    if scene == "plane":
        return plane(), Camera((0.0, 1.5, 2.0))
    return _from_file(scene, crease)


def slab(size: Point = SLAB, about_x: float = 110.0, about_y: float = 45.0) -> Mesh:
    """A box of this `size`, turned about x and then about y [degrees]; α_x lies along its own x axis (or y)."""
    x, y = math.radians(about_x), math.radians(about_y)
    turn_x = np.array([[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]])
    turn_y = np.array([[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]])
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * (np.asarray(size) / 2)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    along = np.eye(3)[[1, 1, 0, 0, 0, 0]]
    turn = turn_y @ turn_x
    return Mesh(corners @ turn.T, _triangles(quads), tangents=np.repeat(along @ turn.T, 2, axis=0), is_closed=True)


def plane() -> Mesh:
    """The square [−1, 1]² in y = 0, facing up; α_x lies along x."""
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], dtype=np.float64)
    return Mesh(corners, _triangles([(0, 1, 2, 3)]), tangents=np.tile([1.0, 0.0, 0.0], (2, 1)))


def _triangles(quads: list[tuple[int, int, int, int]]) -> np.ndarray:
    return np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def _from_file(scene: str, crease: float) -> tuple[Shape, Camera]:
    path = Path(scene)
    if not path.is_file():
        raise ValueError(f"the scene {scene!r} is neither a file nor one of {', '.join(BUILT_IN)}.")
    mesh = read_mesh(path, process=True)
    if not np.isfinite(mesh.vertices).all():
        raise ValueError(f"the scene {path} has vertices that are not finite. Repair the mesh first.")
    return _shaded(mesh, crease), _overview(mesh)


def _shaded(mesh: "trimesh.Trimesh", crease: float) -> Mesh:
    tangents = uv_tangents(mesh)
    # Corners that were split for their texture coordinates are one place.
    places, merged = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = merged.reshape(-1)[mesh.faces]
    edges = places[faces[:, 1:]] - places[faces[:, :1]]
    area = np.cross(edges[:, 0], edges[:, 1])
    good = np.linalg.norm(area, axis=1) > 0
    faces, area, tangents = faces[good], area[good], None if tangents is None else tangents[good]
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    # Closed: every edge joins two faces.
    is_closed = bool((np.unique(ends, axis=0, return_counts=True)[1] == 2).all())
    if is_closed and np.einsum("ij,ij->", places[faces[:, 0]] - places.mean(0), area) < 0:
        faces, area = faces[:, ::-1], -area
    corners = None if crease <= 0 else corner_normals(faces, area, crease)
    return Mesh(places, faces, corners, tangents, is_closed)


def corner_normals(faces: np.ndarray, area: np.ndarray, crease: float) -> np.ndarray:
    """(F, 3, 3): at each corner the mean normal, by area, of the faces there that bend by less than `crease` degrees.

    area: (F, 3) normals of the length of twice the face's area.
    """
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    corner_vertex = faces.reshape(-1)
    corner_face = np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(corner_vertex, kind="stable")
    at = np.concatenate([[0], np.cumsum(np.bincount(corner_vertex))])
    start, degree = at[corner_vertex], np.diff(at)[corner_vertex]
    total = np.zeros((len(corner_vertex), 3))
    least = math.cos(math.radians(crease))
    for i in range(int(degree.max())):
        # The i-th face about the vertex, for all corners at once.
        here = np.flatnonzero(degree > i)
        face = corner_face[order[start[here] + i]]
        near = np.einsum("ij,ij->i", unit[face], unit[corner_face[here]]) > least
        total[here[near]] += area[face[near]]
    return (total / np.linalg.norm(total, axis=1, keepdims=True)).reshape(-1, 3, 3)


def uv_tangents(mesh: "trimesh.Trimesh") -> np.ndarray | None:
    """(F, 3) the direction in which the texture coordinate u grows on each face; None if there are no coordinates."""
    uv = getattr(mesh.visual, "uv", None)
    if uv is None or len(uv) != len(mesh.vertices):
        return None
    p, t = mesh.vertices[mesh.faces], np.asarray(uv)[mesh.faces]
    e1, e2, t1, t2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0], t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
    # ∂p/∂u = (e1 t2_v − e2 t1_v) / (t1_u t2_v − t2_u t1_v), up to its length.
    sign = np.sign(t1[:, 0] * t2[:, 1] - t2[:, 0] * t1[:, 1])
    return np.asarray((e1 * t2[:, 1:] - e2 * t1[:, 1:]) * sign[:, None])


def _overview(mesh: "trimesh.Trimesh") -> Camera:
    low, high = mesh.bounds
    centre, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    # Far enough for the ball around the mesh at a field of view of 45°.
    towards = np.array([0.5, 0.4, 0.77])
    eye = centre + towards / np.linalg.norm(towards) * radius * 1.05 / math.sin(math.radians(22.5))
    return Camera(_point(eye), _point(centre))


def _point(x: np.ndarray) -> Point:
    return float(x[0]), float(x[1]), float(x[2])
