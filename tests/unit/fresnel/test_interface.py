"""What rough glass takes in its Fresnel slot: any lossless boundary, here a thin film with a reflectance a channel."""

import math

import pytest
import torch
from cases import direction
from torch import Tensor

from torchms import GGX, Bidirectional, Correlated, HeightWalk, KullaConty, RoughDielectric, SingleBounce
from torchms.fresnel import Conductor, Dielectric, Interface
from torchms.maths.numerics import safe_sqrt
from torchms.testing import law_suite


class ThinFilm(Interface):
    """A film of index `film` between outside (1) and inside (`eta`), 1 < film < eta, `waves` thick: thickness / wavelength.

    Airy's sum over all reflections inside the film (Born and Wolf, Principles of Optics, 7th ed., section 1.6.4).
    """

    eta: Tensor
    film: Tensor
    waves: Tensor

    def __init__(self, eta: float, film: float, waves: list[float]) -> None:
        super().__init__()
        self.declare("eta", eta, low=1.0, high=4.0, remedy="")
        self.declare("film", film, low=1.0, high=4.0, remedy="")
        self.declare("waves", waves, low=0.0, high=100.0, channels=True, remedy="")

    @property
    def n_channels(self) -> int:
        return self.waves.shape[-1]

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        inside = cos_theta < 0
        n0, n2 = torch.where(inside, self.eta, 1.0), torch.where(inside, 1.0, self.eta)
        c = torch.where(inside, -cos_theta, cos_theta)
        passes = n0 * n0 * (1 - c * c) < n2 * n2
        c = torch.where(passes, c, 1.0)
        tangential2 = n0 * n0 * (1 - c * c)
        c1 = safe_sqrt(1 - tangential2 / (self.film * self.film))
        c2 = safe_sqrt(1 - tangential2 / (n2 * n2))
        phase = 4 * math.pi * self.film * c1 * self.waves.reshape(-1, *(1,) * c.ndim)

        def combined(first: Tensor, second: Tensor) -> Tensor:
            product = first * second
            wave = 2 * product * torch.cos(phase)
            return (first * first + second * second + wave) / (1 + product * product + wave)

        s = combined(
            (n0 * c - self.film * c1) / (n0 * c + self.film * c1),
            (self.film * c1 - n2 * c2) / (self.film * c1 + n2 * c2),
        )
        p = combined(
            (self.film * c - n0 * c1) / (self.film * c + n0 * c1),
            (n2 * c1 - self.film * c2) / (n2 * c1 + self.film * c2),
        )
        return torch.where(passes, (s + p) / 2, 1.0)


def film(waves: list[float]) -> ThinFilm:
    return ThinFilm(1.5, 1.25, waves)


def test_a_film_of_no_thickness_is_the_boundary():
    c = torch.linspace(-0.99, 0.99, 41, dtype=torch.float64)
    torch.testing.assert_close(film([0.0]).double()(c), Dielectric(1.5).double()(c), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "scattering",
    [HeightWalk(3), pytest.param(Bidirectional(Correlated(), 3), marks=pytest.mark.slow)],
    ids=["walk", "bidirectional"],
)
def test_glass_of_a_film_obeys_the_laws(scattering):
    """Energy, density and value against walk, order by order, in three channels at once, from both sides."""
    report = law_suite(RoughDielectric(GGX(0.5), film([0.2, 0.35, 0.6]), scattering), samples=3000)
    assert not report.failed, report


def test_its_channels_are_those_of_one_film_each(generator):
    """One bounce has no choice among channels: three at once are three alone, and a film of no thickness is plain glass."""
    wi, wo = direction(0.7)[None], torch.stack([direction(0.5, 2.0), -direction(0.4, 0.5), -direction(0.6, 1.0)])

    def value(interface: Interface) -> Tensor:
        return RoughDielectric(GGX(0.5), interface, SingleBounce(), mode="importance").double()(wi, wo)

    waves = [0.0, 0.3, 0.7]
    together = value(film(waves))
    assert together.shape == (3, 3) and (together > 0).all()
    torch.testing.assert_close(together, torch.cat([value(film([w])) for w in waves], -1))
    torch.testing.assert_close(together[:, :1], value(Dielectric(1.5)))


def test_dispersion_is_a_batch_axis(generator):
    """An index a wavelength: one surface, directions (*batch, 1, 3), values (*batch, wavelengths, 1)."""
    indices = [1.45, 1.5, 1.55]
    prism = RoughDielectric(GGX(0.2), Dielectric(torch.tensor(indices, dtype=torch.float64)), SingleBounce())
    wi, wo = direction(0.7).expand(5, 1, 3), -direction(0.45, 0.8).expand(5, 1, 3)
    values = prism(wi, wo)
    assert values.shape == (5, 3, 1)
    for i, eta in enumerate(indices):
        alone = RoughDielectric(GGX(0.2), Dielectric(eta), SingleBounce()).double()
        torch.testing.assert_close(values[:, i], alone(wi[:, 0], wo[:, 0]), rtol=1e-6, atol=0)


def test_what_is_no_interface_is_refused(messages):
    with pytest.raises(TypeError, match=r"RoughDielectric\(fresnel=\.\.\.\) must be .*Interface"):
        RoughDielectric(GGX(0.5), Conductor.metal("Cu"))
    with pytest.raises(ValueError, match=r"KullaConty: the table of glass is for Dielectric\(eta\); got ThinFilm"):
        RoughDielectric(GGX(0.5), film([0.3]), KullaConty())
