"""The picture at the head of the README: gold and glass by one bounce and by all; three minutes of a core.

    python -m tools.hero [file]

What the camera sees on a rough sphere is a smooth function of the normal. Paths are traced for a pixel in four, and spherical
harmonics are fitted to them; the picture is that function, which has no grain, before a background of 16 rays a pixel. What the
fit leaves is printed in units of the paths' own standard errors: 1 means that nothing but their noise is left out.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

import torchms as ms
from tools.pictures import studio
from torchms.fresnel import Conductor, Dielectric
from torchms.render.camera import Camera
from torchms.render.images import filmic, srgb
from torchms.render.lights import Environment
from torchms.render.paths import Scene, radiance
from torchms.render.scenes import load_shape
from torchms.sampling.uniforms import generator_for
from torchms.storage.write import write_whole

SIZE = 512
DEGREE = 14
"""Of the harmonics: details down to 0.2 rad, a fraction of what either surface spreads."""


def tiles() -> dict[str, tuple[ms.BSDF, int]]:
    """Surface and paths a point of each tile; glass returns light from inside, which is noisier."""
    gold, glass = (ms.GGX(0.7), Conductor.metal("Au")), (ms.GGX(0.4), Dielectric(1.5))
    return {
        "gold, α = 0.7: one bounce": (ms.RoughConductor(*gold, ms.SingleBounce()), 24),
        "all bounces": (ms.RoughConductor(*gold, ms.Bidirectional(ms.Invariance(), 8)), 24),
        "glass, α = 0.4: one bounce": (ms.RoughDielectric(*glass, ms.SingleBounce()), 64),
        "all bounces ": (ms.RoughDielectric(*glass, ms.HeightWalk(6)), 64),
    }


def rays(camera: Camera, size: int) -> tuple[Tensor, Tensor]:
    """Through the centres of size² pixels."""
    x = (torch.arange(size) + 0.5) / size
    return camera.rays(x.repeat(size), x.repeat_interleave(size), 1.0)


def harmonics(normal: Tensor, towards: Tensor) -> Tensor:
    """All functions (n, (DEGREE + 1)²) on the sphere up to DEGREE: T_i(x) T_j(y) and z times those, z towards the camera."""
    z = torch.nn.functional.normalize(towards, dim=0)
    x = torch.nn.functional.normalize(torch.linalg.cross(torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64), z), dim=0)
    X, Y = (
        torch.cos(torch.arange(DEGREE + 1) * (normal @ axis).clamp(-1, 1).acos()[:, None])
        for axis in (x, torch.linalg.cross(z, x))
    )
    pairs = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    flat = torch.stack([X[:, i] * Y[:, j] for i, j in pairs], -1)
    lower = torch.tensor([i + j < DEGREE for i, j in pairs])
    return torch.cat([flat, flat[:, lower] * (normal @ z)[:, None]], -1)


def tile(name: str, scene: Scene, camera: Camera, paths: int) -> Tensor:
    """The picture (SIZE, SIZE, 3), linear."""
    origin, direction = rays(camera, SIZE // 2)
    hit = scene.shape.intersect(origin, direction).found
    origin, direction = origin[hit], direction[hit]
    sums, squares = torch.zeros(2, len(origin), 3, dtype=torch.float64)
    generator = generator_for(0)
    with torch.no_grad():
        for part in torch.arange(len(origin)).split(1 << 15):
            for _ in range(paths):
                value = radiance(scene, origin[part], direction[part], generator)
                sums[part] += value
                squares[part] += value * value
    mean = sums / paths
    error2 = (squares / paths - mean * mean) / (paths - 1)
    eye = torch.tensor(camera.eye, dtype=torch.float64)
    basis = harmonics(scene.shape.intersect(origin, direction).normal, eye)
    fitted = torch.linalg.lstsq(basis, mean, driver="gelsd").solution
    left = (mean - basis @ fitted).square().mean() / error2.mean() * len(basis) / (len(basis) - basis.shape[1])
    print(f"{name.strip()}: {paths} paths at {len(origin)} points, residual {float(left.sqrt()):.3f}", flush=True)
    origin, direction = rays(camera, 4 * SIZE)
    hits = scene.shape.intersect(origin, direction)
    picture = scene.light.radiance(direction)
    for part in hits.found.nonzero()[:, 0].split(1 << 18):
        picture[part] = harmonics(hits.normal[part], eye) @ fitted
    # Tone first, then the mean of a pixel's rays: a bright background does not eat the rim.
    shown = filmic(picture.clamp_min(0)).reshape(SIZE, 4, SIZE, 4, 3)
    return shown.mean((1, 3))


def sheet(shown: list[Tensor], names: list[str]) -> bytes:
    """Two rows of two pictures with their names, as PNG."""
    import io

    import matplotlib
    from PIL import Image, ImageDraw, ImageFont

    rows = [torch.cat(shown[i : i + 2], 1) for i in (0, 2)]
    pixels = (srgb(torch.cat(rows)) * 255).round().to(torch.uint8).numpy()
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    pen = ImageDraw.Draw(picture)
    # Pillow's own font has no α.
    font = ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), 20)
    for i, name in enumerate(names):
        pen.text((SIZE * (i % 2) + 12, SIZE * (i // 2) + 8), name.strip(), font=font, fill="white")
    content = io.BytesIO()
    picture.save(content, "PNG", optimize=True)
    return content.getvalue()


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/images/hero.png")
    shape, camera = load_shape("sphere", 30.0)
    light = Environment(studio(2048))
    shown = []
    for name, (surface, paths) in tiles().items():
        scene = Scene(shape, light, ms.compile(surface, verbose=False), "mis", 6)
        shown.append(tile(name, scene, camera, paths))
    write_whole(path, sheet(shown, [*tiles()]), force=True)


if __name__ == "__main__":
    main()
