"""The public surface of every BSDF."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch import Tensor

from torchms.bsdfs import kernels
from torchms.bsdfs.results import Albedo, DirectionSample, WalkSample
from torchms.distributions.base import MicrofacetDistribution
from torchms.estimators.base import Exit, Scattering, check_scattering
from torchms.evaluation import blocks
from torchms.evaluation.arguments import check_block, check_parameters, check_random, check_values, given_batches
from torchms.evaluation.kernel import Kernel
from torchms.evaluation.numbers import source
from torchms.maths.frame import Vec3, check_direction
from torchms.maths.numerics import own_precision, widened
from torchms.parameters.declared import Parametric
from torchms.parameters.exchange import declarations
from torchms.parameters.maps import fitted
from torchms.paths.vertex import Vertex
from torchms.sampling import uniforms as uniform_numbers
from torchms.sampling.proposals import Proposal
from torchms.sampling.stream import Stream
from torchms.typing import Direction, EachOrders, Orders, Scalar, Scalars, Spectra, Spectrum, Uniforms


class BSDF(Parametric, ABC):
    """A surface: a distribution of microfacets, what one facet does, and how the bounces are summed.

    Directions are unit vectors in the local frame (+z is the macro-normal) that point away from the surface; a value is
    f · |cos θ_o| [1/sr]. Batches broadcast, per-pixel parameters included. Evaluation runs in blocks of rows.
    """

    distribution: MicrofacetDistribution
    scattering: Scattering
    engine: Any = None
    """What runs the kernels; None for eager evaluation (see `torchms.compile`)."""

    def _assemble(self, distribution: MicrofacetDistribution, scattering: Scattering) -> None:
        if not isinstance(distribution, MicrofacetDistribution):
            raise TypeError(
                f"{type(self).__name__}(distribution=...) must be GGX(...), Beckmann(...), GTR(...) or Tabulated(...); "
                f"got {distribution!r}."
            )
        check_scattering(scattering, type(self).__name__)
        self.distribution = distribution
        self.scattering = scattering
        scattering.check(self.vertex)

    @property
    @abstractmethod
    def vertex(self) -> Vertex:
        """One facet, with the parameters of this moment."""

    @property
    @abstractmethod
    def proposal(self) -> Proposal:
        """What `sample` draws from."""

    @property
    @abstractmethod
    def n_channels(self) -> int:
        """C, the channels of a value."""

    @property
    def is_lossless(self) -> bool:
        """Whether facets absorb nothing, so that light is lost only with orders that are not counted."""
        return False

    def _unit_of(self, wi: Vec3, wo: Vec3) -> Tensor | None:
        """What a value is multiplied by for the quantity that is transported; None for no factor."""
        return None

    # What the kernels see of a surface: one scattering, unless a subclass adds to it.

    def _evaluate(self, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        """f · |cos θ_o| of each order [1/sr], each (C, N or 1, …)."""
        return self.scattering.evaluate(self.vertex, wi, wo, u)

    def _walk(self, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        """The walk from `wi`, order after order."""
        return self.scattering.walk(self.vertex, wi, u)

    knows_energies = False
    """Whether `albedo` needs no random numbers."""

    def _energies(self, wi: Vec3) -> list[Tensor]:
        """What is reflected of each order, each (C, 1, …), if the surface `knows_energies`."""
        raise NotImplementedError

    @property
    def max_order(self) -> int:
        """K, the bounces that are counted."""
        return self.scattering.max_order

    @property
    def n_uniforms(self) -> int:
        """D, the random numbers a path may draw."""
        return max(self.scattering.n_uniforms(self.vertex), self.proposal.n_uniforms)

    @property
    def dtype(self) -> torch.dtype:
        """dtype of the declared parameters, and so of `uniforms`; of a table or a network if there are none."""
        declared = (value.dtype for _, _, value in declarations(self) if value is not None)
        undeclared = (x.dtype for x in (*self.parameters(), *self.buffers()))
        return next(declared, None) or next(undeclared, torch.get_default_dtype())

    @property
    def device(self) -> torch.device:
        """Device of the tensors, and so of `uniforms`; the default one if there are none."""
        given = next(iter((*self.parameters(), *self.buffers())), None)
        return torch.get_default_device() if given is None else given.device

    def uniforms(
        self,
        batch_shape: Sequence[int],
        n_paths: int = 1,
        *,
        generator: torch.Generator | None = None,
        sequence: str = "random",
        device: torch.device | str | None = None,
    ) -> Uniforms:
        """Random numbers for one call of any method: `(*batch_shape, n_paths, n_uniforms)` in [0, 1).

        `sequence` is "random" or "sobol" (scrambled, rotated a row). Raises ValueError for another one. `device`: None
        takes that of the parameters; a `generator` of another device draws there.
        """
        return uniform_numbers.draw(
            batch_shape,
            n_paths,
            self.n_uniforms,
            generator=generator,
            sequence=sequence,
            dtype=self.dtype,
            device=self.device if device is None else device,
        )

    def forward(
        self,
        wi: Direction,
        wo: Direction | DirectionSample,
        u: Uniforms | Stream | None = None,
        *,
        block: int | None = None,
    ) -> Spectrum | Spectra:
        """f(wi, wo) · |cos θ_o| [1/sr], summed over the orders, mean over the N paths of `u`.

        `wo`, here and below, may be what `sample(wi, …)` returned: then there is one value for each of its directions,
        (*batch, N, C), and `value / drawn.pdf[..., None]` estimates the integral over all of them.
        `u` may be left out where the scattering is deterministic. Rows on a side that the surface does not serve are 0.
        `block`, here and below: rows × paths that are evaluated at a time, `torchms.evaluation.blocks.BLOCK` if it is left out;
        results depend on it in their last bits at most. Compiled code has a block of its own, and takes none.
        float16 and bfloat16 arguments are widened to float32, also under `torch.autocast`. Raises ValueError if a shape
        or a device does not fit, or `block` is not above 0 or given to compiled code, TypeError for a dtype that does not.
        """
        return self._run_pair(kernels.FORWARD, wi, wo, u, block)

    def orders(
        self,
        wi: Direction,
        wo: Direction | DirectionSample,
        u: Uniforms | Stream | None = None,
        *,
        block: int | None = None,
    ) -> Orders | EachOrders:
        """f(wi, wo) · |cos θ_o| [1/sr] of each order, `[..., k - 1, :]` after exactly k bounces; `forward` sums it."""
        return self._run_pair(kernels.ORDERS, wi, wo, u, block)

    def sample(self, wi: Direction, u: Uniforms | Stream | None = None, *, block: int | None = None) -> DirectionSample:
        """One direction wo a path, close to the shape of f · |cos θ_o|, with its exact density.

        For a `wi` on a side that the surface does not serve, pdf = 0. ValueError without `u`.
        """
        return DirectionSample(*self._run(kernels.SAMPLE, {"wi": wi}, u, block))

    def pdf(self, wi: Direction, wo: Direction | DirectionSample, *, block: int | None = None) -> Scalar | Scalars:
        """Density of `sample` at `wo` [1/sr]; zero below the horizon of a surface that does not transmit."""
        return self._run_pair(kernels.PDF, wi, wo, None, block)

    def sample_walk(self, wi: Direction, u: Uniforms | Stream | None = None, *, block: int | None = None) -> WalkSample:
        """Where one random walk a path leaves the surface: perfect importance sampling, of unknown density.

        Its expectation is that of the model in the scattering slot. ValueError without `u`.
        """
        wo, weight, order = self._run(kernels.WALK, {"wi": wi}, u, block)
        return WalkSample(wo, weight, order.to(torch.int64))

    def albedo(self, wi: Direction, u: Uniforms | Stream | None = None, *, block: int | None = None) -> Albedo:
        """Share of the energy from `wi` that leaves after each order, on either side; mean over the N paths.

        No η² factor, whatever the mode. `u` may be left out where the surface `knows_energies`.
        """
        return Albedo(*self._run(kernels.ALBEDO, {"wi": wi}, u, block))

    def _run_pair(
        self, kernel: Kernel, wi: Tensor, wo: Tensor | DirectionSample, u: Tensor | Stream | None, block: int | None
    ) -> Tensor:
        """`kernel` of two directions; the N of a sample lead while it runs, so that maps and `wi` line up behind them."""
        if not isinstance(wo, DirectionSample):
            return self._run(kernel, {"wi": wi, "wo": wo}, u, block)[0]
        (value,) = self._run(kernel, {"wi": wi, "wo": wo.wo.movedim(-2, 0)}, u, block)
        return value.movedim(0, wo.pdf.ndim - 1)

    def _run(
        self, kernel: Kernel, directions: dict[str, Tensor], u: Tensor | Stream | None, block: int | None
    ) -> tuple[Tensor, ...]:
        """`kernel` by the engine, or in blocks, after all that is given has been looked at."""
        engine = self.engine

        def look() -> None:
            check_values(self, directions, u if kernel.draws(self) else None)

        if (
            engine is not None
            and block is None
            and (recent := engine.recent(kernel, self, tuple(directions.values()), u))
        ):
            return engine.again(recent, tuple(directions.values()), u, look)
        for name, w in directions.items():
            check_direction(w, name)
        n_uniforms = self.n_uniforms
        optional = not kernel.draws(self)
        check_random(u, n_uniforms, optional, kernel.name)
        check_block(block, engine is not None, kernel.name)
        check_parameters(self, directions | ({"u": u} if isinstance(u, Tensor) else {}))
        if optional:
            u = None
        if engine is None:
            look()
        surface = fitted(self, *given_batches(directions, u))
        if isinstance(u, Tensor):
            u = widened(u)
        given = [widened(w) for w in directions.values()]
        numbers = source(u, n_uniforms, self.dtype)
        with own_precision(given[0]):
            if engine is not None:
                return engine.run(kernel, surface, given, numbers, look)
            return blocks.run(kernel, surface, given, numbers, block)
