"""What carries light from facet to facet: the tracer's interface, and Embree behind it."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from torchms.extras import missing
from torchms.microsurface.rays.grid import Grid, Paths


@dataclass
class TraceCount:
    """What a tracer had to do, beyond moving rays.

    leaked: rays given up because they came to the wrong side of the surface (what the leak rate counts).
    casts: queries of the acceleration structure, wraps and repeats included. repeats: casts made again from farther
    off, because the first met the ray's own facet or a facet from behind (rounding).
    """

    leaked: int = 0
    casts: int = 0
    repeats: int = 0

    def add(self, other: "TraceCount") -> None:
        """Add the counts of another batch."""
        self.leaked += other.leaked
        self.casts += other.casts
        self.repeats += other.repeats


class Caster(ABC):
    """A tracer bound to one surface. One thread at a time may use it: `fork` gives each thread its own."""

    @abstractmethod
    def cast(self, paths: Paths) -> TraceCount:
        """Move the first `paths.n` rays to the facets they meet, in place; `tri` is −1 if one left, −2 if it leaked."""

    def fork(self) -> "Caster":
        """A caster for another thread that shares everything immutable."""
        return self


class Tracer(ABC):
    """How rays are traced; goes into the `tracer` slot of `simulate`."""

    @abstractmethod
    def require(self) -> None:
        """Raise ImportError that says how to get what is missing; called before surfaces are made."""

    @abstractmethod
    def bind(self, grid: Grid) -> Caster:
        """Build what is needed to trace on one surface."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Configuration, JSON-serialisable: what may change the result."""


@dataclass(frozen=True)
class EmbreeTracer(Tracer):
    """Embree 4 in robust mode, through the embreex package that accelerates trimesh; float64 hit points.

    offset: where a ray restarts above its facet, in the grid frame (cells; α = 1). x and y are rounded to float32 first
    and the height is taken from the surface there, so rounding cannot put the start below it, and a few units in the
    last place are enough (very high surfaces get two, if `offset` is less). 1e-4 makes one bounced ray in 7000 meet
    another facet, 1e-5 one in 60 000.
    margin: cells of the periodic neighbours in the scene; a ray that leaves it goes on from the opposite edge, half a
    cell back, so no seam can be slipped through.
    Raises ImportError where embreex is missing (there is no wheel for Linux on aarch64).
    """

    offset: float = 1e-5
    margin: int = 16

    def __post_init__(self) -> None:
        if not 1e-6 <= self.offset <= 1e-2:
            raise ValueError(f"EmbreeTracer(offset=...) must lie in [1e-6, 1e-2] cells; got {self.offset}. Use 1e-5.")
        if self.margin < 2:
            raise ValueError(f"EmbreeTracer(margin=...) must be at least 2 cells; got {self.margin}. Use 16.")

    def require(self) -> None:
        """See `Tracer`."""
        _embreex()

    def bind(self, grid: Grid) -> "EmbreeCaster":
        """Build the scene of one tile and its margin."""
        return EmbreeCaster(grid, self.offset, self.margin)

    def describe(self) -> dict[str, Any]:
        """See `Tracer`."""
        return {"tracer": "EmbreeTracer", "offset": self.offset, "margin": self.margin}


def _embreex() -> tuple[Any, Any]:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        otherwise = "Where that has no wheel: tracer=GridTracer() (--tracer grid), which needs only Numba."
        raise ImportError(f"{missing('EmbreeTracer', 'embreex')} {otherwise}") from error
    return EmbreeScene, TriangleMesh


@dataclass
class EmbreeCaster(Caster):
    """`EmbreeTracer` on one surface."""

    grid: Grid
    offset: float
    margin: int
    scene: Any = None
    buffers: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.scene is not None:
            return
        largest = np.float32(max(abs(self.grid.top), abs(self.grid.bottom)))
        self.offset = max(self.offset, 2 * float(np.spacing(largest)))
        EmbreeScene, TriangleMesh = _embreex()
        from torchms.microsurface.surfaces.mesh import triangle_indices

        nx, ny = self.grid.heights.shape
        m = self.margin
        padded = np.pad(self.grid.heights, ((m, m + 1), (m, m + 1)), mode="wrap")
        vertices = np.empty((*padded.shape, 3), dtype=np.float32)
        # Centred, which gains one bit; whole cells are exact in float32.
        vertices[..., 0] = np.arange(-m - nx // 2, nx - nx // 2 + m + 1, dtype=np.float32)[:, None]
        vertices[..., 1] = np.arange(-m - ny // 2, ny - ny // 2 + m + 1, dtype=np.float32)
        vertices[..., 2] = padded
        self.scene = EmbreeScene()
        TriangleMesh(self.scene, vertices.reshape(-1, 3), triangle_indices(nx + 2 * m, ny + 2 * m))
        # The first query builds the tree; do it now, before threads share the scene.
        down = np.array([[0, 0, -1]], dtype=np.float32)
        self.scene.run(np.array([[0.25, 0.25, self.grid.top + 1]], dtype=np.float32), down)

    def fork(self) -> "EmbreeCaster":
        """A caster with its own buffers and the same scene."""
        return EmbreeCaster(self.grid, self.offset, self.margin, self.scene)

    def _buffers(self, n: int) -> dict[str, np.ndarray]:
        if not self.buffers or len(self.buffers["pending"]) < n:
            self.buffers = {
                "pending": np.empty(n, dtype=np.int64),
                "tries": np.empty(n, dtype=np.int32),
                "travelled": np.empty(n, dtype=np.int32),
                "origin": np.empty((n, 3), dtype=np.float32),
                "direction": np.empty((n, 3), dtype=np.float32),
            }
        return self.buffers

    def cast(self, paths: Paths) -> TraceCount:
        """See `Caster`."""
        from torchms.microsurface.rays.embree_kernels import resolve, start

        g, p, count = self.grid, paths, TraceCount()
        b = self._buffers(p.n)
        work = (b["pending"], b["tries"], b["travelled"], b["origin"], b["direction"])
        start(g.heights, g.scale, self.offset, p.x, p.y, p.z, p.d, p.tri, p.side, *work, p.n)
        left = p.n
        while left:
            count.casts += left
            ids = self.scene.run(b["origin"][:left], b["direction"][:left])
            bounds = (self.offset, self.margin, g.top, g.bottom)
            left, repeats, leaked = resolve(g.heights, g.scale, *bounds, p.x, p.y, p.z, p.d, p.tri, p.side, *work, ids)
            count.repeats += repeats
            count.leaked += leaked
        return count
