"""The parameters of a plugin as Mitsuba names them: textures and numbers, what may be asked of them, where they may lie."""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any

Value = Any


def chosen(plugin: str, props: Any, name: str, known: Sequence[str]) -> str:
    """The string property `name`, one of `known`, the first if it is not given; ValueError otherwise."""
    found = props.get(name, known[0])
    if found not in known:
        raise ValueError(f"{plugin}: {name} must be one of {', '.join(known)}; got {found!r}.")
    return found


def whole(plugin: str, props: Any, name: str, default: int, least: int, most: int) -> int:
    """The integer property `name`, in [least, most]; ValueError otherwise."""
    found = props.get(name, default)
    if isinstance(found, bool) or not isinstance(found, int) or not least <= found <= most:
        raise ValueError(f"{plugin}: {name} must be a whole number in [{least}, {most}]; got {found!r}.")
    return found


def borrowed(plugin: str, props: Any, names: Iterable[str], which: str) -> Any:
    """The texture or number `which` that Mitsuba's own `plugin` makes of those of its properties `names` that are given."""
    mi = import_module("mitsuba")
    own = mi.load_dict({"type": plugin} | {name: props[name] for name in names if name in props})
    found = []

    class Seen(mi.TraversalCallback):
        def put(self, name: str, value: Any, flags: int, *rest: Any) -> None:
            if name == which:
                found.append(value)

    # A class lives until Python's collector comes by. `own` must not live with it: Mitsuba compiles every BSDF there is.
    own.traverse(Seen())
    value = found.pop()
    # What is no object comes as an address, which only Mitsuba can read.
    return value if isinstance(value, mi.Texture) else mi.traverse(own)[which]


def alphas(plugin: str, props: Any) -> dict[str, Any]:
    """The roughness: `alpha`, or `alpha_u` and `alpha_v`; 0.1 where it is not given, as in Mitsuba."""
    split = [name for name in ("alpha_u", "alpha_v") if name in props]
    if split and "alpha" in props:
        raise ValueError(f"{plugin}: give either alpha, or alpha_u and alpha_v; got alpha and {' and '.join(split)}.")
    names = ("alpha_u", "alpha_v") if split else ("alpha",)
    return {name: props.get_texture(name, 0.1) for name in names}


def check_range(plugin: str, values: Mapping[str, Any], low: float, high: float, remedy: str) -> None:
    """ValueError if a number, a constant or a bitmap among `values` leaves [low, high]. Other textures cannot be looked at."""
    mi, dr = import_module("mitsuba"), import_module("drjit")
    for name, value in values.items():
        found = {name: value}
        if isinstance(value, mi.Texture):
            shown = mi.traverse(value)
            found = {f"{name}.{key}": shown[key] for key in shown.keys() if key.split(".")[-1] in ("value", "data")}  # noqa: SIM118
        for key, numbers in found.items():
            flat = dr.detach(dr.ravel(numbers)) if dr.is_jit_v(numbers) else numbers
            flat = flat.array if dr.is_tensor_v(flat) else flat
            least, most = (float(f(flat)[0]) if dr.is_jit_v(flat) else float(f(flat)) for f in (dr.min, dr.max))
            # The range holds for numbers of any precision, as that of the kernels does.
            if not (least >= low * (1 - 1e-6) and most <= high * (1 + 1e-6)):
                bad = least if not least >= low * (1 - 1e-6) else most
                raise ValueError(f"{plugin}: {key} must lie in [{low:g}, {high:g}]; got {bad:g}. {remedy}")
