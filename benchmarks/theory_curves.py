"""Curves for the pages of the theory, computed by the models that the pages are about."""

import json
import math
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from theory_drawings import figure
from theory_profile import INK, LIGHT, OTHER, SKY

import torchms as ms
from torchms.fresnel import Dielectric, Ideal
from torchms.lobes import measure
from torchms.maths.frame import direction

RESULTS = Path(__file__).parent / "results"
MODELS = {
    "exact": (ms.Unidirectional(ms.Invariance(), 8), INK, "-"),
    "correlated": (ms.Unidirectional(ms.Correlated(), 8), LIGHT, "--"),
    "uncorrelated": (ms.Unidirectional(ms.Uncorrelated(), 8), OTHER, ":"),
}


def heights() -> Figure:
    """Where the next bounce happens if the last one was at U = 0.4: what each of the three models believes."""
    drawn = figure(9, 3.0)
    u, start = torch.linspace(0.002, 1, 500), 0.4
    for axis, lam, title in zip(
        drawn.subplots(1, 2), (-1.6, 0.6), ("the leg goes down", "the leg goes up and hits"), strict=True
    ):
        a = abs(lam)
        if lam < 0:
            exact = torch.where(u < start, a * start**lam * u ** (-lam - 1), 0.0)
        else:
            exact = torch.where(u > start, a * start**lam * u ** (-lam - 1), 0.0) / (1 - start**lam)
        for name, density in {"exact": exact, "correlated": a * u ** (a - 1), "uncorrelated": torch.ones(500)}.items():
            _, colour, style = MODELS[name]
            axis.plot(u, density, style, color=colour, label=name, linewidth=1.8)
        axis.axvline(start, color=SKY, linewidth=5, alpha=0.5, zorder=0)
        axis.text(start + 0.015, 4.1, "last bounce", fontsize=8)
        axis.set(title=f"{title}, Λ(d) = {lam:g}", xlabel="height U of the next bounce", ylim=(0, 4.4), xlim=(0, 1))
    drawn.axes[0].set_ylabel("density")
    drawn.axes[0].legend(fontsize=8, frameon=False, loc="upper right")
    return drawn


def orders() -> Figure:
    """Share of the light by number of bounces, mirrors at α = 1; and the second bounce over the angle."""
    drawn = figure(9, 3.2)
    left, right = drawn.subplots(1, 2)
    for i, (name, (scattering, colour, style)) in enumerate(MODELS.items()):
        bsdf = ms.RoughConductor(ms.GGX(1.0), Ideal(), scattering)
        angles = np.linspace(0, 80, 9)
        energies = np.stack([reflected(bsdf, angle)[:4] for angle in angles])
        bars = left.bar(np.arange(1, 5) + 0.27 * (i - 1), energies[0], 0.25, color=colour, label=name)
        left.bar_label(bars, fmt="%.2f", fontsize=7)
        right.plot(angles, energies[:, 1], style, color=colour, label=name, linewidth=1.8)
    left.set(xlabel="bounces", ylabel="share of the light", xticks=range(1, 5), title="from above")
    right.set(xlabel="angle of incidence [°]", ylabel="share after exactly two", ylim=(0, None), title="two bounces")
    left.legend(fontsize=8, frameon=False)
    return drawn


def reflected(bsdf: ms.BSDF, angle: float) -> np.ndarray:
    """Energies (K,) that leave on the side of the light, incidence in degrees."""
    return measure(bsdf, direction(math.radians(angle)), n_paths=100_000, progress=False).reflected[:, 0].numpy()


def through_glass() -> Figure:
    """What rough glass reflects and transmits after one bounce and after several, over the angle, from either side."""
    drawn = figure(9, 3.2)
    angles = np.linspace(0, 85, 12)
    for axis, eta, title in zip(drawn.subplots(1, 2), (1.5, 1 / 1.5), ("from the air", "from the glass"), strict=True):
        bsdf = ms.RoughDielectric(ms.GGX(0.5), Dielectric(eta), ms.HeightWalk(10))
        tallies = [measure(bsdf, direction(math.radians(a)), n_paths=60_000, progress=False) for a in angles]
        for name, colour in (("reflected", INK), ("transmitted", OTHER)):
            energy = np.stack([getattr(tally, name)[:, 0].numpy() for tally in tallies])
            axis.plot(angles, energy.sum(1), color=colour, linewidth=1.8, label=f"{name}, all")
            axis.plot(angles, energy[:, 0], "--", color=colour, linewidth=1.2, label=f"{name}, one bounce")
        axis.set(title=title, xlabel="angle of incidence [°]", ylim=(0, 1))
    drawn.axes[0].set_ylabel("share of the light")
    drawn.axes[0].legend(fontsize=8, frameon=False, loc="center left")
    return drawn


