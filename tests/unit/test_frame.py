"""Component vectors and the geometry of a facet."""

import torch
from cases import TOLERANCES, directions
from torch import Tensor

from torchms.maths.frame import (
    Vec3,
    dot,
    half_vector,
    join,
    mirrored,
    normalized,
    orthonormal_basis,
    reflect,
    refract,
    select,
    split,
)

RTOL, ATOL = 1e-12, TOLERANCES[torch.float64][1]


def close(a: Tensor, b: Tensor | float) -> None:
    torch.testing.assert_close(a, torch.as_tensor(b, dtype=a.dtype).expand_as(a), rtol=RTOL, atol=1e-13)


def test_split_and_join_are_inverse(generator):
    w = directions(5, generator).reshape(5, 1, 3)
    assert torch.equal(join(split(w)), w)
    assert join(Vec3(torch.zeros(4), torch.zeros(()), torch.ones(3, 1))).shape == (3, 4, 3)


def test_reflection(generator):
    """The mirror image has the same angle, lies in the plane of w and m, and comes back; its half vector is m."""
    w, m = split(directions(200, generator)), split(directions(200, generator))
    d = reflect(w, m)
    close(dot(d, m), dot(w, m))
    close(dot(d, d), 1.0)
    close(join(reflect(d, m)), join(w))
    facing = (dot(w, m) > 0.01)[:, None]
    close(torch.where(facing, join(half_vector(w, d)) - join(m), 0.0), 0.0)


def test_refraction(generator):
    """Snell: w + η d is along m, |d| = 1, d is on the other side; the way back has 1 / η. No direction: the grazing one."""
    w, m = split(directions(500, generator)), split(directions(500, generator))
    m = select(dot(w, m) < 0, -m, m)
    for eta in (1.5, 1 / 1.5):
        n = torch.tensor(eta, dtype=torch.float64)
        d = refract(w, m, n)
        cos = dot(w, m)
        total = 1 - cos**2 >= eta**2
        assert total.any() == (eta < 1)
        h = Vec3(w.x + eta * d.x, w.y + eta * d.y, w.z + eta * d.z)
        along = join(h) - dot(h, m)[:, None] * join(m)
        close(torch.where(total, 0.0, dot(d, d) - 1), 0.0)
        close(torch.where(total[:, None], 0.0, along), 0.0)
        assert (dot(d, m) <= 1e-12).all()
        close(torch.where((total | (dot(d, m) > -1e-3))[:, None], 0.0, join(refract(d, -m, 1 / n)) - join(w)), 0.0)
        close(torch.where(total, dot(d, m), 0.0), 0.0)


def test_basis_is_orthonormal_and_right_handed(generator):
    poles = torch.tensor([[0, 0, 1.0], [0, 0, -1.0], [1.0, 0, 0]], dtype=torch.float64)
    n = torch.cat([directions(200, generator), poles])
    t, b = (join(v) for v in orthonormal_basis(split(n)))
    close(torch.einsum("nia,nja->nij", *[torch.stack([t, b, n], 1)] * 2), torch.eye(3, dtype=torch.float64))
    close(torch.linalg.cross(t, b), n)


def test_a_vector_without_a_direction_is_the_normal():
    """With a zero gradient: h = 0 happens where wo = −wi."""
    for dtype in TOLERANCES:
        v = torch.zeros(3, dtype=dtype, requires_grad=True)
        n = join(normalized(split(v)))
        assert n.tolist() == [0, 0, 1]
        n.sum().backward()
        assert v.grad is not None and v.grad.tolist() == [0, 0, 0]


def test_mirrored_is_across_the_surface():
    assert join(mirrored(split(torch.tensor([0.6, 0.0, 0.8])))).tolist() == torch.tensor([0.6, 0.0, -0.8]).tolist()
