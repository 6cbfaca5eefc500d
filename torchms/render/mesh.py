"""Triangle meshes, by Embree."""

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchms.extras import missing
from torchms.render.shapes import Hits, Shape


class Mesh(Shape):
    """Triangles, outwards by the right-hand rule.

    vertices: (V, 3). faces: (F, 3). corners: (F, 3, 3) shading normal of each corner, None for flat faces.
    tangents: (F, 3), None if there are none. Raises ImportError, with the remedy, without embreex.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        corners: np.ndarray | None = None,
        tangents: np.ndarray | None = None,
        is_closed: bool = False,
    ) -> None:
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            why = missing("a mesh in torchms.render", "embreex", "render")
            raise ImportError(f"{why} Without it, the scene 'sphere' still works.") from error
        self.is_closed = is_closed
        low, high = vertices.min(0), vertices.max(0)
        x, y, z = (low + high) / 2
        self.centre = (float(x), float(y), float(z))
        self.radius = float(np.linalg.norm(high - low) / 2)
        # Embree computes in float32: centred and scaled, positions keep all of its digits.
        scaled = (vertices - np.asarray(self.centre)) / self.radius
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(scaled, np.float32), np.ascontiguousarray(faces, np.int32))
        triangles = torch.from_numpy(np.ascontiguousarray(vertices[faces], np.float64))
        self._origin = triangles[:, 0]
        self._edges = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        self._geometric = normalize(torch.linalg.cross(*self._edges), dim=-1)
        self._corners = None if corners is None else torch.from_numpy(np.ascontiguousarray(corners, np.float64))
        self._tangents = None if tangents is None else torch.from_numpy(np.ascontiguousarray(tangents, np.float64))

    def _first(self, origin: Tensor, direction: Tensor, query: str) -> np.ndarray:
        """Number of a triangle that each ray meets (the first, or any), −1 for none."""
        moved = (origin.numpy() - np.asarray(self.centre)) / self.radius
        return self._scene.run(
            np.ascontiguousarray(moved, np.float32), np.ascontiguousarray(direction.numpy(), np.float32), query=query
        )

    def intersect(self, origin: Tensor, direction: Tensor) -> Hits:
        face = torch.from_numpy(self._first(origin, direction, "INTERSECT").astype(np.int64))
        found = face >= 0
        face = face.clamp_min(0)
        a, e1, e2, n = self._origin[face], self._edges[0][face], self._edges[1][face], self._geometric[face]
        slope = (direction * n).sum(-1)
        t = ((a - origin) * n).sum(-1) / torch.where(slope == 0, 1.0, slope)
        point = origin + t[:, None] * direction
        tangent = torch.zeros_like(n) if self._tangents is None else self._tangents[face]
        if self._corners is None:
            return Hits(found, point, n, n, tangent)
        # Barycentric coordinates from the two edges' dot products.
        p = point - a
        d11, d12, d22 = (e1 * e1).sum(-1), (e1 * e2).sum(-1), (e2 * e2).sum(-1)
        p1, p2 = (p * e1).sum(-1), (p * e2).sum(-1)
        area = (d11 * d22 - d12 * d12).clamp_min(1e-300)
        u, v = ((d22 * p1 - d12 * p2) / area).clamp(0, 1), ((d11 * p2 - d12 * p1) / area).clamp(0, 1)
        corners = self._corners[face]
        weights = torch.stack([(1 - u - v).clamp_min(0), u, v], -1)[..., None]
        return Hits(found, point, n, normalize((weights * corners).sum(1), dim=-1), tangent)

    def blocked(self, origin: Tensor, direction: Tensor) -> Tensor:
        return torch.from_numpy(self._first(origin, direction, "OCCLUDED") == 0)
