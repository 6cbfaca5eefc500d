"""What a plugin does, without Mitsuba's class around it: its parameters, and its kernels at Mitsuba's interactions."""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from torchms.mitsuba import noise
from torchms.mitsuba.materials import ALPHAS, LIMITS, MATERIALS, Choice, recorded
from torchms.mitsuba.parameters import alphas, check_range, chosen, whole
from torchms.mitsuba.recorded import Direction, Recorded

Value = Any


class Surface:
    """A surface of Mitsuba's parameters, in the variant of this moment."""

    def __init__(self, plugin: str, props: Any) -> None:
        mi, dr = import_module("mitsuba"), import_module("drjit")
        self.mi, self.dr, self.plugin, self.material = mi, dr, plugin, MATERIALS[plugin]
        self.words = {name: chosen(plugin, props, name, known) for name, known in self.material.words.items()}
        if not props.get("sample_visible", True):
            raise ValueError(f"{plugin}: sample_visible must be true; directions are drawn by visible normals.")
        self.seed, self.paths = whole(plugin, props, "seed", 0, 0, 2**31 - 1), whole(plugin, props, "paths", 1, 1, 16)
        max_order = whole(plugin, props, "max_order", 8, 1, 16)
        self.alphas = alphas(plugin, props) if "distribution" in self.words else {}
        self.own = self.material.read(props)
        self.scales = {name: props.get_texture(name, 1.0) for name in self.material.scales}
        self.flags = [+getattr(mi.BSDFFlags, name) for name in self.material.components]
        self.transmits = len(self.flags) > 1
        channels = dr.size_v(mi.UnpolarizedSpectrum)
        isotropic = len(self.alphas) < 2 and "anisotropy" not in self.own
        # Where nothing is transmitted, both are the same.
        modes = {"radiance": "radiance", "importance": "importance" if self.transmits else "radiance"}
        self.kernels: dict[str, Recorded] = {
            name: recorded(plugin, Choice(tuple(self.words.values()), isotropic, max_order, channels, mode))
            for name, mode in modes.items()
        }
        self.changed()

    # Parameters.

    def parameters(self) -> dict[str, Any]:
        """Name → texture or number, as `mitsuba.traverse` shows them."""
        return self.alphas | self.own | self.scales

    def changed(self) -> None:
        """Look at the parameters: when they are new, and whenever Mitsuba says that they have changed."""
        if self.alphas:
            low, high = LIMITS[self.words["scattering"]]
            remedy = f"An optimizer keeps it there with params[key] = dr.clip(params[key], {low:g}, {high:g})."
            if low > LIMITS["exact"][0]:
                remedy += ' scattering="exact" serves alpha in [0.001, 2].'
            check_range(self.plugin, self.alphas, low, high, remedy)
        for name, (low, high) in self.material.ranges.items():
            given = {name: self.own[name]} if name in self.own else {}
            check_range(self.plugin, given, low, high, "Outside of it there is no such surface, or none was learned.")

    def _given(self, si: Any, active: Value, kernels: Recorded) -> list[Value]:
        """The numbers of all parameters at `si`, in the order of the kernels' columns."""
        names = dict(zip(ALPHAS, self.alphas, strict=False)) | dict(self.material.own)
        everything, found = self.parameters(), []
        for name, count in kernels.parameters.items():
            value = everything[names[name]]
            if not isinstance(value, self.mi.Texture):
                found.append(value)
            elif count:
                found += list(value.eval(si, active))
            else:
                found.append(value.eval_1(si, active))
        return found

    # At an interaction.

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Value, which: str) -> tuple[Any, Value]:
        """f · |cos θ_o| as a spectrum, and the density of `sample` [1/sr]; what is not asked for is 0.

        The density is held, as that of `sample` is: the weights of several techniques must sum to one with their gradients.
        """
        kernels, wi, active = self._enter(ctx, si, active)
        there = self._safe(wo, active)
        given = self._given(si, active, kernels)
        differentiable, given = self._attached(wi, there, given)
        transmitted = wi[2] * there[2] < 0
        active &= self._enabled(ctx, transmitted) & (there[2] != 0)
        value, pdf = self.mi.UnpolarizedSpectrum(0), self.mi.Float(0)
        if "value" in which:
            value = self._value(kernels, si, wi, there, given, active, differentiable)
        if "pdf" in which:
            held = [[self.dr.detach(x) for x in values] for values in (wi, there, given)]
            (pdf,) = self._where(active, lambda: (kernels.pdf(*held),), 1)
        return self._polarized(value), pdf

    def sample(self, ctx: Any, si: Any, sample1: Value, sample2: Any, active: Value) -> tuple[Any, Any]:
        """A direction and f · |cos θ_o| / density, as Mitsuba wants them.

        The direction and its density are held: the lobe that is chosen jumps, and with it what follows, as parameters move.
        """
        mi, dr = self.mi, self.dr
        kernels, wi, active = self._enter(ctx, si, active)
        given = self._given(si, active, kernels)
        differentiable, given = self._attached(wi, (), given)
        chosen = (sample1, sample2.x, sample2.y)
        wo, pdf = kernels.sample(*([dr.detach(x) for x in values] for values in (wi, chosen, given)))
        transmitted = wi[2] * wo[2] < 0
        active &= (pdf > 0) & self._enabled(ctx, transmitted)
        value = self._value(kernels, si, wi, wo, given, active, differentiable)
        found = dr.zeros(mi.BSDFSample3f)
        found.wo = mi.Vector3f(*(dr.select(active, x, mi.Float(z)) for x, z in zip(wo, (0, 0, 1), strict=True)))
        found.pdf = dr.select(active, pdf, mi.Float(0))
        found.eta = mi.Float(1)
        found.sampled_type, found.sampled_component = mi.UInt32(self.flags[0]), mi.UInt32(0)
        if self.transmits:
            eta = given[list(kernels.parameters).index("fresnel.eta")]
            found.eta = dr.select(transmitted, dr.select(wi[2] > 0, eta, 1 / eta), mi.Float(1))
            found.sampled_type = dr.select(transmitted, mi.UInt32(self.flags[1]), mi.UInt32(self.flags[0]))
            found.sampled_component = dr.select(transmitted, mi.UInt32(1), mi.UInt32(0))
        weight = dr.select(active, value / dr.select(active, pdf, mi.Float(1)), mi.UnpolarizedSpectrum(0))
        return found, self._polarized(weight)

    def _enter(self, ctx: Any, si: Any, active: Value) -> tuple[Recorded, Direction, Value]:
        """The kernels for what is transported, the view direction, and where there is something to do."""
        active = self.mi.Bool(active)
        active &= (si.wi.z != 0) if self.transmits else (si.wi.z > 0)
        mode = "radiance" if ctx.mode == self.mi.TransportMode.Radiance else "importance"
        return self.kernels[mode], self._safe(si.wi, active), active

    def _safe(self, w: Any, active: Value) -> Direction:
        """`w`, and the normal in lanes that are not active: what is there may be no number, and gradients would sum it up."""
        x, y, z = (self.dr.select(active, c, self.mi.Float(n)) for c, n in zip((w.x, w.y, w.z), (0, 0, 1), strict=True))
        return x, y, z

    def _enabled(self, ctx: Any, transmitted: Value) -> Value:
        """Whether the context asks for that component."""
        asked = [ctx.is_enabled(getattr(self.mi.BSDFFlags, name), i) for i, name in enumerate(self.material.components)]
        if not self.transmits:
            return (
                self.mi.Bool(asked[0]) & ~transmitted
                if self.dr.is_jit_v(self.mi.Float)
                else asked[0] and not transmitted
            )
        return self.dr.select(transmitted, self.mi.Bool(asked[1]), self.mi.Bool(asked[0]))

    def _attached(self, wi: Direction, wo: Sequence[Value], given: list[Value]) -> tuple[bool, list[Value]]:
        """Whether gradients are wanted; then every parameter has one number a lane, so that they are summed up once."""
        dr = self.dr
        if not any(dr.grad_enabled(x) for x in (*wi, *wo, *given) if dr.is_diff_v(x)):
            return False, given
        here = wi[2] < 2
        return True, [dr.select(here, x, self.mi.Float(0)) for x in given]

    def _value(
        self, kernels: Recorded, si: Any, wi: Direction, wo: Direction, given: list, active: Value, differentiable: bool
    ) -> Any:
        """f · |cos θ_o|, with the factors of the plugin; 0 where it is not active."""
        mi, dr = self.mi, self.dr
        n = kernels.n_numbers
        numbers = noise.numbers(si, mi.Vector3f(*wo), n * self.paths, self.seed)
        total = mi.UnpolarizedSpectrum(0)
        for k in range(self.paths if n else 1):
            mine = numbers[k * n : (k + 1) * n]

            def value(mine: Sequence[Value] = mine) -> Sequence[Value]:
                return kernels.value(wi, wo, given, mine, differentiable)

            total += mi.UnpolarizedSpectrum(
                *(value() if differentiable else self._where(active, value, kernels.n_channels))
            )
        total /= self.paths if n else 1
        scales = [texture.eval(si, active) for texture in self.scales.values()]
        if len(scales) == 2:
            total *= dr.select(wi[2] * wo[2] < 0, scales[1], scales[0])
        elif scales:
            total *= scales[0]
        return dr.select(active, total, mi.UnpolarizedSpectrum(0))

    def _where(self, active: Value, numbers: Callable[[], Sequence[Value]], count: int) -> Sequence[Value]:
        """That many numbers where `active`, and 0 elsewhere; nothing is computed for a packet of lanes none of which is."""
        return self.dr.if_stmt((), active, lambda: tuple(numbers()), lambda: (self.mi.Float(0),) * count)

    def _polarized(self, value: Any) -> Any:
        return self.mi.mueller.depolarizer(value) if self.mi.is_polarized else value
