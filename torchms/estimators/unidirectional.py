"""The position-free path integral, estimated from the side of wi [Wang2022]."""

from torchms.estimators.path_tracer import PathTracer
from torchms.paths.segments import Segment


class Unidirectional(PathTracer):
    """Sum over all paths of up to `max_order` bounces, sampled from wi, with a `segment` model for the heights.

    What is left after `max_order` bounces is not counted. `attached`: see `PathTracer`; the default is right. Raises
    ValueError when it is put into a dielectric with `Invariance`, which knows one side of the surface only.
    """

    sources = ("Wang2022",)

    def __init__(self, segment: Segment, max_order: int = 8, attached: bool | None = None) -> None:
        if not isinstance(segment, Segment):
            raise TypeError(
                f"{type(self).__name__}(segment=...) must be Uncorrelated(), Correlated() or Invariance(); "
                f"got {segment!r}."
            )
        super().__init__(segment, max_order, attached)
        self.is_reciprocal = segment.is_reciprocal
        self.is_unbiased = segment.is_exact or (self.max_order == 1 and segment.is_exact_once)

    def extra_repr(self) -> str:
        return f"max_order={self.max_order}"
