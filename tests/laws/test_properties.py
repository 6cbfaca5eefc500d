"""Laws of shape: whatever the strides, dtypes, broadcasting and sizes, a row is what it is alone."""

import math
from typing import Any

import torch
from cases import COMPENSATIONS, METHODS, SCATTERINGS, bsdf, serves
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from torchms import GGX, GTR, Beckmann, Bidirectional, Correlated, HeightWalk, RoughConductor, RoughDielectric, Stream
from torchms.fresnel import Conductor, Dielectric, Schlick

quick = settings(deadline=None, derandomize=True, max_examples=40)

MATERIALS = ("conductor[conductor]", "conductor[schlick]", "conductor[dielectric]", "dielectric", "diffuse")

methods = st.sampled_from(sorted(METHODS))
sizes = st.lists(st.integers(0, 3), max_size=3).map(tuple)
seeds = st.integers(0, 2**31 - 1)
dtypes = st.sampled_from([torch.float32, torch.float64])
indices = st.floats(math.log(1e-6), math.log(1e6)).map(math.exp).map(lambda n: min(max(n, 1e-6), 1e6))
alphas = st.floats(math.log(1e-3), math.log(2.0)).map(math.exp).map(lambda a: min(max(a, 1e-3), 2.0))


PAIRS = [(m, s) for m in MATERIALS for s in (*SCATTERINGS, *COMPENSATIONS) if serves(m, s)]
PAIRS += [("dielectric", name) for name in COMPENSATIONS]


@st.composite
def surfaces(draw: st.DrawFn) -> dict[str, Any]:
    """What `bsdf` takes: any material, scattering, distribution, roughness and dtype."""
    material, scattering = draw(st.sampled_from(PAIRS))
    round_only = scattering in COMPENSATIONS and material == "dielectric"
    return {
        "material": material,
        "scattering": scattering,
        "distribution": draw(st.sampled_from(["ggx", "beckmann"])),
        "alpha": (draw(alphas),) if round_only else (draw(alphas), draw(alphas)),
        "max_order": 2,
        "dtype": draw(dtypes),
    }


def unit(shape: tuple[int, ...], generator: torch.Generator, dtype: torch.dtype) -> Tensor:
    """Directions anywhere on the sphere, (*shape, 3)."""
    return torch.nn.functional.normalize(torch.randn(*shape, 3, generator=generator, dtype=torch.float64), dim=-1).to(
        dtype
    )


def thinned(shape: tuple[int, ...], mask: int) -> tuple[int, ...]:
    """A shape that broadcasts to `shape`: axes of the bits of `mask` are 1, leading ones of them are dropped."""
    thin = tuple(1 if mask >> i & 1 else n for i, n in enumerate(shape))
    while thin and thin[0] == 1 and mask & 1:
        thin, mask = thin[1:], mask >> 1
    return thin


def scattered(x: Tensor, way: int) -> Tensor:
    """The same numbers at other strides: contiguous, every second of a longer one, components first, expanded."""
    if way == 0 or not x.numel():
        return x.contiguous()
    if way == 1:
        return torch.stack([x, torch.full_like(x, math.nan)], -2)[..., 0, :]
    if way == 2:
        return x.movedim(-1, 0).contiguous().movedim(0, -1)
    return x.flip(-1).contiguous().flip(-1)


def close(found, expected, dtype: torch.dtype) -> None:
    rtol, atol = (1e-3, 1e-5) if dtype == torch.float32 else (1e-9, 1e-12)
    for a, b in zip(found, expected, strict=True):
        torch.testing.assert_close(a, b, rtol=rtol, atol=atol)


