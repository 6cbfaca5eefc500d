"""Files of distilled lobes: weights of a network in an .npz, without pickle, with a certificate of how they were made."""

import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.approximations.network import Layer
from torchms.slopes.mixture import Mixture, checked
from torchms.storage.archives import read_versioned, scalar, single
from torchms.storage.write import write_whole

FORMAT = 1
"""Version of the files: of the features, and of what the outputs mean."""
MOST_BYTES = 300 << 10
"""Largest file, packed or not."""
REMEDY = "Write it again: python -m torchms.approximations.distil."
MOST_LAYERS = 8


class Shape(NamedTuple):
    """Inputs and outputs of a facet's network, and those of that of one direction; 0 inputs if it has none.

    smith: of Smith's networks, if they are in the file, too. scan: whether slopes of a surface are. facets: outputs of the
    network of the facets that light meets, with the same inputs; 0 if there is none. through: of the networks of what is
    transmitted, if the file holds these, too.
    """

    inputs: int
    outputs: int
    of_one: int = 0
    outputs_of_one: int = 1
    smith: "Shape | None" = None
    scan: bool = False
    facets: int = 0
    through: "Shape | None" = None


Weights = tuple[list[Layer], Tensor]
"""Layers, and the linear part."""


class Distillate(NamedTuple):
    """What a file holds.

    facet: "metal", "diffuse", "reflected" or "transmitted". distribution: "GGX" or "Beckmann". alpha: smallest and largest
    roughness it was trained for. layers, skip: the weights. certificate: command, commit, seeds, samples and held-out errors.
    each: weights of what either direction brings, if there is that. smith: weights of both for Smith's lobes, where these are
    corrected; without that of each direction for diffuse facets, and twice for glass. slopes: of a measured surface.
    facets: weights of what light meets on its way, if there is that. through: weights of both for light that is transmitted, of
    a surface of glass, and eta: smallest and largest relative index; for surfaces that the distribution says all of, their
    inverses, too.
    """

    facet: str
    distribution: str
    alpha: tuple[float, float]
    layers: list[Layer]
    skip: Tensor
    certificate: dict[str, Any]
    each: Weights | None = None
    smith: tuple[Weights, ...] | None = None
    slopes: Mixture | None = None
    facets: Weights | None = None
    through: tuple[Weights, Weights] | None = None
    eta: tuple[float, float] | None = None


SMITHS = ("smith_", "smith_each_", "smith_through_", "smith_through_each_")
"""Names of Smith's networks in a file."""


def write(path: str | Path, distillate: Distillate, force: bool = False) -> None:
    """Put `distillate` at `path`, whole or not at all; FileExistsError for a file that is there, unless `force`."""
    content: dict[str, Any] = {
        "format": np.array(FORMAT),
        "facet": np.array(distillate.facet),
        "distribution": np.array(distillate.distribution),
        "alpha": np.array(distillate.alpha, dtype=np.float64),
        "certificate": np.array(json.dumps(distillate.certificate, allow_nan=False)),
    }
    networks = {"": (distillate.layers, distillate.skip)} | ({"each_": distillate.each} if distillate.each else {})
    if distillate.facets:
        networks["facets_"] = distillate.facets
    if distillate.smith:
        networks |= dict(zip(SMITHS, distillate.smith, strict=False))
    if distillate.through and distillate.eta:
        networks |= dict(zip(("through_", "through_each_"), distillate.through, strict=True))
        content["eta"] = np.array(distillate.eta, dtype=np.float64)
    for name, (layers, skip) in networks.items():
        content[f"{name}skip"] = skip.detach().float().numpy()
        for k, (weight, offset) in enumerate(layers):
            content[f"{name}weight_{k}"] = weight.detach().float().numpy()
            content[f"{name}offset_{k}"] = offset.detach().float().numpy()
    if distillate.slopes:
        content |= {f"slopes_{name}": x for name, x in distillate.slopes._asdict().items()}
    file = io.BytesIO()
    np.savez_compressed(file, **content)
    write_whole(path, file.getvalue(), force)


