"""From options to files: pictures on disk, and what is said about options that do not fit."""

import sys

import pytest
import torch
import trimesh

from torchms import GGX, RoughConductor, RoughDielectric
from torchms.cli.expression import parse_bsdf
from torchms.cli.options import RenderOptions
from torchms.cli.render import run_render
from torchms.render.camera import Camera
from torchms.render.film import render
from torchms.render.images import linear, read_picture, srgb, write_picture
from torchms.render.lights import ConstantLight, DirectionalLight, Environment
from torchms.render.scenes import load_shape

SMALL = {"width": 12, "height": 9, "samples": 2}
SINGLE = "RoughConductor(GGX(0.3), Ideal(), SingleBounce())"


def test_exr_keeps_every_bit_and_png_every_level(tmp_path, generator):
    """Linear numbers of any size in EXR; sRGB in PNG, to half a level."""
    pixels = torch.rand(5, 7, 3, generator=generator) * 100
    write_picture(tmp_path / "a.exr", pixels)
    assert torch.equal(read_picture(tmp_path / "a.exr"), pixels)
    pixels = pixels / 100
    write_picture(tmp_path / "a.png", pixels)
    back = srgb(read_picture(tmp_path / "a.png"))
    torch.testing.assert_close(back, srgb(pixels), rtol=0, atol=0.5 / 255 + 1e-6)
    torch.testing.assert_close(linear(srgb(pixels)), pixels, rtol=1e-4, atol=1e-6)
    write_picture(tmp_path / "b.png", pixels / 4, exposure=2.0)
    assert torch.equal(read_picture(tmp_path / "b.png"), read_picture(tmp_path / "a.png"))
    write_picture(tmp_path / "c.png", pixels * 50, tone="filmic")
    assert read_picture(tmp_path / "c.png").max() <= 1


@pytest.mark.parametrize("module,suffix", [("PIL", ".png"), ("OpenEXR", ".exr")])
def test_what_writes_pictures_is_named_where_it_is_missing(module, suffix, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf'{suffix} file needs \w+: pip install "torchms\[render\]"'):
        write_picture(tmp_path / f"a{suffix}", torch.zeros(2, 3, 3))


def test_pictures_with_one_channel_or_none(tmp_path):
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    for name, channel in (("grey", "Y"), ("depth", "Z")):
        with OpenEXR.File(header, {channel: torch.full((2, 3), 0.5).numpy()}) as file:
            file.write(str(tmp_path / f"{name}.exr"))
    assert read_picture(tmp_path / "grey.exr").shape == (2, 3, 3)
    with pytest.raises(ValueError, match="has no channels R, G and B; it has Z"):
        read_picture(tmp_path / "depth.exr")
    (tmp_path / "text.png").write_text("not a picture")
    (tmp_path / "text.exr").write_text("not a picture")
    for name in ("text.png", "text.exr"):
        with pytest.raises(ValueError, match=f"{name} cannot be read"):
            read_picture(tmp_path / name)


def test_render_writes_what_render_gives(tmp_path, capsys):
    """The picture, its standard error, and one line about them; the same files again only with --force."""
    out, stderr = str(tmp_path / "a.exr"), str(tmp_path / "e.exr")
    options = dict(scene="slab", out=out, bsdf=SINGLE, stderr=stderr, seed=5, **SMALL)
    run_render(RenderOptions(**options))
    assert "12 x 9 pixels, 2 rays each" in capsys.readouterr().out
    shape, camera = load_shape("slab")
    from torchms.render.paths import Scene

    light = DirectionalLight((-0.3, 1.0, 0.1))
    picture = render(Scene(shape, light, parse_bsdf(SINGLE)), camera, **SMALL, seed=5)
    assert torch.equal(read_picture(out), picture.mean) and torch.equal(read_picture(stderr), picture.stderr)
    assert picture.mean.max() > 0
    with pytest.raises(FileExistsError, match="--force"):
        run_render(RenderOptions(**options))
    run_render(RenderOptions(**{**options, "force": True}))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.exr", "e.exr"]


def test_every_kind_of_scene_and_light(tmp_path):
    """Mesh files, maps, glass, exposure and the filmic curve."""
    trimesh.creation.torus(1.0, 0.3).export(tmp_path / "torus.ply")
    write_picture(tmp_path / "sky.exr", torch.rand(4, 8, 3, generator=torch.Generator().manual_seed(1)))
    for i, change in enumerate(
        (
            {"scene": str(tmp_path / "torus.ply"), "light": str(tmp_path / "sky.exr"), "tone": "filmic"},
            {"scene": "sphere", "bsdf": "RoughDielectric(Beckmann(0.2), Dielectric(1.5))", "light": "constant"},
            {
                "scene": "plane",
                "bsdf": "RoughDiffuse(GGX(0.5), [0.8, 0.5, 0.2])",
                "exposure": 1.0,
                "eye": (0.0, 2.0, 0.1),
            },
        )
    ):
        run_render(RenderOptions(**{"bsdf": SINGLE, "out": str(tmp_path / f"{i}.png"), **SMALL, **change}))
        assert read_picture(tmp_path / f"{i}.png").max() > 0


