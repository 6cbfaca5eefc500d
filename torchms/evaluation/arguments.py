"""What a BSDF looks at before it computes; in the checked mode also the values of directions, numbers and parameters."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch._C._functorch import is_functorch_wrapped_tensor

from torchms.maths.frame import conversion, kind_of
from torchms.maths.numerics import has_values
from torchms.parameters.declared import Parameter, first_bad
from torchms.parameters.exchange import parameters
from torchms.sampling.stream import Stream

UNIT = 1e-3
"""Most that |w|² of a direction may differ from 1; a few units in the last place for shorter dtypes."""

CHUNK = 16384
"""Rows that are looked at together: what is computed of them stays in the cache."""

_checked = True


def set_validation(enabled: bool) -> bool:
    """Switch the checked mode on (as it is at first) or off, for the whole process; returns what it was.

    Checked, every method of a BSDF raises ValueError for a direction that is NaN, infinite or not of unit length
    (| |w|² − 1 | ≤ 1e-3), which eager code looks for in a pass over the directions, 2 to 3 ns each, and machine code on its
    way; for a random number outside of [0, 1), save 1 itself, to which one may have been rounded; and for a parameter that
    has left its range since it was declared, as an optimizer may move it. Unchecked, all are used as they are: a NaN gives a
    row that is 0 or NaN, another length or number gives the value of no surface, and other rows keep their bits and their
    gradients either way.
    While a graph is traced (`torch.compile`, `torch.export`, ONNX, fake tensors) and inside `torch.func` transforms of the
    directions nothing is checked. Raises TypeError if `enabled` is not a bool.
    """
    global _checked
    if not isinstance(enabled, bool):
        raise TypeError(f"set_validation(enabled) must be True or False; got {enabled!r}.")
    before, _checked = _checked, enabled
    return before


def is_checked() -> bool:
    """Whether the checked mode is on."""
    return _checked


def check_values(module: nn.Module | None, directions: Mapping[str, Tensor], u: Tensor | Stream | None) -> None:
    """Raise ValueError, in checked mode, for a direction (*batch, 3) that is not of unit length, a number not in [0, 1] or a
    parameter of `module`, if there is one, out of its range.

    The host reads the result on the CPU block by block, from another device once.
    """
    if not _checked or torch.compiler.is_compiling():
        return
    given = directions if not isinstance(u, Tensor) else {**directions, "u": u}
    known = {name: x for name, x in given.items() if x.numel() and not _has_no_values(x)}
    # Beside fake directions nothing can be read, parameters that have values neither.
    traced = not all(has_values(x) for x in directions.values())
    with torch.no_grad():
        bad = {name: _strays(x) if name in directions else _leaves(x) for name, x in known.items()}
        declared = {} if module is None or traced else parameters(module)
        valued = {name: p for name, p in declared.items() if p.value.numel() and not _has_no_values(p.value)}
        bad |= {name: _out_of_range(record, value.detach()) for name, (record, value) in valued.items()}
        waiting = [x for x in bad.values() if isinstance(x, Tensor)]
        if waiting and not bool(torch.stack(waiting).any()):
            return
        for name, x in known.items():
            if bad[name]:
                (_refuse_direction if name in directions else _refuse_number)(name, x.detach())
        for name, (record, value) in valued.items():
            if bad[name] and module is not None:
                _refuse_parameter(module, name, record, value.detach())


def check_finite(vectors: Mapping[str, Tensor]) -> None:
    """Raise ValueError, in checked mode, for a vector (*batch, 3) of any length with a NaN or an infinity in it."""
    if not _checked or torch.compiler.is_compiling():
        return
    known = {name: x for name, x in vectors.items() if x.numel() and not _has_no_values(x)}
    with torch.no_grad():
        # A sum that is finite has no term that is not, and one pass makes it.
        doubtful = [~_seen_once(x, 1).sum().isfinite() for x in known.values()]
        if not doubtful or not bool(torch.stack([x.to(doubtful[0].device) for x in doubtful]).any()):
            return
        for name, x in known.items():
            bad = ~x.isfinite()
            if bool(bad.any()):
                raise ValueError(
                    f"{name} must hold finite vectors; got {first_bad(bad, x)}. A zero vector stands for a pixel where "
                    "nothing is; torchms.set_validation(False) skips this check."
                )


def check_random(u: Tensor | Stream | None, D: int, optional: bool, caller: str) -> None:
    """Raise TypeError or ValueError if `u`, which may be left out if `optional`, gives no D numbers a path."""
    if u is None and not optional:
        raise ValueError(
            f"{caller}() needs random numbers: u is missing. "
            f"Draw them with u = bsdf.uniforms(batch_shape, n_paths), which gives (*batch, N, {D}), "
            "or give a Stream(seed, n_paths)."
        )
    if u is None or isinstance(u, Stream):
        return
    if not isinstance(u, Tensor) or not u.is_floating_point() or u.layout != torch.strided:
        raise TypeError(
            f"u must be a Stream or a floating-point Tensor (*batch, N, {D}); got {kind_of(u)}.{conversion(u)}"
        )
    if u.ndim < 2 or u.shape[-1] != D or u.shape[-2] < 1:
        raise ValueError(
            f"u must be (*batch, N, D) with N >= 1 and D = {D} for this BSDF; got shape {tuple(u.shape)}. "
            "Draw it with bsdf.uniforms(batch_shape, n_paths)."
        )


def check_block(block: int | None, compiled: bool, caller: str) -> None:
    """Raise TypeError or ValueError if `block` is no size of a block, or what runs has one of its own."""
    if block is None:
        return
    if isinstance(block, bool) or not isinstance(block, int):
        raise TypeError(f"{caller}(block=...) must be an int or None; got {block!r}.")
    if block < 1:
        raise ValueError(
            f"{caller}(block=...) must be at least 1; got {block}. Leave it out for the size that is fastest."
        )
    if compiled:
        raise ValueError(
            f"{caller}(block={block}): compiled code runs in blocks of the size that it was compiled for. "
            "Leave block out, or evaluate the BSDF that is not compiled."
        )


def check_parameters(module: nn.Module, given: Mapping[str, Tensor]) -> None:
    """Raise if parameters are of a dtype too short to compute in, or not on the device of the tensors that are given."""
    for name, p in (*module.named_parameters(), *module.named_buffers()):
        if p.is_floating_point() and torch.finfo(p.dtype).bits < 32:
            raise TypeError(
                f"torchms computes in float32 or float64; {name} of this {type(module).__name__} is {p.dtype}. "
                "Convert it: bsdf.float()."
            )
        for argument, x in given.items():
            if x.device != p.device:
                raise ValueError(
                    f"{argument} is on device {x.device}, {name} of this {type(module).__name__} on {p.device}. "
                    f"Move one of them: bsdf.to({str(x.device)!r})."
                )


def _seen_once(x: Tensor, trailing: int) -> Tensor:
    """`x` without what is the same along an axis, save the `trailing` ones: it is looked at once."""
    axes = x.stride()[: x.ndim - trailing]
    return x.detach()[tuple(slice(0, 1) if stride == 0 else slice(None) for stride in axes)]


def _strays(w: Tensor) -> bool | Tensor:
    """Whether some |w|² is not near 1; off the CPU a tensor that says so, which nobody has waited for."""
    seen, most = _seen_once(w, 1).reshape(-1, 3), slack(w)
    here = _on_host(w)
    bad: bool | Tensor = False
    for part in seen.split(CHUNK) if here else (seen,):
        x, y, z = part.unbind(-1)
        bad = _outside((x * x).addcmul_(y, y).addcmul_(z, z), 1 - most, 1 + most)
        if here and bad:
            break
    return bad


def _leaves(u: Tensor) -> bool | Tensor:
    """Whether a number is not in [0, 1]; off the CPU a tensor."""
    seen = _seen_once(u, 0)
    # In the order of memory, whatever that of the axes: what is contiguous is read six times as fast.
    return _outside(seen.permute(sorted(range(seen.ndim), key=seen.stride, reverse=True)), 0.0, 1.0)


def _outside(x: Tensor, least: float, most: float) -> bool | Tensor:
    """Whether an element is not in [least, most], also because it is NaN, which `aminmax` hands on."""
    low, high = torch.aminmax(x)
    if _on_host(x):
        return not (float(low) >= least and float(high) <= most)
    return ~((low >= least) & (high <= most))


def _out_of_range(record: Parameter, value: Tensor) -> bool | Tensor:
    """Whether an element is not in the declared range; off the CPU a tensor."""
    if not _on_host(value):
        return record.outside(torch.stack(torch.aminmax(value))).any()
    low, high = (float(value),) * 2 if value.numel() == 1 else map(float, torch.aminmax(value))
    inside = (low > record.low if record.open_low else low >= record.low) and high <= record.high
    # The ends of the range, rounded to the dtype of the value, belong to it.
    return not inside and bool(record.outside(value).any())


def _on_host(x: Tensor) -> bool:
    """Whether a number of `x` costs nothing to read."""
    return x.device.type == "cpu"


def slack(w: Tensor) -> float:
    """Most that |w|² may differ from 1, by the dtype of `w`."""
    return max(UNIT, 4 * torch.finfo(w.dtype).eps)


def _has_no_values(w: Tensor) -> bool:
    """Whether `w` stands for values that are not known now: traced, fake, or one of many under a transform."""
    return not has_values(w) or is_functorch_wrapped_tensor(w)


def _refuse_direction(name: str, w: Tensor) -> None:
    length2, most = (w * w).sum(-1), slack(w)
    bad = ~((length2 - 1).abs() <= most)
    flat = int(bad.reshape(-1).to(torch.uint8).argmax())
    value = ", ".join(f"{x:g}" for x in w.reshape(-1, 3)[flat].tolist())
    raise ValueError(
        f"{name} must hold unit vectors: |{name}|² within {most:g} of 1; got {first_bad(bad, length2)}, where {name} = "
        f"({value}). Use torch.nn.functional.normalize({name}, dim=-1), or torchms.set_validation(False) to skip this check."
    )


def _refuse_number(name: str, u: Tensor) -> None:
    bad = ~((u >= 0) & (u <= 1))
    raise ValueError(
        f"{name} must hold numbers in [0, 1); got {first_bad(bad, u)}. Draw them with bsdf.uniforms(batch_shape, "
        "n_paths), or use torchms.set_validation(False) to skip this check."
    )


def _refuse_parameter(module: nn.Module, name: str, record: Parameter, value: Tensor) -> None:
    raise ValueError(
        f"{name} of this {type(module).__name__} must lie in {record.range}; got {first_bad(record.outside(value), value)}. "
        f"{record.remedy} torchms.constrain(bsdf, {name!r}) keeps it there while it is trained; "
        "torchms.set_validation(False) skips this check."
    )


def given_batches(directions: Mapping[str, Tensor], u: Tensor | Stream | None) -> list[torch.Size]:
    """The batch shapes of what a method is given."""
    shapes = [w.shape[:-1] for w in directions.values()]
    return shapes if u is None else [*shapes, u.shape[:-2] if isinstance(u, Tensor) else u.batch_shape]