def read(path: str | Path, networks: Mapping[str, Shape]) -> Distillate:
    """The distillate in the file `path`, about one of these facets.

    Raises FileNotFoundError for none, ValueError for a file that is damaged, of another format or facet, or whose weights
    do not fit together or are not finite; nothing is unpickled, and no array is read before its size is known to fit.
    """
    path = Path(path)
    arrays = read_versioned(path, MOST_BYTES, FORMAT, "distilled lobes", REMEDY)
    otherwise = f"{path.name} holds no distilled lobes"
    facet = str(scalar(arrays, "facet", otherwise, REMEDY))
    if facet not in networks:
        raise ValueError(f"{path.name} is about {facet}; known are {', '.join(networks)}.")
    shape = networks[facet]
    try:
        certificate = json.loads(str(scalar(arrays, "certificate", otherwise, REMEDY)))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path.name} has no readable certificate: {error}. {REMEDY}") from error
    low, high = (float(a) for a in _array(arrays, "alpha", (2,), path))
    if not 0 < low < high < math.inf:
        raise ValueError(f"{path.name} is for alpha in [{low:g}, {high:g}], which is no range. {REMEDY}")
    layers, skip = _network(arrays, "", shape.inputs, shape.outputs, path)
    each = _network(arrays, "each_", shape.of_one, shape.outputs_of_one, path) if shape.of_one else None
    distribution = str(scalar(arrays, "distribution", otherwise, REMEDY))
    smith = _networks(arrays, "smith_", shape.smith, path) if shape.smith else None
    through, eta = None, None
    if shape.through:
        pair, of_one = _networks(arrays, "through_", shape.through, path)
        through, eta = (pair, of_one), _eta(arrays, path)
    slopes = None
    if shape.scan:
        if any(f"slopes_{name}" not in arrays for name in Mixture._fields):
            raise ValueError(f"{otherwise}: it lacks the slopes of its surface. {REMEDY}")
        slopes = checked(*(arrays[f"slopes_{name}"] for name in Mixture._fields), name=f"{path.name}: slopes")
    facets = _network(arrays, "facets_", shape.inputs, shape.facets, path) if shape.facets else None
    return Distillate(
        facet, distribution, (low, high), layers, skip, certificate, each, smith, slopes, facets, through, eta
    )


def _networks(arrays: dict[str, np.ndarray], name: str, shape: Shape, path: Path) -> tuple[Weights, ...]:
    """Networks of the pair, of each direction if there is one, and both for what is transmitted if there are these."""
    found = (_network(arrays, name, shape.inputs, shape.outputs, path),)
    if shape.of_one:
        found += (_network(arrays, f"{name}each_", shape.of_one, shape.outputs_of_one, path),)
    return found + _networks(arrays, f"{name}through_", shape.through, path) if shape.through else found


def _eta(arrays: dict[str, np.ndarray], path: Path) -> tuple[float, float]:
    """Smallest and largest relative index."""
    low, high = (float(x) for x in _array(arrays, "eta", (2,), path))
    if not 0 < low <= high < math.inf:
        raise ValueError(f"{path.name} is for eta in [{low:g}, {high:g}], which is no range. {REMEDY}")
    return low, high


def _network(arrays: dict[str, np.ndarray], name: str, inputs: int, outputs: int, path: Path) -> Weights:
    """Layers that fit to each other, and the linear part; ValueError otherwise."""
    depth = sum(key.startswith(f"{name}weight_") for key in arrays)
    if not 1 <= depth <= MOST_LAYERS:
        raise ValueError(f"{path.name} has {depth} layers; 1 to {MOST_LAYERS} are expected. {REMEDY}")
    layers = []
    n = inputs
    for k in range(depth):
        offset = arrays.get(f"{name}offset_{k}")
        m = outputs if k == depth - 1 else len(offset) if offset is not None and offset.ndim == 1 else 0
        weight = _weights(arrays, f"{name}weight_{k}", (m, n), path)
        layers.append((weight, _weights(arrays, f"{name}offset_{k}", (m,), path)))
        n = m
    return layers, _weights(arrays, f"{name}skip", (outputs, inputs), path)


def _weights(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...], path: Path) -> Tensor:
    return torch.from_numpy(single(_array(arrays, name, shape, path), name, path.name, REMEDY))


def _array(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...], path: Path) -> np.ndarray:
    if name not in arrays:
        raise ValueError(f"{path.name} holds no distilled lobes: it lacks {name!r}. {REMEDY}")
    array = arrays[name]
    if array.shape != shape:
        raise ValueError(f"{path.name}: {name!r} must have shape {shape}; got {array.shape}. {REMEDY}")
    if array.dtype.kind != "f" or not np.isfinite(array).all():
        raise ValueError(f"{path.name}: {name!r} must hold finite numbers. {REMEDY}")
    return array
