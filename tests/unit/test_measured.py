"""Files of measured BRDFs: what is inside, whatever somebody did to them, and the functions on grids that they hold."""

import math
import re
import struct

import numpy as np
import pytest
import torch
from cases import direction, directions
from hostile import damaged

from torchms.measured import MeasuredBRDF, read_tensor_file
from torchms.measured.grid import Density, Stack, bilinear
from torchms.measured.tensor_file import TYPES

NUMBER = {np.dtype(kind): number for number, kind in TYPES.items()}


def written(fields: dict, version: tuple[int, int] = (1, 0), count: int | None = None) -> bytes:
    """A tensor_file with these fields; a tuple is an array and the shape that the file promises instead."""
    pairs = {name: f if isinstance(f, tuple) else (f, f.shape) for name, f in fields.items()}
    size = 18 + sum(2 + len(name) + 11 + 8 * len(shape) for name, (_, shape) in pairs.items())
    head = b"tensor_file\0" + struct.pack("<BBI", *version, len(fields) if count is None else count)
    body = b""
    for name, (array, shape) in pairs.items():
        head += struct.pack("<H", len(name)) + name.encode()
        head += struct.pack(f"<HBQ{len(shape)}Q", len(shape), NUMBER[array.dtype], size + len(body), *shape)
        body += array.tobytes()
    return head + body


def surface(n: int = 3) -> dict[str, np.ndarray]:
    """The fields of a small isotropic surface."""
    rng = np.random.default_rng(1)

    def grid(*shape: int) -> np.ndarray:
        return rng.uniform(0.2, 1.0, shape).astype(np.float32)

    fields = {
        "description": np.frombuffer(b"a test", np.uint8),
        "phi_i": np.zeros(1, np.float32),
        "theta_i": np.linspace(0, math.pi / 2, n, dtype=np.float32),
        "sigma": np.repeat(grid(1, 5), 2, 0),
        "ndf": np.repeat(grid(1, 5), 2, 0),
        "vndf": grid(1, n, 5, 6),
        "rgb": grid(1, n, 3, 4, 4),
        "jacobian": np.ones(1, np.uint8),
    }
    return fields


def stored(tmp_path, content: bytes) -> str:
    path = tmp_path / "some.bsdf"
    path.write_bytes(content)
    return str(path)


def test_fields_come_back(tmp_path):
    """Of every type and any shape."""
    fields = {f"f{number}": np.arange(6, dtype=kind).reshape(1, 2, 3) for number, kind in TYPES.items()}
    found = read_tensor_file(stored(tmp_path, written(fields)))
    assert found.keys() == fields.keys()
    for name, array in fields.items():
        assert found[name].dtype == array.dtype and np.array_equal(found[name], array)


def test_damaged_files_are_refused_or_read(tmp_path, seed):
    """Cut and flipped anywhere: a ValueError that names the file, or a BRDF of finite numbers; never anything else."""
    for content in damaged(written(surface()), seed):
        path = stored(tmp_path, content)
        try:
            brdf = MeasuredBRDF.load(path)
        except ValueError as error:
            assert "some.bsdf" in str(error)
        else:
            assert bool(brdf(direction(0.3).float(), direction(0.5).float()).isfinite().all())


HOSTILE = {
    "another file": (b"PK\3\4" + bytes(60), "does not start with its name"),
    "nothing": (b"", "does not start with its name"),
    "a version of tomorrow": (written({}, version=(2, 0)), r"version 2\.0"),
    "many fields": (written({}, count=1 << 31), "2147483648 fields"),
    "a huge field": (written({"a": (np.zeros(1, np.float32), (1 << 40, 1 << 40))}), "'a'.*not inside"),
    "a field beyond the end": (written({"a": (np.zeros(4, np.float32), (5,))}), "'a'.*not inside"),
    "an unknown type": (written({"a": np.zeros(1, np.float32)}).replace(b"a\x01\x00\x0a", b"a\x01\x00\x63"), "type 99"),
    "many axes": (written({"a": np.zeros((1,) * 9, np.float32)}), "9 axes"),
    "a field twice": (
        written({"a": np.zeros(1, np.float32), "b": np.zeros(1, np.float32)}).replace(b"b", b"a"),
        "twice",
    ),
    "a field in the header": (
        written({"a": np.zeros(1, np.float32)}).replace(struct.pack("<Q", 40), struct.pack("<Q", 0)),
        "not inside",
    ),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_hostile_files(what, tmp_path):
    content, message = HOSTILE[what]
    with pytest.raises(ValueError, match=rf"some.bsdf is no tensor_file, or a damaged one: .*{message}"):
        read_tensor_file(stored(tmp_path, content))


def test_a_file_that_is_not_there(tmp_path, messages):
    with pytest.raises(FileNotFoundError, match=r"there is no file .*no\.bsdf\. Files of measured surfaces are at"):
        MeasuredBRDF.load(tmp_path / "no.bsdf")


def without(key: str) -> dict:
    return {name: field for name, field in surface().items() if name != key}


SPOILT = {
    "spectral": (without("rgb") | {"spectra": np.zeros(1, np.float32)}, r"spectral.*_rgb\.bsdf"),
    "no ndf": (without("ndf"), "lacks ndf"),
    "anisotropic": (surface() | {"phi_i": np.zeros(8, np.float32)}, "anisotropic, with 8 azimuths"),
    "other angles": (surface() | {"theta_i": np.linspace(0, 1, 4, dtype=np.float32)}, r"'vndf' is \(1, 3, 5, 6\)"),
    "NaN": (surface() | {"ndf": np.full((2, 5), np.nan, np.float32)}, "'ndf' must hold finite float32"),
    "double": (surface() | {"ndf": np.ones((2, 5))}, "'ndf' must hold finite float32 numbers; got float64"),
    "angles that fall": (surface() | {"theta_i": np.zeros(3, np.float32)}, "'theta_i' must increase"),
    "no density": (surface() | {"vndf": np.zeros((1, 3, 5, 6), np.float32)}, "'vndf' must hold densities"),
    "thin": (surface() | {"rgb": np.zeros((1, 3, 3, 1, 4), np.float32)}, "'rgb' is"),
    "empty": (surface() | {"ndf": np.zeros((2, 0), np.float32)}, r"'ndf' is \(2, 0\)"),
}


@pytest.mark.parametrize("what", SPOILT)
def test_what_is_no_isotropic_brdf(what, tmp_path):
    fields, message = SPOILT[what]
    with pytest.raises(ValueError, match=message) as caught:
        MeasuredBRDF.load(stored(tmp_path, written(fields)))
    assert re.search(r"some\.bsdf", str(caught.value))


@pytest.fixture
def brdf(tmp_path) -> MeasuredBRDF:
    return MeasuredBRDF.load(stored(tmp_path, written(surface()))).double()


def test_a_measured_brdf_is_called_like_any_other(brdf, generator):
    """Broadcasting, channels last; zero below the horizon; the same for every azimuth of the two together."""
    assert brdf.n_channels == 3 and brdf.description == "a test"
    wi, wo = directions(7, generator, 0.1), directions(5, generator, 0.1)
    table = brdf(wi[:, None], wo)
    assert table.shape == (7, 5, 3) and bool((table > 0).all())
    torch.testing.assert_close(table[3, 2], brdf(wi[3], wo[2]))
    assert bool((brdf(wi[:, None], -wo) == 0).all()) and bool((brdf(-wi[:, None], wo) == 0).all())
    c, s = math.cos(1.1), math.sin(1.1)
    turn = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=torch.float64)
    torch.testing.assert_close(brdf(wi[:, None] @ turn.T, wo @ turn.T), table)


