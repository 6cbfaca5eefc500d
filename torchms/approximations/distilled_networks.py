"""What a file of distilled lobes may be about, and how large its networks are."""

from torchms.approximations import (
    diffuse_lobes,
    diffuse_surface_lobes,
    free_features,
    free_glass_features,
    glass_features,
    metal_features,
    metal_lobes,
    surface_lobes,
)
from torchms.approximations.distilled_file import Shape
from torchms.approximations.surface_correction import ORDERS

METAL = Shape(metal_features.FEATURES, metal_lobes.OUTPUTS, metal_features.OF_ONE, facets=metal_lobes.FACETS)
SMITHS = Shape(metal_features.FEATURES, surface_lobes.OF_SMITH, metal_features.OF_ONE)
DIFFUSE = Shape(diffuse_lobes.FEATURES, diffuse_lobes.OUTPUTS)
TRANSMITTED = Shape(glass_features.TRANSMITTED, 1, glass_features.OF_ONE)
GLASS = Shape(glass_features.REFLECTED, 1, glass_features.OF_ONE, through=TRANSMITTED)
NETWORKS = {
    "metal": METAL,
    "diffuse": DIFFUSE,
    "reflected": Shape(glass_features.REFLECTED, 1, glass_features.OF_ONE),
    "transmitted": TRANSMITTED,
    "gaussian": Shape(metal_features.FEATURES, surface_lobes.OUTPUTS, metal_features.OF_ONE, ORDERS, SMITHS),
    "scan": Shape(free_features.FREE, surface_lobes.OUTPUTS, free_features.FREE_OF_ONE, ORDERS, SMITHS, True),
    "gaussian_diffuse": Shape(
        metal_features.FEATURES, diffuse_surface_lobes.OUTPUTS, metal_features.OF_ONE, ORDERS, DIFFUSE
    ),
    "scan_diffuse": Shape(
        free_features.FREE, diffuse_surface_lobes.OUTPUTS, free_features.FREE_OF_ONE, ORDERS, DIFFUSE, True
    ),
    "gaussian_glass": Shape(
        *(glass_features.REFLECTED, ORDERS, glass_features.OF_ONE, ORDERS, GLASS),
        through=Shape(glass_features.TRANSMITTED, ORDERS, glass_features.OF_ONE, ORDERS),
    ),
    "scan_glass": Shape(
        *(free_glass_features.FREE_REFLECTED, ORDERS, free_glass_features.FREE_OF_ONE, ORDERS, GLASS, True),
        through=Shape(free_glass_features.FREE_TRANSMITTED, ORDERS, free_glass_features.FREE_OF_ONE, ORDERS),
    ),
}
"""What a file may be about. Glass takes both of "reflected" and "transmitted"."""
