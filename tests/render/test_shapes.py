"""Camera rays, hits, frames and meshes."""

import math

import numpy as np
import pytest
import torch
import trimesh
from trimesh.visual import TextureVisuals

from torchms.render.camera import Camera
from torchms.render.mesh import Mesh
from torchms.render.paths import shading_point
from torchms.render.scenes import BUILT_IN, load_shape, slab
from torchms.render.shapes import Shape


def grid(n: int = 41) -> tuple[torch.Tensor, torch.Tensor]:
    """x and y of pixel centres."""
    c = (torch.arange(n) + 0.5) / n
    y, x = torch.meshgrid(c, c, indexing="ij")
    return x.reshape(-1), y.reshape(-1)


def test_camera_rays():
    """The middle looks at the target, the upper edge is fov / 2 above it, right is right."""
    camera = Camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 40.0)
    origin, d = camera.rays(torch.tensor([0.5, 0.5, 1.0]), torch.tensor([0.5, 0.0, 0.5]), 2.0)
    h = math.tan(math.radians(20))
    expected = torch.tensor([[0, 0, -1], [0, h, -1], [2 * h, 0, -1]], dtype=torch.float64)
    torch.testing.assert_close(d, torch.nn.functional.normalize(expected, dim=-1))
    assert (origin == torch.tensor([0.0, 0.0, 5.0])).all()
    for eye in ((0.0, 3.0, 0.0), (0.0, -3.0, 0.0)):
        assert torch.isfinite(Camera(eye).rays(torch.tensor([0.3]), torch.tensor([0.2]), 1.0)[1]).all()


def test_the_slab_of_the_figure():
    """0.7 × 1.4 × 0.04, turned 110° about x, then 45° about y: its large face looks up, towards the camera."""
    shape, camera = load_shape("slab")
    assert camera == Camera((1.5, 1.5, 1.5), (0.0, 0.0, 0.0), 45.0)
    origin, d = camera.rays(*grid(), 1.0)
    hits = shape.intersect(origin, d)
    assert 0.08 < float(hits.found.double().mean()) < 0.3
    n = hits.geometric[hits.found]
    a = math.radians(110)
    # The axis (0, 0, −1) of the box: (0, sin 110°, −cos 110°) after the first turn.
    up = torch.tensor([-math.cos(a) * math.sqrt(0.5), math.sin(a), -math.cos(a) * math.sqrt(0.5)], dtype=torch.float64)
    large = (n @ up) > 0.999
    assert float(large.double().mean()) > 0.9
    torch.testing.assert_close(n[large], up.expand(int(large.sum()), 3))
    plane = hits.point[hits.found][large] @ up
    torch.testing.assert_close(plane, torch.full_like(plane, 0.02), rtol=0, atol=1e-12)
    # A ray through the body leaves by the opposite face.
    inside = shape.offset(hits.point, hits.geometric, d)[hits.found][large]
    back = shape.intersect(inside, -up.expand_as(inside))
    torch.testing.assert_close(back.point @ up, torch.full_like(plane, -0.02), rtol=0, atol=1e-12)
    assert ((back.geometric @ up) < -0.999).all()


def test_sphere_against_its_mesh():
    """The exact sphere and a fine mesh of it are met at the same places, from outside and from inside."""
    exact, camera = load_shape("sphere")
    ball = trimesh.creation.icosphere(subdivisions=5)
    mesh = Mesh(ball.vertices, ball.faces, is_closed=True)
    origin, d = camera.rays(*grid(), 1.0)
    a, b = exact.intersect(origin, d), mesh.intersect(origin, d)
    assert (a.found != b.found).double().mean() < 0.01
    both = a.found & b.found
    facing = both & ((a.geometric * d).sum(-1) < -0.3)
    torch.testing.assert_close(a.point[facing], b.point[facing], rtol=0, atol=3e-3)
    torch.testing.assert_close(a.geometric[both], b.geometric[both], rtol=0, atol=0.05)
    start = exact.offset(a.point, a.geometric, d)[a.found]
    through = exact.intersect(start, d[a.found])
    assert through.found.all() and ((through.geometric * d[a.found]).sum(-1) > 0).all()
    out = exact.offset(through.point, through.geometric, d[a.found])
    assert not exact.blocked(out, d[a.found]).any() and exact.blocked(start, d[a.found]).all()