@quick
@given(surfaces(), methods, sizes, st.integers(0, 7), st.integers(0, 7), st.integers(0, 7), seeds)
def test_everything_broadcasts(what, method, shape, mask_i, mask_o, mask_u, seed):
    """Any shapes that broadcast, an empty batch and no axis at all included, give what equal shapes give."""
    surface = bsdf(**what)
    generator = torch.Generator().manual_seed(seed)
    wi, wo = (unit(thinned(shape, mask), generator, surface.dtype) for mask in (mask_i, mask_o))
    u = surface.uniforms(thinned(shape, mask_u), 2, generator=generator)
    used = {"pdf": [wi, wo]}.get(method, [wi, wo, u] if method in ("forward", "orders") else [wi, u])
    batch = torch.broadcast_shapes(*(x.shape[:-2] if x is u else x.shape[:-1] for x in used))
    full = [
        x.expand(*batch, *x.shape[-2:] if x is u else x.shape[-1:]).clone() if any(x is y for y in used) else x
        for x in (wi, wo, u)
    ]
    found = METHODS[method](surface, wi, wo, u)
    assert all(tuple(part.shape[: len(batch)]) == tuple(batch) for part in found)
    close(found, METHODS[method](surface, *full), surface.dtype)


@quick
@given(surfaces(), methods, st.integers(0, 4), st.integers(0, 3), st.integers(0, 3), seeds)
def test_strides_do_not_matter(what, method, rows, way_i, way_o, seed):
    surface = bsdf(**what)
    generator = torch.Generator().manual_seed(seed)
    wi, wo = (unit((rows,), generator, surface.dtype) for _ in range(2))
    u = surface.uniforms((rows,), 2, generator=generator)
    expected = METHODS[method](surface, wi.contiguous(), wo.contiguous(), u.contiguous())
    close(METHODS[method](surface, scattered(wi, way_i), scattered(wo, way_o), u), expected, surface.dtype)


@quick
@given(surfaces(), methods, st.integers(1, 4), seeds)
def test_values_are_what_they_must_be(what, method, rows, seed):
    """Over the whole ranges of α, on the whole sphere: finite, never negative; directions unit, orders within 0 … K."""
    surface = bsdf(**what)
    generator = torch.Generator().manual_seed(seed)
    wi, wo = (unit((rows,), generator, surface.dtype) for _ in range(2))
    result = METHODS[method](surface, wi, wo, surface.uniforms((rows,), 3, generator=generator))
    assert all(bool(part.isfinite().all()) for part in result)
    if method in ("sample", "sample_walk"):
        lengths = result[0].norm(dim=-1)
        assert bool(((lengths - 1).abs() < 1e-3).all()) and bool((result[1] >= 0).all())
    else:
        assert all(bool((part >= 0).all()) for part in result)
    if method == "albedo":
        assert bool((torch.stack([part.sum(-2) for part in result]).sum(0) <= 1.05).all())
    if method == "sample_walk":
        assert bool(((result[2] >= 0) & (result[2] <= surface.max_order)).all())


@quick
@given(surfaces(), dtypes, dtypes, seeds)
def test_dtypes_mix(what, dtype_i, dtype_o, seed):
    """Directions in another precision than the parameters give the value to the lesser precision."""
    surface = bsdf(**what)
    generator = torch.Generator().manual_seed(seed)
    wi, wo = (unit((3,), generator, torch.float64) for _ in range(2))
    u = surface.uniforms((3,), 2, generator=generator)
    found = surface(wi.to(dtype_i), wo.to(dtype_o), u)
    assert found.is_floating_point() and bool(found.isfinite().all())
    assert torch.promote_types(found.dtype, torch.float32) == found.dtype


@quick
@given(surfaces(), methods, st.sets(st.sampled_from(["wi", "wo", "u", "parameters"])), seeds)
def test_any_of_it_may_want_a_gradient(what, method, wanted, seed):
    """Values are those without a graph; a result that hangs on what wants a gradient gives a finite one."""
    surface = bsdf(**what)
    generator = torch.Generator().manual_seed(seed)
    given_ = {name: unit((3,), generator, surface.dtype) for name in ("wi", "wo")}
    given_["u"] = surface.uniforms((3,), 2, generator=generator).clone()
    plain = METHODS[method](surface, **given_)
    leaves = [value.requires_grad_() for name, value in given_.items() if name in wanted]
    if "parameters" in wanted:
        leaves += [p.requires_grad_() for p in surface.buffers() if p.numel() <= 4]
    result = METHODS[method](surface, **given_)
    close(result, plain, surface.dtype)
    totals = [part.sum() for part in result if part.requires_grad]
    if totals:
        for gradient in torch.autograd.grad(totals, leaves, allow_unused=True):
            assert gradient is None or bool(gradient.isfinite().all())


