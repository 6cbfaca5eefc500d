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
    """Two rows a material: target, first and last pictures; α maps with their errors, and the loss."""
    plt.rcParams.update({"font.size": 10, "text.color": INK, "axes.labelcolor": INK, "axes.titlesize": 10})
    figure, axes = plt.subplots(
        2 * len(shown), 4, figsize=(9, 4.6 * len(shown)), dpi=110, layout="constrained", squeeze=False
    )
    for (name, s), upper, lower in zip(shown.items(), axes[::2], axes[1::2], strict=True):
        _pictures(upper, name, s)
        _maps(lower[:3], s, truth)
        _losses(lower[3], s)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, pil_kwargs={"optimize": True})
    plt.close(figure)


def _pictures(axes: Any, name: str, s: dict[str, Any]) -> None:
    both, single = s["all bounces"], s["single bounce"]
    images = (s["target"], both["first"], both["last"], single["last"])
    titles = (f"{name}: target", "start of the fit", "found, all bounces", "found, single bounce")
    for axis, image, title in zip(axes, images, titles, strict=True):
        axis.imshow(srgb(image).numpy(), interpolation="nearest")
        axis.set_title(title)
        axis.axis("off")


def _maps(axes: Any, s: dict[str, Any], truth: Tensor) -> None:
    alphas = (truth, s["all bounces"]["alpha"], s["single bounce"]["alpha"])
    titles = ("α, truth", "α, all bounces", "α, single bounce")
    for axis, alpha, title in zip(axes, alphas, titles, strict=True):
        seen = torch.where(s["seen"], alpha, torch.nan)
        low, high = float(truth.min()), float(truth.max())
        axis.imshow(seen.numpy(), cmap="viridis", vmin=low, vmax=high, interpolation="nearest")
        error = float(((alpha - truth) / truth)[s["seen"]].abs().mean())
        axis.set_title(title if alpha is truth else f"{title}\nmean error {100 * error:.1f} %")
        axis.set(xticks=[], yticks=[])
    axes[0].figure.colorbar(axes[0].images[0], ax=list(axes), location="bottom", fraction=0.06, aspect=40)


def _losses(axis: Any, s: dict[str, Any]) -> None:
    for (model, colour), dashes in zip(COLOURS.items(), ("-", "--"), strict=True):
        losses = s[model]["losses"]
        smooth = losses[: len(losses) // 20 * 20].reshape(-1, 20).mean(1)
        axis.plot(torch.arange(len(smooth)) * 20, smooth, dashes, color=colour, label=model, linewidth=1.4)
    axis.set_yscale("symlog", linthresh=1e-4)
    # An estimate without bias of something near zero: below it as often as above.
    axis.set_title("squared relative error,\nmean of 20 steps")
    axis.set_xlabel("step")
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False, fontsize=9, loc="upper right")
