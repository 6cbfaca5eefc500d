"""A shading testbed: meshes with a BSDF under one light, to look at evaluators. Not a light-transport renderer.

What is counted: light that reaches a visible point directly and is scattered there once by the BSDF (whose bounces
within the microgeometry are the BSDF's affair); through glass, also light that crosses the closed body of the mesh,
see `torchms.render.paths`. Radiance is in linear sRGB; y is up.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "Camera": "camera",
    "ConstantLight": "lights",
    "DirectionalLight": "lights",
    "Environment": "lights",
    "Picture": "film",
    "Shape": "shapes",
    "load_shape": "scenes",
    "render": "film",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    # Loaded when used, so that the options need not wait for torch.
    if name in _HOME:
        return getattr(import_module(f"torchms.render.{_HOME[name]}"), name)
    raise AttributeError(f"module 'torchms.render' has no attribute {name!r}")
