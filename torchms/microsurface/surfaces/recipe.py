"""A recipe for several independent surfaces, which a simulation makes one at a time."""

from dataclasses import dataclass

from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.microsurface.surfaces.synthesis import check_resolution, checked_alpha


@dataclass(frozen=True)
class GaussianSurfaces:
    """Recipe for `count` independent surfaces `Heightfield.gaussian(alpha, alpha_y, ...)`, seeded by the simulation."""

    alpha: float | int
    alpha_y: float | int | None = None
    count: int = 8
    size: int = 1024
    texels_per_correlation: float | int = 16.0

    def __post_init__(self) -> None:
        ax = checked_alpha(self.alpha, "GaussianSurfaces(alpha=...)")
        ay = ax if self.alpha_y is None else checked_alpha(self.alpha_y, "GaussianSurfaces(alpha_y=...)")
        if self.count < 1:
            raise ValueError(
                f"GaussianSurfaces(count=...) must be at least 1; got {self.count}. Standard errors need 2 or more."
            )
        check_resolution(max(ax, ay), self.size, self.texels_per_correlation)

    def surface(self, seed: int) -> Heightfield:
        """The surface of one seed."""
        return Heightfield.gaussian(
            self.alpha,
            self.alpha_y,
            size=self.size,
            texels_per_correlation=self.texels_per_correlation,
            seed=seed,
        )
