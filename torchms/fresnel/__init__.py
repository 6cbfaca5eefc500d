"""What a smooth facet reflects: `Ideal`, `Conductor` (and `.metal`), `Dielectric`, `Schlick`."""

from torchms.fresnel.base import Fresnel as Fresnel
from torchms.fresnel.conductor import Conductor as Conductor
from torchms.fresnel.dielectric import Dielectric as Dielectric
from torchms.fresnel.ideal import Ideal as Ideal
from torchms.fresnel.interface import Interface as Interface
from torchms.fresnel.schlick import Schlick as Schlick