def staircase() -> Figure:
    """An integral with a jump, estimated with the same 24 random numbers at every parameter; and two derivatives of it."""
    drawn = figure(9, 3.2)
    left, right = drawn.subplots(1, 2)
    # One number in each 24th of the interval: few samples, and yet near the integral.
    u, edge = (torch.arange(24) + torch.rand(24, generator=torch.Generator().manual_seed(2))) / 24, 0.6
    theta = torch.linspace(0.4, 4, 400)[:, None]
    left.plot(theta, edge**theta, color=INK, label="the integral", linewidth=1.8)
    left.plot(
        theta, (u ** (1 / theta) < edge).float().mean(1), color=LIGHT, linewidth=1.2, label="24 samples that move"
    )
    held = u ** (1 / 2.0)
    weight = (theta * held ** (theta - 1)) / (2.0 * held)
    left.plot(
        theta, (weight * (held < edge)).mean(1), "--", color=OTHER, linewidth=1.2, label="24 samples held, weighted"
    )
    left.set(xlabel="parameter θ", ylabel="∫ f", ylim=(0, 1))
    slope = torch.linspace(0.4, 4, 25)[:, None]
    many = torch.rand(2000, generator=torch.Generator().manual_seed(3)) ** (1 / slope)
    right.plot(theta, edge**theta * math.log(edge), color=INK, linewidth=1.8, label="the derivative")
    right.plot(slope, torch.zeros(25), "o", color=LIGHT, markersize=4, label="samples move: 0")
    score = ((1 / slope + many.log()) * (many < edge)).mean(1)
    right.plot(slope, score, "s", color=OTHER, markersize=4, label="2000 samples held")
    right.set(xlabel="parameter θ", ylabel="d/dθ ∫ f")
    for axis in (left, right):
        axis.legend(fontsize=8, frameon=False)
    return drawn


def distilled() -> Figure:
    """The light of two and more bounces in the plane of incidence: single paths, their mean, and the network."""
    drawn = figure(7.2, 3.2)
    axis = drawn.subplots()
    angle = torch.linspace(-89, 89, 179)
    wi, wo = direction(-0.9), torch.stack([direction(float(a)) for a in angle.deg2rad()])
    exact = ms.RoughConductor(ms.GGX(0.6), Ideal(), ms.Bidirectional(ms.Invariance(), 8))
    paths = exact.orders(wi, wo, ms.Stream(5, 1))[:, 1:, 0].sum(1)
    mean = exact.orders(wi, wo, ms.Stream(6, 4096))[:, 1:, 0].sum(1)
    learned = ms.RoughConductor(ms.GGX(0.6), Ideal(), ms.Distilled()).orders(wi, wo)[:, 1:, 0].sum(1)
    axis.plot(angle, paths, ".", color=SKY, label="one path a direction")
    axis.plot(angle, mean, color=INK, linewidth=2.6, label="mean of 4096")
    axis.plot(angle, learned, "--", color=LIGHT, linewidth=1.6, label="Distilled()")
    axis.set(xlabel="angle of wo in the plane of incidence [°]", ylabel="two and more bounces [1/sr]", ylim=(0, None))
    axis.legend(fontsize=8, frameon=False)
    return drawn


def smith() -> Figure:
    """Energies by number of bounces of Beckmann surfaces that were traced, and of Smith's model; from accuracy.py's file."""
    rows = json.loads((RESULTS / "microsurface_accuracy.json").read_text())["rows"]
    (row,) = (r for r in rows if r["material"] == "conductor" and r["alpha"] == [1.0, 1.0])
    theta = [math.degrees(each["theta"]) for each in row["angles"]]
    surface, model = (
        np.array([each[name]["reflected"][:3] for each in row["angles"]]) for name in ("simulation", "height walk")
    )
    drawn = figure(9, 3.2)
    left, right = drawn.subplots(1, 2)
    for k, colour in enumerate((INK, OTHER, LIGHT)):
        left.plot(theta, surface[:, k], "o", color=colour, label=f"surface, order {k + 1}")
        left.plot(theta, model[:, k], color=colour, label=f"Smith, order {k + 1}")
        right.plot(theta, model[:, k] - surface[:, k], "o-", color=colour, label=f"order {k + 1}")
    left.set(xlabel="angle of incidence [°]", ylabel="share of the light", ylim=(0, 1))
    right.set(xlabel="angle of incidence [°]", ylabel="Smith minus surface")
    right.axhline(0, color=INK, linewidth=0.6)
    left.legend(fontsize=7, frameon=False, ncols=2)
    right.legend(fontsize=8, frameon=False)
    return drawn
