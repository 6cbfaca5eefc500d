"""Inverse rendering in Mitsuba
============================

Inverse rendering inside Mitsuba 3: base colour and roughness of a metal body under an environment map, as maps.

::

    python examples/mitsuba_inverse.py --out maps.png

The pictures are of `torchms_metallic_roughness` with all bounces, from several sides. They are fitted twice, with all bounces
and with one, by `prb` and Adam: what a model leaves out ends up in the maps. maps.png: the truth, all bounces, one bounce;
base colour above, roughness below.
"""
# sphinx_gallery_thumbnail_path = "images/mitsuba_inverse.png"

import argparse
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchms.mitsuba import set_variant
from torchms.render.images import write_picture

COLOR, ROUGHNESS = "body.bsdf.base_color.data", "body.bsdf.roughness.data"


def true_maps(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Base colour (size, size, 3) and roughness (size, size, 1) over the body: stripes of gold and copper, and patches."""
    v, u = (np.mgrid[0:size, 0:size] + 0.5) / size
    stripe = (0.5 + 0.5 * np.sin(4 * np.pi * u))[..., None]
    color = stripe * np.array([1.0, 0.78, 0.34]) + (1 - stripe) * np.array([0.95, 0.6, 0.5])
    return color.astype(np.float32), (0.75 + 0.2 * np.cos(2 * np.pi * v) * np.sin(2 * np.pi * u))[..., None].astype(
        np.float32
    )


def sky() -> np.ndarray:
    """Radiance (rows, columns, 3): bright above, a wide lamp on one side."""
    y, x = np.mgrid[0:32, 0:64] / 32
    gray = 0.4 + 0.4 * (1 - y) + 8 * np.exp(-((x - 0.5) ** 2 + (y - 0.4) ** 2) / 0.02)
    return np.stack([gray, gray, 1.1 * gray], -1).astype(np.float32)


def body(mi: Any, bsdf: dict[str, Any]) -> Any:
    """A wavy ball as a mesh, with texture coordinates."""
    rows, columns = 48, 96
    t, p = np.mgrid[0 : rows + 1, 0 : columns + 1]
    theta, phi = np.pi * (t + 1e-3) / (rows + 2e-3), 2 * np.pi * p / columns
    radius = 1 + 0.12 * np.sin(3 * phi) * np.sin(theta) ** 3
    at = radius * np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)])
    i = (t * (columns + 1) + p)[:-1, :-1].ravel()
    one, other = (np.stack([i, i + a, i + b], -1) for a, b in ((1, columns + 2), (columns + 2, columns + 1)))
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    mesh = mi.Mesh("body", t.size, 2 * i.size, props=props, has_vertex_normals=True, has_vertex_texcoords=True)
    shown = mi.traverse(mesh)
    shown["vertex_positions"] = mi.Float(at.reshape(3, -1).T.ravel().astype(np.float32))
    shown["vertex_texcoords"] = mi.Float(np.stack([p / columns, t / rows], -1).ravel().astype(np.float32))
    shown["faces"] = mi.UInt32(np.concatenate([one, other]).ravel().astype(np.uint32))
    shown.update()
    mesh.recompute_vertex_normals()
    return mesh


def scene(mi: Any, maps: Iterable[np.ndarray], bounces: str) -> Any:
    """The body under the sky."""
    textures = [{"type": "bitmap", "data": mi.TensorXf(x), "raw": True} for x in maps]
    bsdf = {"type": "torchms_metallic_roughness", "metallic": 1.0, "bounces": bounces}
    bsdf |= {"base_color": textures[0], "roughness": textures[1]}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "prb", "max_depth": 3},
            "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky())},
            "body": body(mi, bsdf),
        }
    )


def cameras(mi: Any, n: int, size: int) -> list[Any]:
    """Views from all around."""
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    found = []
    for turn in 2 * np.pi * np.arange(n) / n:
        view = mi.ScalarTransform4f().look_at([5 * np.sin(turn), 1.5, 5 * np.cos(turn)], [0, 0, 0], [0, 1, 0])
        found.append(mi.load_dict({"type": "perspective", "fov": 28, "to_world": view, "film": film}))
    return found


def fit(mi: Any, targets: list[Any], views: list[Any], bounces: str, options: argparse.Namespace) -> list[np.ndarray]:
    """The maps that the pictures are of, if that is how the material scatters; one view a step."""
    dr = import_module("drjit")
    start = (np.full((options.texels, options.texels, c), x, np.float32) for c, x in ((3, 0.7), (1, 0.6)))
    found = scene(mi, start, bounces)
    shown = mi.traverse(found)
    shown.keep([COLOR, ROUGHNESS])
    adam = mi.ad.Adam(lr=0.02, params=shown)
    shown.update(adam)
    for step in range(options.steps):
        k = step % len(views)
        picture = mi.render(found, shown, sensor=views[k], spp=options.spp, seed=step)
        # Relative to how bright it is: highlights are not all that counts.
        dr.backward(dr.mean(dr.square((picture - targets[k]) / (targets[k] + 0.1)), axis=None))
        adam.step()
        adam[COLOR], adam[ROUGHNESS] = dr.clip(adam[COLOR], 0.01, 1), dr.clip(adam[ROUGHNESS], 0.1, 1)
        shown.update(adam)
    return [np.array(shown[key]) for key in (COLOR, ROUGHNESS)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("maps.png"))
    parser.add_argument("--size", type=int, default=96, help="pixels of a picture's side")
    parser.add_argument("--texels", type=int, default=32)
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    options = parser.parse_args()
    try:
        mi = set_variant(options.variant)
    except ImportError as error:
        parser.error(str(error))
    truth, views = true_maps(options.texels), cameras(mi, options.views, options.size)
    real = scene(mi, truth, "all")
    targets = [mi.render(real, sensor=view, spp=16 * options.spp, seed=1000 + k) for k, view in enumerate(views)]
    columns = [list(truth)]
    # What no view shows of the poles says nothing.
    rows = slice(options.texels // 4, -(options.texels // 4))
    for bounces in ("all", "one"):
        maps = fit(mi, targets, views, bounces, options)
        color, rough = (np.abs(a - b)[rows].mean() for a, b in zip(maps, truth, strict=True))
        print(f"bounces: {bounces}; mean error of the base colour {color:.3f}, of roughness {rough:.3f}")
        columns.append(maps)
    strips = [np.concatenate([c, np.repeat(r, 3, -1)], 0).repeat(4, 0).repeat(4, 1) for c, r in columns]
    write_picture(options.out, torch.from_numpy(np.concatenate(strips, 1)), force=True)


if __name__ == "__main__":
    main()
