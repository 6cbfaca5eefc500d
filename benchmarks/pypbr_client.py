"""PyPBR's materials through PyPBR's model and through `torchms.dropins.pypbr`: a picture, and the light that is returned.

The picture is a dome of five metals and paints, roughness from left to right, under a point light, by each model from the same
material object. Energies are of a white metal and a white paint under light from everywhere.

    pip install pypbr          # and the torchvision that belongs to your torch
    python benchmarks/pypbr_client.py      # results/pypbr.json, docs/images/pypbr.png
"""

import argparse
import math
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch
from record import save
from torch import Tensor

from torchms.dropins.pypbr import CookTorranceBRDF as Ours
from torchms.fresnel import Conductor

BasecolorMetallicMaterial: Any = import_module("pypbr.materials").BasecolorMetallicMaterial
Theirs: Any = import_module("pypbr.models").CookTorranceBRDF

FIGURE = Path(__file__).parents[1] / "docs" / "images" / "pypbr.png"
ROUGHNESSES = (0.2, 0.4, 0.6, 0.8, 1.0)
COSINES = (1.0, 0.15)
ENCODED_UP = torch.tensor([0.5, 0.5, 1.0])
"""What PyPBR reads as (0, 0, 1)."""
DIM = 1e-3
"""Of the lights of the furnace: PyPBR clips what it returns to [0, 1]."""


def furnace(model: Any, metallic: float, cosine: float, nodes: int) -> list[float]:
    """The share of uniform light that each roughness returns; white."""
    n = len(ROUGHNESSES)
    material = BasecolorMetallicMaterial(
        albedo=torch.ones(3, 1, n),
        normal=ENCODED_UP[:, None, None].expand(3, 1, n).clone(),
        roughness=torch.tensor(ROUGHNESSES).reshape(1, 1, n),
        metallic=torch.full((1, 1, n), metallic),
    )
    view = torch.tensor([math.sqrt(1 - cosine * cosine), 0.0, cosine])
    x, w = np.polynomial.legendre.leggauss(nodes)
    total = torch.zeros(n)
    for mu, a in zip((x + 1) / 2, w / 2, strict=True):
        for phi, b in zip((x + 1) / 2 * math.pi, w * math.pi, strict=True):
            rho = math.sqrt(1 - mu * mu)
            light = torch.tensor([rho * math.cos(phi), rho * math.sin(phi), mu], dtype=torch.float32)
            power = torch.full((3,), DIM)
            total += model(material, view, light, power, None, False)[0, 0] * (a * b / DIM)
    return total.tolist()


def dome(size: int) -> tuple[Tensor, Tensor]:
    """Normals (3, size, 5 size) of five half spheres side by side, and where they are."""
    centre = (torch.arange(size) + 0.5) / size * 2.1 - 1.05
    y, x = torch.meshgrid(-centre, centre.repeat(5), indexing="ij")
    inside = x * x + y * y < 1
    z = (1 - x * x - y * y).clamp_min(1e-6).sqrt()
    normal = torch.where(inside, torch.stack([x, y, z]), torch.tensor([0.0, 0.0, 1.0])[:, None, None])
    return torch.nn.functional.normalize(normal, dim=0), inside


def pictures(size: int) -> dict[str, list[Tensor]]:
    """By model, rows (3, size, 5 size) of gold and of red paint; sRGB."""
    normal, inside = dome(size)
    rough = torch.tensor(ROUGHNESSES).repeat_interleave(size).expand(1, size, -1).clone()
    gold = Conductor.metal("Au")(torch.ones(())).clamp(0, 1)
    found: dict[str, list[Tensor]] = {"PyPBR": [], "all bounces": []}
    for colour, metallic in ((gold, 1.0), (torch.tensor([0.7, 0.08, 0.05]), 0.0)):
        material = BasecolorMetallicMaterial(
            albedo=colour[:, None, None].expand_as(normal).clone(),
            albedo_is_srgb=False,
            normal=normal,
            roughness=rough,
            metallic=torch.full_like(rough, metallic),
        )
        for name, model in (("PyPBR", Theirs), ("all bounces", Ours)):
            lit = model("directional")(
                material, torch.tensor([0.0, 0.0, 1.0]), torch.tensor([-0.35, 0.45, 0.8]), torch.full((3,), 2.4)
            )
            found[name].append(torch.where(inside, lit, 1.0))
    return found


def draw(shown: dict[str, list[Tensor]], rows: list[dict[str, Any]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.2), dpi=100, layout="constrained", width_ratios=(1.75, 1))
    lines = [line for pair in zip(*shown.values(), strict=True) for line in pair]
    left.imshow(torch.cat(lines, 1).movedim(0, -1).clamp(0, 1).numpy(), interpolation="nearest")
    size = lines[0].shape[1]
    left.set_xticks([size * (k + 0.5) for k in range(5)], [f"r = {r:g}" for r in ROUGHNESSES])
    left.set_yticks([size * (k + 0.5) for k in range(len(lines))], [*shown] * 2)
    left.tick_params(length=0)
    left.spines[:].set_visible(False)
    for row in rows:
        style = {"color": "#1f5fa8" if row["model"] == "all bounces" else "#c4572b"}
        style |= {"linestyle": "-" if row["metallic"] == 1 else "--", "marker": "o" if row["cosine"] == 1 else "s"}
        what = "metal" if row["metallic"] == 1 else "paint"
        right.plot(ROUGHNESSES, row["returned"], label=f"{row['model']}, {what}, N·V = {row['cosine']:g}", **style)
    right.axhline(1, color="#999999", linewidth=0.8, zorder=0)
    right.set(xlabel="roughness of PyPBR, which is α", title="light that a white surface returns", ylim=(0, None))
    right.spines[["top", "right"]].set_visible(False)
    right.legend(frameon=False, fontsize=7.5, ncol=2)
    figure.savefig(path, pil_kwargs={"optimize": True})
    plt.close(figure)


@torch.no_grad()
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=120, help="pixels of a dome")
    parser.add_argument("--nodes", type=int, default=40, help="of the furnace, along each axis")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for metallic in (1.0, 0.0):
        for cosine in COSINES:
            for name, model in (("PyPBR", Theirs), ("all bounces", Ours)):
                returned = furnace(model("directional"), metallic, cosine, options.nodes)
                row = {"model": name, "metallic": metallic, "cosine": cosine}
                rows.append(row | {"roughness": list(ROUGHNESSES), "returned": returned})
                print(f"{name}, metallic {metallic:g}, N.V {cosine:g}:", *(f"{x:.3f}" for x in returned), flush=True)
    save("pypbr", rows)
    draw(pictures(options.size), rows, FIGURE)


if __name__ == "__main__":
    main()
