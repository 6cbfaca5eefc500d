"""The classic microfacet BSDF: one bounce, the rest is lost."""

from torchms.estimators.path_tracer import PathTracer
from torchms.paths.segments import Correlated


class SingleBounce(PathTracer):
    """One bounce with height-correlated masking and shadowing [Heitz2014, Eq. 99]; what bounces again is lost.

    It is the first order of the Smith model, exactly. Deterministic for mirror and refractive facets (`u` may be left
    out); the diffuse facet is drawn.
    """

    sources = ("Heitz2014",)

    is_unbiased = True
    is_reciprocal = True

    def __init__(self) -> None:
        super().__init__(Correlated(), 1)
