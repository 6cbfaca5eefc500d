"""`torchms render`: from options to files."""

import math
from dataclasses import replace

from torchms.bsdfs import BSDF, MetallicRoughness
from torchms.cli.beforehand import is_given
from torchms.cli.description import SHORT, modelled
from torchms.cli.expression import parse_bsdf
from torchms.cli.options import RenderOptions
from torchms.render.film import render
from torchms.render.images import check_picture, read_picture, write_picture
from torchms.render.lights import ConstantLight, DirectionalLight, Environment, Light
from torchms.render.paths import Scene
from torchms.render.scenes import load_shape


def build_light(options: RenderOptions) -> Light:
    """The light that the options describe; ValueError if they describe none."""
    if not (math.isfinite(options.intensity) and options.intensity > 0):
        raise ValueError(f"--intensity must be positive; got {options.intensity:g}.")
    if options.light == "directional":
        return DirectionalLight(options.towards_light, options.intensity)
    if options.light == "constant":
        return ConstantLight(options.intensity)
    try:
        return Environment(read_picture(options.light) * options.intensity)
    except ValueError as error:
        raise ValueError(f"--light must be directional, constant or a picture (.exr, .png): {error}") from None


GOLD = 'RoughConductor(GGX(0.3), Conductor.metal("Au"), Bidirectional(Invariance(), max_order=8))'
"""What is rendered if nothing is said of the surface."""


def build_bsdf(options: RenderOptions) -> BSDF:
    """The BSDF that the options describe; ValueError if they do not fit together."""
    own = {name: getattr(options, name) for name in ("metallic", "roughness") if getattr(options, name) is not None}
    if options.base_color is not None:
        others = ("bsdf", *SHORT, "scattering", "max_order")
        if named := [f"--{name.replace('_', '-')}" for name in others if is_given(options, name)]:
            raise ValueError(f"--base-color says what the surface is, with all bounces: leave out {', '.join(named)}.")
        return MetallicRoughness(list(options.base_color), own.get("metallic", 0.0), own.get("roughness", 0.5))
    if own:
        raise ValueError(f"{' and '.join(f'--{name}' for name in own)} goes with --base-color.")
    if options.bsdf is None and not any(is_given(options, name) for name in (*SHORT, "scattering", "max_order")):
        return parse_bsdf(GOLD)
    return modelled(options, glass="height-walk", opaque="bidirectional-invariance")


def run_render(options: RenderOptions) -> None:
    """Render and write the files. Raises ValueError for options that do not fit, before anything is computed."""
    files = [options.out] + ([] if options.stderr is None else [options.stderr])
    for file in files:
        check_picture(file, options.force)
    if len(set(files)) < len(files):
        raise ValueError(f"--out and --stderr must be two files; both are {options.out}.")
    bsdf = build_bsdf(options)
    light = build_light(options)
    shape, camera = load_shape(options.scene, options.crease)
    camera = replace(
        camera,
        fov=options.fov,
        **({} if options.eye is None else {"eye": options.eye}),
        **({} if options.target is None else {"target": options.target}),
    )
    scene = Scene(shape, light, bsdf, options.sampling, options.inner, options.background == "light")
    picture = render(
        scene, camera, width=options.width, height=options.height, samples=options.samples, seed=options.seed
    )
    pictures = [picture.mean, picture.stderr][: len(files)]
    for file, pixels in zip(files, pictures, strict=True):
        write_picture(file, pixels, exposure=options.exposure, tone=options.tone, force=options.force)
    print(
        f"{', '.join(files)}: {options.width} x {options.height} pixels, {options.samples} rays each, "
        f"mean radiance {float(picture.mean.mean()):.4g}, standard error of a pixel "
        f"{float(picture.stderr.square().mean().sqrt()):.2g} (rms)"
    )
