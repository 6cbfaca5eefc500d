"""Gradients with respect to the parameters of a surface."""

import torch
from cases import CHOOSING, DISTRIBUTIONS, SCATTERINGS, directions, each, models, sides, transmits
from torch import Tensor

from torchms import BSDF, RoughConductor, RoughDielectric, RoughDiffuse
from torchms.estimators.path_tracer import PathTracer
from torchms.fresnel import Conductor, Dielectric, Schlick
from torchms.testing import estimate, exactly, p_value, zscore

PARAMETERS: dict[str, dict[str, list[float]]] = {
    "conductor[conductor]": {"eta": [0.4, 1.2], "k": [3.0, 2.0]},
    "conductor[schlick]": {"f0": [0.1, 0.8]},
    "dielectric": {"eta": [1.5]},
    "diffuse": {"albedo": [0.3, 0.9]},
}
"""The numbers of a material beside α_x and α_y."""

BUILDERS = {
    "conductor[conductor]": lambda d, s, eta, k: RoughConductor(d, Conductor(eta, k), s),
    "conductor[schlick]": lambda d, s, f0: RoughConductor(d, Schlick(f0), s),
    "dielectric": lambda d, s, eta: RoughDielectric(d, Dielectric(eta.squeeze(-1)), s),
    "diffuse": lambda d, s, albedo: RoughDiffuse(d, albedo, s),
}
STEP = 0.02


def build(material: str, scattering: str, distribution: str, ax: Tensor, ay: Tensor, *rest: Tensor) -> BSDF:
    """The BSDF with these tensors in it."""
    return BUILDERS[material](DISTRIBUTIONS[distribution](ax, ay), SCATTERINGS[scattering](3), *rest)


def attached(surface: BSDF, value: bool | None = True) -> BSDF:
    """`surface`, with directions that follow the parameters in its gradients (or are held)."""
    assert isinstance(surface.scattering, PathTracer)
    surface.scattering.attached = value
    return surface


def point(material: str, shape: tuple[int, ...] = ()) -> list[Tensor]:
    """α_x, α_y and the material's numbers: the same for every pixel of `shape`, each pixel a variable of its own."""
    values = (torch.tensor(v, dtype=torch.float64) for v in (0.6, 0.35, *PARAMETERS[material].values()))
    return [v.expand((*shape, *v.shape)).clone().requires_grad_() for v in values]


@models(PARAMETERS, where=lambda material, scattering: material != "dielectric" or scattering == "single")
@each("distribution", [name for name in DISTRIBUTIONS if name not in CHOOSING])
def test_gradcheck_at_fixed_numbers(material, scattering, distribution, generator):
    """forward and orders, float64, against finite differences with the same random numbers, from each side.

    That is the gradient of attached directions, whatever it is good for. The choice to refract carries one that no fixed
    numbers show: see the next test.
    """
    surface = build(material, scattering, distribution, *point(material))
    wi, wo = directions(2, generator, 0.2), directions(2, generator, 0.2)
    # Inside of (0, 1): at its ends choices flip.
    u = 0.02 + 0.96 * torch.rand(2, 2, surface.n_uniforms, generator=generator, dtype=torch.float64)
    for side_i in sides(material):
        for side_o in sides(material):

            def values(*parameters: Tensor) -> tuple[Tensor, Tensor]:
                surface = attached(build(material, scattering, distribution, *parameters))
                return surface(side_i * wi, side_o * wo, u), surface.orders(side_i * wi, side_o * wo, u)

            assert torch.autograd.gradcheck(values, point(material), eps=1e-6, atol=1e-6, rtol=1e-4)


@models(PARAMETERS)
@each("distribution", DISTRIBUTIONS)
def test_mean_gradient_is_the_slope_of_the_mean(material, scattering, distribution, generator, budget):
    """d E[albedo] = E[d albedo], each order and side: central differences with common numbers, which choices may flip.

    Every path has a pixel of its own, so one backward pass gives the gradient of each.
    """
    n = 16_000
    wi = directions(1, generator, 0.4)[0]
    parameters = point(material, (n,))
    u = build(material, scattering, distribution, *parameters).uniforms((n,), 1, generator=generator)

    def energies(*values: Tensor) -> Tensor:
        albedo = build(material, scattering, distribution, *values).albedo(wi, u)
        return torch.cat([albedo.reflected, albedo.transmitted], 1)[..., 0]

    here = energies(*parameters)
    gradients = [torch.autograd.grad(e.sum(), parameters, retain_graph=True, allow_unused=True) for e in here.unbind(1)]
    # The rule's own error: a sixth of STEP² times the third derivative, which is of the order of 1; and a few paths of which
    # a step flips the choice to refract, too few for a normal mean.
    error = STEP**2 + (4 / (2 * STEP * n) if transmits(material) else 0)
    p = []
    for i in range(len(parameters)):
        step = [STEP if j == i else 0.0 for j in range(len(parameters))]
        with torch.no_grad():
            ahead, behind = (energies(*(x + s * h for x, h in zip(parameters, step, strict=True))) for s in (1, -1))
        for k, gradient in enumerate(gradients):
            slope = (ahead[:, k] - behind[:, k]) / (2 * STEP)
            mean = 0 if gradient[i] is None else gradient[i].reshape(n, -1).sum(1)
            p.append(p_value(zscore(estimate(slope - mean), exactly(torch.zeros(())), rounding=error)))
    budget(torch.stack(p))
