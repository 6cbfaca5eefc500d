"""PyPBR's own model and material objects, against what takes their place."""

from importlib import import_module

import pytest
import torch
from torch import Tensor

from torchms.dropins.pypbr import CookTorranceBRDF

pytest.importorskip("pypbr", reason="needs PyPBR (pip install pypbr, which needs torchvision)")

SIZE = (12, 17)
EYE, POWER = torch.tensor([0.0, 0.2, 1.0]), torch.tensor([2.0, 1.8, 1.6])
LIGHTS = {"point": torch.tensor([0.2, 0.3, 0.8]), "directional": torch.tensor([0.3, -0.2, 1.0])}


def maps(generator: torch.Generator, roughest: float = 1.0) -> dict[str, Tensor]:
    def rand(channels: int, low: float = 0.0) -> Tensor:
        return low + (roughest - low) * torch.rand(channels, *SIZE, generator=generator)

    tilted = torch.tensor([0.0, 0.0, 1.0])[:, None, None] + 0.3 * (rand(3) - 0.5)
    return {"albedo": rand(3), "normal": torch.nn.functional.normalize(tilted, dim=0), "roughness": rand(1, 0.3)}


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("kind", ["metallic", "specular"])
def test_one_bounce_is_its_own(kind, light, generator):
    """In float64, which a material is given past its door; linear and in sRGB."""
    materials, models = (import_module(f"pypbr.{name}") for name in ("materials", "models"))
    make = materials.BasecolorMetallicMaterial if kind == "metallic" else materials.DiffuseSpecularMaterial
    given = maps(generator)
    material = make(**given, **{kind: torch.rand(1 if kind == "metallic" else 3, *SIZE, generator=generator)})
    material._maps = {name: x.double() for name, x in material._maps.items()}
    for srgb in (False, True):
        arguments = (material, EYE.double(), LIGHTS[light].double(), POWER.double(), 1.3, srgb)
        expected = models.CookTorranceBRDF(light)(*arguments)
        found = CookTorranceBRDF(light, bounces=1)(*arguments)
        assert found.shape == (3, *SIZE) and 0.01 < float(found.mean()) < 0.9
        torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-6)


def test_all_bounces_of_its_material(generator):
    """The same object, one changed line: a rough white metal returns more than PyPBR's model says, smooth paint as much."""
    materials, models = (import_module(f"pypbr.{name}") for name in ("materials", "models"))
    up = torch.tensor([0.0, 0.0, 1.0])
    for roughness, metallic, low, high in ((1.0, 1.0, 3.0, 5.0), (0.3, 0.0, 0.9, 1.1)):
        material = materials.BasecolorMetallicMaterial(
            albedo=torch.full((3, *SIZE), 0.99),
            # Theirs is read as (0, 0, 1): what is not negative is an encoded picture.
            normal=torch.tensor([0.5, 0.5, 1.0])[:, None, None].expand(3, *SIZE).clone(),
            roughness=torch.full((1, *SIZE), roughness),
            metallic=torch.full((1, *SIZE), metallic),
        )
        arguments = (material, up, torch.tensor([0.5, 0.0, 1.0]), torch.full((3,), 0.2), None, False)
        theirs, ours = (model("directional")(*arguments) for model in (models.CookTorranceBRDF, CookTorranceBRDF))
        assert low < float((ours / theirs).mean()) < high
