"""The picture of `fit.py`: what was seen, what was found, and what single bounces would have found."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import torch
from torch import Tensor

from torchms.render.images import srgb

INK = "#222222"
COLOURS = {"all bounces": "#1f5fa8", "single bounce": "#c4572b"}


def draw(shown: dict[str, dict[str, Any]], truth: Tensor, path: Path) -> None:
    """One row a material: target, first and last image, α maps with their errors, loss."""
    plt.rcParams.update({"font.size": 9, "text.color": INK, "axes.labelcolor": INK, "axes.titlesize": 9})
    figure, axes = plt.subplots(
        len(shown), 8, figsize=(15, 2.25 * len(shown)), dpi=100, layout="constrained", squeeze=False
    )
    for line, (name, s) in zip(axes, shown.items(), strict=True):
        both, single = s["all bounces"], s["single bounce"]
        for axis, image, title in (
            (line[0], s["target"], f"{name}: target"),
            (line[1], both["first"], "first"),
            (line[2], both["last"], "last, all bounces"),
            (line[3], single["last"], "last, single bounce"),
        ):
            axis.imshow(srgb(image).numpy(), interpolation="nearest")
            axis.set_title(title)
            axis.axis("off")
        low, high = float(truth.min()), float(truth.max())
        for axis, alpha, title in (
            (line[4], truth, "α, truth"),
            (line[5], both["alpha"], "α found, all bounces"),
            (line[6], single["alpha"], "α found, single bounce"),
        ):
            seen = torch.where(s["seen"], alpha, torch.nan)
            drawn = axis.imshow(seen.numpy(), cmap="viridis", vmin=low, vmax=high, interpolation="nearest")
            error = float(((alpha - truth) / truth)[s["seen"]].abs().mean())
            axis.set_title(title if alpha is truth else f"{title}\nmean error {100 * error:.1f} %")
            axis.set(xticks=[], yticks=[])
        figure.colorbar(drawn, ax=line[6], fraction=0.04)
        axis = line[7]
        for model, colour in COLOURS.items():
            losses = s[model]["losses"]
            smooth = losses[: len(losses) // 20 * 20].reshape(-1, 20).mean(1)
            axis.plot(torch.arange(len(smooth)) * 20, smooth, color=colour, label=model, linewidth=1.2)
        axis.set_yscale("symlog", linthresh=1e-4)
        # An estimate without bias of something near zero: below it as often as above.
        axis.set_title("squared relative error,\nestimate of 20 steps")
        axis.set_xlabel("step")
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.3), ncol=2, columnspacing=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, pil_kwargs={"optimize": True})
    plt.close(figure)
