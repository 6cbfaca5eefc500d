"""The random walk of [Heitz2016], which carries the height: the oracle for reflection and transmission."""

from torchms.estimators.path_tracer import PathTracer
from torchms.paths.height import RandomHeight


class HeightWalk(PathTracer):
    """The Smith model itself: a walk that carries its height, with next-event estimation at every bounce [Heitz2016].

    A ray that may escape is followed with the probability that it stays, instead of being ended at random; this changes
    no expectation, lowers the variance and keeps the gradient. Results do not depend on the distribution of heights.
    `attached`: see `PathTracer`; the default is right.
    """

    sources = ("Heitz2016",)

    is_unbiased = True
    is_reciprocal = True

    def __init__(self, max_order: int = 8, attached: bool | None = None) -> None:
        super().__init__(RandomHeight(), max_order, attached)

    def extra_repr(self) -> str:
        return f"max_order={self.max_order}"