@quick
@given(
    st.lists(alphas, min_size=1, max_size=4),
    st.lists(indices.filter(lambda n: abs(n - 1) > 2e-3), min_size=4, max_size=4),
    st.lists(st.just(0.0) | indices, min_size=4, max_size=4),
    st.sampled_from(["beckmann", "ggx", "bidirectional"]),
    seeds,
)
def test_maps_over_whole_ranges(alpha, eta, k, kind, seed):
    """A map of α, η and k, each row what it is alone; k = 0, and indices of 1e-6 and 1e6, among them."""
    generator = torch.Generator().manual_seed(seed)
    n = len(alpha)
    a, index, absorption = (torch.tensor(x[:n], dtype=torch.float64) for x in (alpha, eta, k))
    facets = Beckmann if kind == "beckmann" else GGX
    scattering = Bidirectional(Correlated(), 2) if kind == "bidirectional" else HeightWalk(2)
    wi, wo = (unit((n,), generator, torch.float64) for _ in range(2))
    for make in (
        lambda i: RoughDielectric(facets(a[i]), Dielectric(index[i]), scattering),
        lambda i: RoughConductor(
            facets(a[i], a.flip(0)[i]), Conductor(index[i][..., None], absorption[i][..., None]), scattering
        ),
    ):
        together = make(...)
        u = together.uniforms((n,), 2, generator=generator).double()
        value = together(wi, wo, u)
        assert bool(value.isfinite().all()) and bool((value >= 0).all())
        for i in range(n):
            torch.testing.assert_close(make(i)(wi[i], wo[i], u[i]), value[i], rtol=1e-9, atol=1e-12)


@quick
@given(st.floats(0.01, 1.0), st.floats(0.1, 10.0), st.integers(0, 3), seeds)
def test_gtr_over_its_range(alpha, gamma, rows, seed):
    generator = torch.Generator().manual_seed(seed)
    facets = GTR(torch.tensor(alpha, dtype=torch.float64), torch.tensor(gamma, dtype=torch.float64))
    w = unit((rows,), generator, torch.float64)
    lam = facets.Lambda(w)
    torch.testing.assert_close(facets.Lambda(-w), -1 - lam, rtol=1e-6, atol=1e-6)
    m = facets.sample_visible(w, torch.rand(rows, 2, generator=generator, dtype=torch.float64))
    assert m.shape == (rows, 3) and bool(m.isfinite().all()) and bool((facets.D(m) >= 0).all())


@quick
@given(surfaces(), sizes, seeds, st.integers(1, 4))
def test_a_stream_serves_any_batch(what, shape, seed, n_paths):
    """A stream is its numbers, whatever the shape."""
    surface = bsdf(**what)
    generator = torch.Generator().manual_seed(seed)
    wi, wo = (unit(shape, generator, surface.dtype) for _ in range(2))
    stream = Stream(seed, n_paths)
    u = stream.uniforms(shape, surface.n_uniforms, surface.dtype)
    assert torch.equal(surface.orders(wi, wo, stream), surface.orders(wi, wo, u))


@quick
@given(st.lists(st.floats(0, 1), min_size=1, max_size=5), st.integers(0, 3), seeds)
def test_channels_are_independent(f0, rows, seed):
    generator = torch.Generator().manual_seed(seed)
    wi, wo = (unit((rows,), generator, torch.float64) for _ in range(2))
    values = torch.tensor(f0, dtype=torch.float64)
    surface = RoughConductor(GGX(0.5), Schlick(values), HeightWalk(2)).double()
    u = surface.uniforms((rows,), 2, generator=generator)
    value = surface(wi, wo, u)
    assert value.shape == (rows, len(f0))
    for i in range(len(f0)):
        alone = RoughConductor(GGX(0.5), Schlick(values[i : i + 1]), HeightWalk(2)).double()
        torch.testing.assert_close(alone(wi, wo, u), value[:, i : i + 1])
