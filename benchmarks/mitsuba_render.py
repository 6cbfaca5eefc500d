"""Pictures in Mitsuba 3, its own plugins against torchms': `python benchmarks/mitsuba_render.py` (ten minutes on two cores).

Gold and glass spheres, and a Cornell box with both materials, by the path integrator in symbolic mode: the time of a picture
once its kernels are compiled, median of `--repetitions`, both in turns, by the clock and as the work of all processors; the
time of the first, compilation included; the mean of the picture.
`docs/images/mitsuba.png`: Mitsuba's own, torchms', and how far apart they are.
`--size 32 --spp 4` tries it in a minute.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from record import save

from torchms.mitsuba import set_variant
from torchms.render.images import write_picture

OURS = {"roughconductor": "torchms_conductor", "roughdielectric": "torchms_dielectric"}
GOLD = {"type": "roughconductor", "material": "Au", "distribution": "ggx", "alpha": 0.7}
GLASS = {"type": "roughdielectric", "int_ior": 1.5, "ext_ior": 1.0, "distribution": "ggx", "alpha": 0.4}


def with_plugins(thing: Any, names: dict[str, str]) -> Any:
    """A description of a scene with other plugins in it."""
    if not isinstance(thing, dict):
        return thing
    found = {key: with_plugins(value, names) for key, value in thing.items()}
    return found | ({"type": names[found["type"]]} if found.get("type") in names else {})


def sky(rows: int = 256) -> np.ndarray:
    """Radiance all around: a sky, tiles on the ground, and a lamp."""
    theta, phi = np.mgrid[0:rows, 0 : 2 * rows] * (np.pi / rows)
    y = np.cos(theta)
    scale = 1.5 / np.maximum(np.abs(y), 0.05)
    tiles = (np.floor(np.sin(theta) * np.sin(phi) * scale) + np.floor(np.sin(theta) * np.cos(phi) * scale)) % 2
    lamp = 15 * np.exp(-((phi - 3.6) ** 2 + (theta - 0.9) ** 2) / 0.03)
    gray = np.where(y < 0, 0.1 + 0.5 * tiles, 0.3 + 0.4 * y) + lamp
    return np.stack([gray, gray, 1.1 * gray], -1).astype(np.float32)


def spheres(mi: Any, film: dict[str, Any]) -> dict[str, Any]:
    """Gold and glass under an environment map."""
    view = mi.ScalarTransform4f().look_at([0, 1.1, 6.2], [0, 0, 0], [0, 1, 0])
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 12},
        "sensor": {"type": "perspective", "fov": 42, "to_world": view, "film": film},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky())},
        "gold": {"type": "sphere", "center": [-1.15, 0, 0], "bsdf": GOLD},
        "glass": {"type": "sphere", "center": [1.15, 0, 0], "bsdf": GLASS},
    }


def box(mi: Any, film: dict[str, Any]) -> dict[str, Any]:
    """Mitsuba's Cornell box with its boxes in gold and glass."""
    found = mi.cornell_box()
    found["sensor"]["film"] = film
    found["integrator"] = {"type": "path", "max_depth": 12}
    return found | {
        "large-box": found["large-box"] | {"bsdf": {"type": "twosided", "inner": GOLD}},
        "small-box": found["small-box"] | {"bsdf": GLASS},
    }


SCENES: dict[str, Callable[[Any, dict[str, Any]], dict[str, Any]]] = {"spheres": spheres, "box": box}


def rendered(mi: Any, scene: Any, spp: int, seed: int) -> tuple[np.ndarray, float, float]:
    """The picture, its seconds, and the processor's seconds of all threads, which other programs do not change."""
    start, worked = time.perf_counter(), time.process_time()
    picture = np.array(mi.render(scene, spp=spp, seed=seed))
    return picture, time.perf_counter() - start, time.process_time() - worked


def measured(mi: Any, name: str, size: int, spp: int, repetitions: int) -> tuple[dict[str, Any], list[np.ndarray]]:
    """One scene with both kinds of plugins, in turns."""
    film = {"type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    described = SCENES[name](mi, film)
    scenes = {"mitsuba": mi.load_dict(described), "torchms": mi.load_dict(with_plugins(described, OURS))}
    first = {who: rendered(mi, scene, spp, 0)[1] for who, scene in scenes.items()}
    times: dict[str, list[float]] = {who: [] for who in scenes}
    worked: dict[str, list[float]] = {who: [] for who in scenes}
    pictures: dict[str, list[np.ndarray]] = {who: [] for who in scenes}
    for repetition in range(repetitions):
        for who, scene in scenes.items():
            picture, seconds, processor = rendered(mi, scene, spp, repetition + 1)
            times[who].append(seconds)
            worked[who].append(processor)
            pictures[who].append(picture)
    row: dict[str, Any] = {"scene": name, "size": size, "spp": spp, "repetitions": repetitions}
    for who in scenes:
        row |= {f"{who}_first_s": first[who], f"{who}_s": median(times[who])}
        row |= {f"{who}_processor_s": median(worked[who]), f"{who}_mean": float(np.mean(pictures[who]))}
    row["ratio"] = row["torchms_s"] / row["mitsuba_s"]
    row["processor_ratio"] = row["torchms_processor_s"] / row["mitsuba_processor_s"]
    return row, [np.mean(pictures[who], 0) for who in scenes]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--picture", type=Path, default=Path(__file__).parents[1] / "docs" / "images" / "mitsuba.png")
    parser.add_argument("--out", type=Path, help="JSON file; benchmarks/results/mitsuba_render.json by default")
    options = parser.parse_args()
    try:
        mi = set_variant(options.variant)
    except ImportError as error:
        parser.error(str(error))
    rows, strips = [], []
    for name in SCENES:
        row, pictures = measured(mi, name, options.size, options.spp, options.repetitions)
        print(
            f"{name}: Mitsuba {row['mitsuba_s']:.2f} s, torchms {row['torchms_s']:.2f} s, {row['ratio']:.2f} x; "
            f"processor {row['mitsuba_processor_s']:.2f} and {row['torchms_processor_s']:.2f} s, "
            f"{row['processor_ratio']:.2f} x; "
            f"first {row['mitsuba_first_s']:.1f} and {row['torchms_first_s']:.1f} s; "
            f"means {row['mitsuba_mean']:.4f} and {row['torchms_mean']:.4f}"
        )
        rows.append(row | {"variant": options.variant})
        theirs, ours = pictures
        strips.append(np.concatenate([theirs, ours, np.abs(ours - theirs)], 1))
    write_picture(options.picture, torch.from_numpy(np.concatenate(strips, 0)), force=True)
    save("mitsuba_render", rows, options.out)


if __name__ == "__main__":
    main()
