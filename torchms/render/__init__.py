"""A shading testbed: meshes with a BSDF under one light, to look at evaluators. Not a light-transport renderer.

What is counted: light that reaches a visible point directly and is scattered there once by the BSDF (whose bounces
within the microgeometry are the BSDF's affair); through glass, also light that crosses the closed body of the mesh,
see `torchms.render.paths`. Radiance is in linear sRGB; y is up.
"""

from typing import TYPE_CHECKING

from torchms.lazy import lazily

if TYPE_CHECKING:
    from torchms.render.camera import Camera as Camera
    from torchms.render.film import Picture as Picture
    from torchms.render.film import render as render
    from torchms.render.lights import ConstantLight as ConstantLight
    from torchms.render.lights import DirectionalLight as DirectionalLight
    from torchms.render.lights import Environment as Environment
    from torchms.render.scenes import load_shape as load_shape
    from torchms.render.shapes import Shape as Shape

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

__getattr__ = lazily(__name__, _HOME)
