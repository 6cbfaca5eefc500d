"""`torch.func` on surfaces: functional_call, grad, jacrev, jacfwd and vmap give what backward and loops give."""

import pytest
import torch
from cases import direction
from torch import Tensor
from torch.func import functional_call, grad, jacfwd, jacrev, vmap

from torchms import (
    BSDF,
    GGX,
    GTR,
    Beckmann,
    Bidirectional,
    Correlated,
    HeightWalk,
    Invariance,
    KullaConty,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    SingleBounce,
    Stream,
    Turquin,
    Unidirectional,
)
from torchms.fresnel import Dielectric, Schlick

SURFACES = {
    "single": lambda a: RoughConductor(GGX(a, 0.4), Schlick([0.5, 0.9]), SingleBounce()),
    "unidirectional": lambda a: RoughConductor(GGX(a, 0.4), Schlick([0.5, 0.9]), Unidirectional(Invariance(), 3)),
    "bidirectional": lambda a: RoughConductor(Beckmann(a, 0.4), Schlick([0.5, 0.9]), Bidirectional(Correlated(), 3)),
    "glass": lambda a: RoughDielectric(GGX(a, 0.4), Dielectric(1.5), HeightWalk(3)),
    "chalk": lambda a: RoughDiffuse(GGX(a, 0.4), [0.5, 0.9], HeightWalk(3)),
    "gtr": lambda a: RoughConductor(GTR(a, 1.5), Schlick([0.5, 0.9]), SingleBounce()),
    "kulla-conty": lambda a: RoughConductor(GGX(a, 0.4), Schlick([0.5, 0.9]), KullaConty()),
    "turquin": lambda a: RoughConductor(Beckmann(a, 0.4), Schlick([0.5, 0.9]), Turquin()),
}
WI, WO = direction(0.9), direction(1.1, 2.0)


def surface(kind: str, alpha: Tensor | float = 0.7) -> BSDF:
    return SURFACES[kind](alpha).to(torch.float64)


def numbers(bsdf: BSDF, *shape: int, n: int = 4, seed: int = 3) -> Tensor:
    return bsdf.uniforms(shape, n, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("kind", SURFACES)
def test_functional_call(kind):
    """The parameters of the call, not those of the module; the gradient is that of a surface built with them."""
    alpha = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    bsdf, built = surface(kind, 0.7), surface(kind, alpha)
    u = numbers(bsdf)
    value = functional_call(bsdf, {"distribution.alpha": alpha}, (WI, WO, u))
    expected = built(WI, WO, u)
    torch.testing.assert_close(value, expected)
    assert not torch.allclose(value, bsdf(WI, WO, u))
    (mine,), (theirs,) = (torch.autograd.grad(v.sum(), alpha) for v in (value, expected))
    torch.testing.assert_close(mine, theirs)


@pytest.mark.parametrize("kind", SURFACES)
def test_jacobians(kind):
    """jacrev, jacfwd and grad of the parameters, against backward: directions are held in all of them."""
    bsdf = surface(kind)
    u = numbers(bsdf)
    alpha = torch.tensor(0.5, dtype=torch.float64)

    def value(alpha: Tensor) -> Tensor:
        return functional_call(bsdf, {"distribution.alpha": alpha}, (WI, WO, u))

    leaf = alpha.clone().requires_grad_()
    expected = torch.stack([torch.autograd.grad(v, leaf, retain_graph=True)[0] for v in value(leaf)])
    torch.testing.assert_close(jacrev(value)(alpha), expected)
    torch.testing.assert_close(jacfwd(value)(alpha), expected)
    torch.testing.assert_close(grad(lambda a: value(a).sum())(alpha), expected.sum())


@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("randomness", ["u", "stream"])
def test_vmap(kind, randomness):
    """Over parameters, directions and random numbers at once, against a loop; and its gradients a row."""
    bsdf = surface(kind)
    alphas = torch.tensor([0.3, 0.5, 0.8], dtype=torch.float64)
    wis = torch.stack([direction(t) for t in (0.2, 0.7, 1.2)])
    us = torch.stack([numbers(bsdf, seed=i) for i in range(3)])

    def value(alpha: Tensor, wi: Tensor, u: Tensor) -> Tensor:
        return functional_call(bsdf, {"distribution.alpha": alpha}, (wi, WO, u if randomness == "u" else Stream(5, 4)))

    expected = torch.stack([value(*row) for row in zip(alphas, wis, us, strict=True)])
    torch.testing.assert_close(vmap(value)(alphas, wis, us), expected)
    slopes = torch.stack([jacrev(value)(*row) for row in zip(alphas, wis, us, strict=True)])
    torch.testing.assert_close(vmap(jacrev(value))(alphas, wis, us), slopes)


@pytest.mark.parametrize("kind", SURFACES)
def test_vmap_of_the_other_methods(kind):
    bsdf = surface(kind)
    wis = torch.stack([direction(t) for t in (0.2, 0.7, 1.2)])
    u = numbers(bsdf)
    for method in (
        lambda w: bsdf.pdf(w, WO),
        lambda w: bsdf.sample(w, u).wo,
        lambda w: bsdf.sample_walk(w, u).weight,
        lambda w: bsdf.albedo(w, u).reflected,
        lambda w: bsdf.orders(w, WO, u),
    ):
        torch.testing.assert_close(vmap(method)(wis), torch.stack([method(w) for w in wis]))


def test_many_rows_under_vmap(generator):
    """More rows than a block holds, in every element of the map."""
    bsdf = surface("unidirectional")
    n = 5000
    u = numbers(bsdf, n, n=2)
    alphas = torch.tensor([0.3, 0.6], dtype=torch.float64)

    def value(alpha: Tensor) -> Tensor:
        return functional_call(bsdf, {"distribution.alpha": alpha}, (WI, WO, u))

    torch.testing.assert_close(vmap(value)(alphas), torch.stack([value(a) for a in alphas]))