@pytest.mark.parametrize("name", BUILT_IN)
def test_no_ray_meets_the_surface_it_leaves(name):
    """Secondary rays over the hemisphere around each hit of a convex body go free."""
    shape, camera = load_shape(name)
    origin, d = camera.rays(*grid(), 1.0)
    hits = shape.intersect(origin, d)
    where = hits.found.nonzero()[:, 0]
    g = torch.Generator().manual_seed(0)
    away = torch.nn.functional.normalize(torch.randn(len(where), 3, generator=g, dtype=torch.float64), dim=-1)
    n = hits.geometric[where]
    away = away * torch.where((away * n).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    assert not shape.blocked(shape.offset(hits.point[where], n, away), away).any()


def check_frames(shape: Shape, camera: Camera) -> None:
    origin, d = camera.rays(*grid(21), 1.0)
    hits = shape.intersect(origin, d)
    hits = type(hits)(*(part[hits.found] for part in hits))
    vertex = shading_point(hits, d[shape.intersect(origin, d).found], True, torch.float64)
    axes = torch.stack([vertex.x, vertex.y, vertex.z], -2)
    eye = torch.eye(3, dtype=torch.float64).expand(len(axes), 3, 3)
    torch.testing.assert_close(axes @ axes.mT, eye, rtol=0, atol=1e-12)
    torch.testing.assert_close(torch.linalg.det(axes), torch.ones(len(axes), dtype=torch.float64))
    assert (vertex.wi[:, 2] > 0).all()
    torch.testing.assert_close(vertex.to_world(vertex.wi), -d[shape.intersect(origin, d).found])


@pytest.mark.parametrize("name", BUILT_IN)
def test_frames_are_right_handed_and_face_the_camera(name):
    check_frames(*load_shape(name))


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".glb"])
def test_mesh_files(tmp_path, suffix):
    """A torus, smooth and flat, from any file format: closed, outwards, framed by the camera; smooth normals bend."""
    path = tmp_path / f"torus{suffix}"
    torus = trimesh.creation.torus(2.0, 0.5)
    torus.invert()
    torus.export(path)
    shape, camera = load_shape(str(path))
    assert shape.is_closed
    check_frames(shape, camera)
    origin, d = camera.rays(*grid(), 1.0)
    hits = shape.intersect(origin, d)
    assert 0.1 < float(hits.found.double().mean()) < 0.8
    n, g = hits.normal[hits.found], hits.geometric[hits.found]
    assert ((g * d[hits.found]).sum(-1) < 0).all()
    agree = (n * g).sum(-1)
    assert agree.min() > 0.9 and agree.min() < 0.9999
    # Smooth normals are those of the torus itself.
    p = hits.point[hits.found]
    ring = torch.nn.functional.normalize(p * torch.tensor([1.0, 1.0, 0.0]), dim=-1) * 2
    torch.testing.assert_close(n, torch.nn.functional.normalize(p - ring, dim=-1), rtol=0, atol=0.05)
    flat = load_shape(str(path), crease=0.0)[0].intersect(origin, d)
    assert torch.equal(flat.normal, flat.geometric)


def test_creases_stay_sharp(tmp_path):
    """A box keeps its flat faces under smoothing."""
    trimesh.creation.box().export(tmp_path / "box.ply")
    shape, camera = load_shape(str(tmp_path / "box.ply"))
    hits = shape.intersect(*camera.rays(*grid(), 1.0))
    torch.testing.assert_close(hits.normal[hits.found], hits.geometric[hits.found])


def test_tangents_follow_the_texture(tmp_path):
    """∂p/∂u of a square whose u runs along −z; mirrored coordinates turn it round."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0, -1], [0, 0, -1]], dtype=float)
    for sign in (1, -1):
        uv = np.stack([-corners[:, 2] * sign, corners[:, 0]], -1)
        mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=TextureVisuals(uv=uv), process=False)
        mesh.export(tmp_path / f"square{sign}.obj")
        shape, _ = load_shape(str(tmp_path / f"square{sign}.obj"))
        assert not shape.is_closed
        down = torch.tensor([[0.0, -1.0, 0.0]], dtype=torch.float64)
        hits = shape.intersect(torch.tensor([[0.3, 1.0, -0.4]], dtype=torch.float64), down)
        vertex = shading_point(hits, down, True, torch.float64)
        torch.testing.assert_close(vertex.x, torch.tensor([[0.0, 0.0, -1.0 * sign]], dtype=torch.float64))


def test_scaling_a_scene_changes_nothing():
    """A slab of a millionth and of a million times the size is met at the same places."""
    origin, d = Camera((1.5, 1.5, 1.5)).rays(*grid(15), 1.0)
    points = []
    for scale in (1e-6, 1.0, 1e6):
        shape = slab(tuple(scale * s for s in (0.7, 1.4, 0.04)))
        hits = shape.intersect(origin * scale, d)
        points.append(torch.where(hits.found[:, None], hits.point / scale, 0.0))
    torch.testing.assert_close(points[0], points[1], rtol=0, atol=1e-9)
    torch.testing.assert_close(points[2], points[1], rtol=0, atol=1e-9)