def test_expressions():
    """What the constructors take, and nothing else."""
    bsdf = parse_bsdf(
        "RoughConductor(GGX(0.3, alpha_y=0.1), Conductor([0.2, 0.9, 1.1], k=3.9), Bidirectional(Invariance(), 3))"
    )
    assert (
        isinstance(bsdf, RoughConductor)
        and bsdf.max_order == 3
        and float(bsdf.distribution.alpha_y) == pytest.approx(0.1)
    )
    assert isinstance(parse_bsdf(" RoughDielectric(GGX(0.3), Dielectric(1.5), mode='importance')"), RoughDielectric)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("RoughConductor(", "was never closed"),
        ("GGX(0.3)", "it is a GGX, not a BSDF"),
        ("0.3", "it is a float, not a BSDF"),
        ("RoughConductor(GGX(x), Ideal())", "'x' is neither a number"),
        ("RoughConductor(GGX(0.3), Conductor.lookup('Au'))", "'Conductor.lookup' is not a constructor"),
        ("__import__('os').system('true')", "is not a constructor"),
        ("RoughConductor(*[GGX(0.3), Ideal()])", "is neither a number"),
        ("RoughConductor(**GGX(0.3))", "cannot be used here"),
        ("RoughConductor(GGX(0.3), Conductor.metal('unobtainium'))", "unobtainium"),
        ("RoughConductor(GGX(7.0), Ideal())", r"must lie in \[0.001, 2\]"),
    ],
)
def test_expressions_that_are_refused(text, says, messages):
    with pytest.raises(ValueError, match=says):
        parse_bsdf(text)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"scene": "cube"}, "neither a file nor one of slab, sphere, plane"),
        ({"scene": "{tmp}/text.obj"}, "holds no triangles|could not be read"),
        ({"scene": "{tmp}/text.xyzzy"}, r"must end in one of \.ply, \.obj"),
        ({"light": "sun"}, "--light must be directional, constant or a picture"),
        ({"light": "{tmp}/black.exr"}, "bright somewhere"),
        ({"intensity": 0.0}, "--intensity must be positive"),
        ({"towards_light": (0.0, 0.0, 0.0)}, "must be a direction"),
        ({"out": "{tmp}/a.jpg"}, "must end in .exr or .png"),
        ({"stderr": "{tmp}/a.png"}, "must be two files"),
        ({"samples": 1}, "samples must be at least 2"),
        ({"width": 0}, "width must be at least 1"),
        ({"inner": 0}, "inner must be at least 1"),
        ({"fov": 200.0}, r"must lie in \(0, 180\)"),
        ({"eye": (0.0, 0.0, 0.0)}, "must be two points"),
        ({"scene": "plane", "bsdf": "RoughDielectric(GGX(0.2), Dielectric(1.5))"}, "needs a closed mesh"),
        ({"bsdf": "RoughDiffuse(GGX(0.2), [0.1, 0.2])"}, "1 or 3 channels; got 2"),
    ],
)
def test_options_that_do_not_fit(change, says, tmp_path, messages):
    """One line that names the option and the remedy; nothing is written."""
    (tmp_path / "text.obj").write_text("nothing to see here\n")
    (tmp_path / "text.xyzzy").write_text("nothing to see here\n")
    write_picture(tmp_path / "black.exr", torch.zeros(2, 4, 3))
    before = sorted(tmp_path.iterdir())
    options = {"scene": "slab", "out": str(tmp_path / "a.png"), "bsdf": SINGLE, **SMALL}
    options |= {k: v.replace("{tmp}", str(tmp_path)) if isinstance(v, str) else v for k, v in change.items()}
    with pytest.raises(ValueError, match=says):
        run_render(RenderOptions(**options))
    assert sorted(tmp_path.iterdir()) == before


def test_maps_that_are_none(messages):
    for texels, says in (
        (torch.ones(2, 2), r"must be \(rows, columns, 3\)"),
        (-torch.ones(2, 2, 3), "not negative"),
        (torch.full((2, 2, 3), float("nan")), "finite"),
    ):
        with pytest.raises(ValueError, match=says):
            Environment(texels)


def test_a_map_of_parameters_is_refused(scene):
    bsdf = RoughConductor(GGX(torch.rand(4) + 0.1), parse_bsdf(SINGLE).fresnel)
    with pytest.raises(ValueError, match="scalar parameters"):
        render(scene("sphere", ConstantLight(), bsdf), Camera((0.0, 0.0, 3.0)), **SMALL)


def test_gltfs_material_by_name(tmp_path):
    """--base-color is the surface that --bsdf would say in Python; it goes with no other description."""
    given = SMALL | {"scene": "sphere", "light": "constant"}
    short, long = str(tmp_path / "short.exr"), str(tmp_path / "long.exr")
    run_render(RenderOptions(out=short, base_color=(0.9, 0.5, 0.2), roughness=0.7, **given))
    run_render(RenderOptions(out=long, bsdf="MetallicRoughness([0.9, 0.5, 0.2], 0.0, 0.7)", **given))
    assert torch.equal(read_picture(short), read_picture(long)) and read_picture(short).max() > 0
    for wrong, says in (
        ({"base_color": (1.0, 1.0, 1.0), "alpha": "0.2"}, "leave out --alpha"),
        ({"base_color": (1.0, 1.0, 1.0), "scattering": "turquin"}, "leave out --scattering"),
        ({"metallic": 0.5}, "--metallic goes with --base-color"),
        ({"base_color": (1.2, 0.0, 0.0)}, r"base_color=.*\[0, 1\]; got 1.2"),
    ):
        with pytest.raises(ValueError, match=says):
            run_render(RenderOptions(out=str(tmp_path / "no.exr"), **(given | wrong)))
