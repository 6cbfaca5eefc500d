"""Heights over a regular grid as a triangle mesh, and back."""

from typing import TYPE_CHECKING

import numpy as np

from torchms.storage.media import import_trimesh

if TYPE_CHECKING:
    import trimesh


def triangle_indices(nx: int, ny: int) -> np.ndarray:
    """(2 · nx · ny, 3) int32 vertex numbers of the facets over (nx + 1)(ny + 1) vertices, cell by cell.

    Facet 2c is the half of cell c = i · ny + j with vertices (i, j), (i + 1, j), (i, j + 1); 2c + 1 is the other half.
    """
    first = (np.arange(nx, dtype=np.int32)[:, None] * (ny + 1) + np.arange(ny, dtype=np.int32)).ravel()
    faces = np.empty((nx * ny, 2, 3), dtype=np.int32)
    faces[:, 0] = first[:, None] + np.array([0, ny + 1, 1], dtype=np.int32)
    faces[:, 1] = first[:, None] + np.array([ny + 2, 1, ny + 1], dtype=np.int32)
    return faces.reshape(-1, 3)


def mesh_of_grid(heights: np.ndarray, spacing: tuple[float | int, float | int]) -> "trimesh.Trimesh":
    """The mesh over a full grid of vertices (nothing wraps here)."""
    trimesh = import_trimesh()
    nx, ny = heights.shape
    vertices = np.empty((nx, ny, 3))
    vertices[..., 0] = (np.arange(nx) * spacing[0])[:, None]
    vertices[..., 1] = np.arange(ny) * spacing[1]
    vertices[..., 2] = heights
    return trimesh.Trimesh(vertices.reshape(-1, 3), triangle_indices(nx - 1, ny - 1), process=False, validate=False)


def grid_of_mesh(mesh: "trimesh.Trimesh") -> tuple[np.ndarray, tuple[float, float]]:
    """Heights and spacing of a mesh that is a heightfield over a regular grid, or ValueError that says why not."""
    where = "Heightfield.from_mesh(mesh=...)"
    remedy = "Resample it to a regular grid of heights and use Heightfield.from_heights."
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if len(vertices) < 16 or not np.isfinite(vertices).all():
        raise ValueError(
            f"{where} must have at least 16 vertices, all finite; got {len(vertices)}. Repair the mesh first."
        )
    normal_z = _twice_area_z(vertices, np.asarray(mesh.faces))
    if (normal_z < 0).all():
        normal_z = -normal_z
    if not (normal_z > 0).all():
        bad = int((normal_z <= 0).sum())
        raise ValueError(
            f"{where} must be a heightfield over x-y; {bad} of {len(normal_z)} faces stand upright, overhang or are "
            f"turned over (a closed solid also does). Turn the macro-normal to +z and keep only the top side. {remedy}"
        )
    index, axes = [], []
    for axis, letter in enumerate("xy"):
        lines, number = _grid_lines(vertices[:, axis])
        step = np.diff(lines)
        if len(lines) < 4 or step.max() - step.min() > 1e-3 * step.mean():
            raise ValueError(
                f"{where} must have its vertices on a regular grid; its {letter} coordinates take {len(lines)} values, "
                f"unevenly spaced. {remedy}"
            )
        index.append(number)
        axes.append(lines)
    shape = (len(axes[0]), len(axes[1]))
    if shape[0] * shape[1] > len(vertices):  # said before an array of that size is made
        raise ValueError(
            f"{where} must have a vertex at each point of its grid; it has {len(vertices)} for {shape[0]} x {shape[1]} "
            f"points. Fill the holes (trimesh.repair). {remedy}"
        )
    spacing = (float(np.mean(np.diff(axes[0]))), float(np.mean(np.diff(axes[1]))))
    heights = np.full(shape, np.nan)
    heights[index[0], index[1]] = vertices[:, 2]
    # Doubled vertices (a triangle soup) are welcome as long as they agree.
    fold = np.abs(heights[index[0], index[1]] - vertices[:, 2]).max()
    holes = int(np.isnan(heights).sum())
    covered = 0.5 * float(normal_z.sum())
    full = (shape[0] - 1) * (shape[1] - 1) * spacing[0] * spacing[1]
    if holes or fold > 1e-6 * max(spacing) or abs(covered / full - 1) > 1e-6:
        raise ValueError(
            f"{where} must cover its rectangle once, without holes; {holes} of {heights.size} grid points have no "
            f"vertex and its faces cover {100 * covered / full:.4g} % of the rectangle. Fill the holes "
            f"(trimesh.repair). {remedy}"
        )
    return heights, spacing


def _twice_area_z(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k], :2] for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _grid_lines(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct coordinates up to rounding (1e-6 of the range, float32 files), and which one each value is."""
    order = np.argsort(values, kind="stable")
    in_order = values[order]
    new = np.diff(in_order, prepend=in_order[0]) > 1e-6 * (in_order[-1] - in_order[0])
    number = np.empty(len(values), dtype=np.int64)
    number[order] = np.cumsum(new)
    lines = np.bincount(number, weights=values) / np.bincount(number)
    return lines, number
