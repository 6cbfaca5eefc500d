"""The packages that not everybody needs, and the line that installs them."""

from importlib.util import find_spec

EXTRA = {
    "embreex": "microsurface",
    "matplotlib": "microsurface",
    "numba": "microsurface",
    "trimesh": "microsurface",
    "OpenEXR": "render",
    "Pillow": "render",
    "onnx": "onnx",
    "onnxruntime": "onnx",
    "onnxscript": "onnx",
    "mitsuba": "mitsuba",
    "SurfaceTopography": "scans",
}
"""The extra that a package belongs to; where it is in several, the one that most of its users need."""
MODULE = {"Pillow": "PIL"}
"""What is imported of a package, where that is not its name."""


def missing(what: str, package: str, extra: str | None = None) -> ImportError:
    """That `what` needs `package`, and the line that installs it with its `extra`."""
    return ImportError(f'{what} needs {package}: pip install "torchms[{extra or EXTRA[package]}]".')


def require(what: str, *packages: str) -> None:
    """Raise ImportError for the first of the `packages` that is not installed; none is imported."""
    for package in packages:
        if find_spec(MODULE.get(package, package)) is None:
            raise missing(what, package)