def test_gradients_are_finite_where_there_is_no_azimuth(brdf):
    for wi in (direction(0.0), direction(0.7)):
        wi = wi.clone().requires_grad_()
        for wo in (direction(0.0), wi.detach() * torch.tensor([-1.0, -1.0, 1.0])):
            (gradient,) = torch.autograd.grad(brdf(wi, wo).sum(), wi)
            assert bool(gradient.isfinite().all())


@pytest.mark.usefixtures("messages")
def test_directions_are_checked(brdf):
    with pytest.raises(ValueError, match="wo must hold unit vectors"):
        brdf(direction(0.1), 2 * direction(0.1))


def test_grids_are_linear_between_their_nodes(generator):
    """At nodes their numbers, between them the mean; along the stack too, and beyond its ends the last."""
    grid = torch.rand(3, 4, 5, generator=generator, dtype=torch.float64)
    knots = torch.tensor([0.0, 0.5, 2.0], dtype=torch.float64)

    def at(x: float, y: float, z: float) -> float:
        across, along, up = (torch.tensor([v], dtype=torch.float64) for v in (x, y, z))
        return float(bilinear(grid, across, along, Stack(knots, up)))

    for k, knot in enumerate(knots.tolist()):
        for j in range(4):
            for i in range(5):
                assert at(i / 4, j / 3, knot) == pytest.approx(float(grid[k, j, i]))
    assert at(0.125, 0.0, 0.0) == pytest.approx(float(grid[0, 0, :2].mean()))
    assert at(1.0, 0.5, 0.5) == pytest.approx(float(grid[1, 1:3, 4].mean()))
    assert at(0.0, 0.0, 1.25) == pytest.approx(float(grid[1:, 0, 0].mean()))
    assert at(0.0, 0.0, -1.0) == pytest.approx(float(grid[0, 0, 0])) and at(0.0, 0.0, 9.0) == pytest.approx(
        float(grid[2, 0, 0])
    )


def test_a_density_becomes_uniform(generator):
    """The map to the square has the density as its Jacobian, and takes the square's edges to its edges."""
    values = torch.rand(2, 5, 7, generator=generator, dtype=torch.float64)
    values[0, 1] = 0.0
    density = Density(values)
    knots = torch.tensor([0.0, 1.0], dtype=torch.float64)
    x, y, z = torch.rand(3, 200, generator=generator, dtype=torch.float64).unbind(0)
    x, y = x.requires_grad_(), y.requires_grad_()
    u, v = density.square(x, y, Stack(knots, z))
    (ux, uy), (vx, vy) = (
        torch.autograd.grad(w.sum(), (x, y), retain_graph=True, allow_unused=True, materialize_grads=True)
        for w in (u, v)
    )
    scale = (7 - 1) * (5 - 1)
    expected = scale * bilinear(density.values, x, y, Stack(knots, z))
    torch.testing.assert_close((ux * vy - uy * vx).abs(), expected, rtol=1e-9, atol=1e-9)
    edge = torch.tensor([0.0, 1.0], dtype=torch.float64)
    half = torch.full((2,), 0.5, dtype=torch.float64)
    torch.testing.assert_close(density.square(edge, half, Stack(knots, half))[0], edge)
    torch.testing.assert_close(density.square(half, edge, Stack(knots, half))[1], edge)
