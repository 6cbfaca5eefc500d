"""A network whose outputs feed a surface per pixel: gradients reach it, it learns, and nothing piles up."""

import gc

import torch
from cases import direction
from torch import Tensor, nn

from torchms import GGX, Invariance, RoughConductor, Stream, Unidirectional
from torchms.fresnel import Schlick

PIXELS = 24
STEPS = 60


class Material(nn.Module):
    """uv → α_x, α_y and f0 of a metal, each in its range."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(2, 24), nn.SiLU(), nn.Linear(24, 24), nn.SiLU(), nn.Linear(24, 5))
        self.scattering = Unidirectional(Invariance(), 3)

    def forward(self, uv: Tensor) -> RoughConductor:
        out = torch.sigmoid(self.layers(uv))
        ax, ay = (0.05 + 0.9 * out[..., i] for i in (0, 1))
        return RoughConductor(GGX(ax, ay), Schlick(out[..., 2:]), self.scattering)


def live_tensors() -> int:
    gc.collect()
    return sum(issubclass(type(o), Tensor) for o in gc.get_objects())


def test_network_learns_a_material():
    torch.manual_seed(1)
    line = torch.linspace(-1, 1, PIXELS)
    uv = torch.stack(torch.meshgrid(line, line, indexing="ij"), -1)
    truth = RoughConductor(
        GGX(0.4 + 0.2 * uv[..., 0], 0.3 - 0.1 * uv[..., 1]), Schlick([0.9, 0.6, 0.2]), Unidirectional(Invariance(), 3)
    )
    wi = direction(0.5, dtype=torch.float32)
    wos = torch.stack([direction(t, p, torch.float32) for t, p in ((0.4, 3.6), (0.9, 2.5), (0.2, 0.0))])[:, None, None]
    with torch.no_grad():
        target = truth(wi, wos, Stream(0, 64))
    material = Material()
    scattering = material.scattering
    optimizer = torch.optim.Adam(material.parameters(), lr=0.01)
    losses, alive = [], []
    for step in range(STEPS):
        surface = material(uv)
        # Two independent estimates: the gradient of their product is that of the squared error of the expectation.
        errors = [surface(wi, wos, Stream(1 + 2 * step + i)) - target for i in range(2)]
        loss = (errors[0] * errors[1]).mean()
        optimizer.zero_grad()
        loss.backward()
        if step == 0:
            gradients = [p.grad for p in material.parameters()]
            assert all(g is not None and bool(g.isfinite().all()) and bool((g != 0).any()) for g in gradients)
        optimizer.step()
        losses.append(loss.item())
        del surface, errors, loss
        if step in (STEPS // 3, STEPS - 1):
            alive.append(live_tensors())
    assert sum(losses[-10:]) < 0.2 * sum(losses[:10])
    assert material.scattering is scattering and len(scattering.state_dict()) == 0
    # Memory is flat: what one step made is gone after it.
    assert alive[1] <= alive[0]
