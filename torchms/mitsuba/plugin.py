"""Mitsuba's class around a surface, and its registration in every variant."""

from importlib import import_module
from typing import Any

from torchms.mitsuba.llvm import OLDEST, find_llvm
from torchms.mitsuba.materials import MATERIALS
from torchms.mitsuba.surface import Surface

_watching = False


def register() -> None:
    """Make `torchms_conductor`, `torchms_dielectric`, `torchms_diffuse` and `torchms_metallic_roughness` plugins of Mitsuba.

    They serve in XML files and dictionaries, in the variant that is set, and in every one that is set from then on. Raises
    ImportError without Mitsuba 3.
    """
    global _watching
    try:
        mi = import_module("mitsuba")
    except ImportError as error:
        raise ImportError("torchms.mitsuba needs Mitsuba 3: pip install torchms[mitsuba].") from error
    if mi.variant() is not None:
        _register()
    if not _watching:
        mi.detail.add_variant_callback(lambda before, now: _register())
        _watching = True


def set_variant(name: str) -> Any:
    """Mitsuba, in the variant `name`, with the plugins.

    Raises ImportError without Mitsuba 3, and for llvm variants where no library is found that Dr.Jit works with.
    """
    register()
    if name.startswith("llvm") and find_llvm() is None:
        raise ImportError(
            f"{name} needs an LLVM of version {OLDEST} or later (Debian: libllvm19), or its path in DRJIT_LIBLLVM_PATH."
        )
    mi = import_module("mitsuba")
    mi.set_variant(name)
    return mi


def _register() -> None:
    mi = import_module("mitsuba")
    for name in MATERIALS:
        mi.register_bsdf(name, _plugin(name))


def _plugin(name: str) -> type:
    """The class of a plugin, of the variant's own base class."""
    mi = import_module("mitsuba")

    class Plugin(mi.BSDF):
        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.surface = Surface(name, props)
            sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide if self.surface.transmits else mi.BSDFFlags.FrontSide
            self.m_components = [flag | +sides for flag in self.surface.flags]
            self.m_flags = 0
            for flag in self.m_components:
                self.m_flags |= flag

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            return self.surface.sample(ctx, si, sample1, sample2, active)

        def value(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.surface.eval_pdf(ctx, si, wo, active, "value")[0]

        eval = value

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.surface.eval_pdf(ctx, si, wo, active, "pdf")[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.surface.eval_pdf(ctx, si, wo, active, "value and pdf")

        def traverse(self, callback: Any) -> None:
            for key, value in self.surface.parameters().items():
                callback.put(key, value, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Any) -> None:
            self.surface.changed()

        def to_string(self) -> str:
            return f"{name}[{', '.join(f'{k} = {v}' for k, v in self.surface.parameters().items())}]"

    return Plugin
