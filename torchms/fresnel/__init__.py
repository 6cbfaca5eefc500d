"""What a smooth facet reflects: `Ideal`, `Conductor` (and `.metal`), `Dielectric`, `Schlick`."""

from torchms.fresnel.base import Fresnel
from torchms.fresnel.conductor import Conductor
from torchms.fresnel.dielectric import Dielectric
from torchms.fresnel.ideal import Ideal
from torchms.fresnel.interface import Interface
from torchms.fresnel.schlick import Schlick

__all__ = ["Conductor", "Dielectric", "Fresnel", "Ideal", "Interface", "Schlick"]
