"""A front to ONNX Runtime for the files of `export`: names, shapes and dtypes are checked, rows go in blocks."""

import json
import math
import sys
from collections import namedtuple
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchms.extras import missing
from torchms.onnx import seal

BLOCK_ROWS = 16384
"""Rows × paths that go to the runtime at a time."""

MOST_BYTES = 1 << 28
"""Of a file that is read; `export` writes some 10 kB."""

LANES = 64
"""A block has a multiple of so many rows."""

_REFERENCE = b"location"
"""The key of a tensor's `external_data` that holds the name of a file; no file of ours has the word."""

Array = NDArray[Any]


class Input:
    """An input of a file: its name, dtype, shape after the batch axis, and range."""

    def __init__(self, entry: dict[str, Any]) -> None:
        self.name: str = entry["name"]
        self.dtype = np.dtype(entry["dtype"])
        self.tail: list[int | str] = entry["shape"][1:]
        self.low: float | None = entry.get("low")
        self.high: float | None = entry.get("high")

    def __repr__(self) -> str:
        shape = ", ".join(["batch", *map(str, self.tail)])
        return f"{self.name} ({shape}) {self.dtype}"


class Evaluator:
    """An exported file, ready to run: `Evaluator("cu.onnx")(wi, wo, u, alpha=0.3)`.

    Takes NumPy arrays or CPU tensors (and gives back tensors if one of them was a tensor), in the order of `inputs` or
    by name. Batch axes (*batch) broadcast; parameters may be plain numbers or lists. The result is (*batch, ...): one
    array, or a named tuple where the file has two outputs. The work is done in blocks of `block` rows × paths, so
    memory does not grow with the batch beyond inputs and outputs. A row's bits depend on nothing but its inputs: not on
    its place in the batch, nor on `block` or `threads`.

    threads: how many blocks are evaluated at a time, each by one thread. block: rows × paths of one. verify: whether
    the seal is checked.
    Raises ValueError for a file that `torchms.onnx.export` did not write, that is damaged, or that is of a newer
    format; FileNotFoundError for none; ImportError if onnxruntime is missing. A call raises TypeError for missing or
    unknown inputs and wrong dtypes, ValueError for shapes and for parameters out of range.
    """

    def __init__(self, path: str | Path, *, threads: int = 1, block: int = BLOCK_ROWS, verify: bool = True) -> None:
        if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
            raise ValueError(f"Evaluator(threads=...) must be an int of 1 or more; got {threads!r}.")
        if isinstance(block, bool) or not isinstance(block, int) or block < 1:
            raise ValueError(f"Evaluator(block=...) must be an int of 1 or more; got {block!r}.")
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}. Write it with torchms.onnx.export(bsdf, path).")
        if (size := path.stat().st_size) > MOST_BYTES:
            raise ValueError(
                f"{path.name} is of {size} bytes; at most {MOST_BYTES} are read. torchms writes no such file."
            )
        content = path.read_bytes()
        if verify:
            seal.check(content, path.name)
        if _REFERENCE in content:  # the runtime would read whatever file is named
            raise ValueError(f"{path.name} refers to data in other files, which torchms never writes. Export it again.")
        self.session = _session(content, path.name)
        self.metadata: dict[str, str] = dict(self.session.get_modelmeta().custom_metadata_map)
        if "torchms.inputs" not in self.metadata:
            raise ValueError(
                f"{path.name} was not written by torchms.onnx.export: it does not say what its inputs are."
            )
        try:
            self.inputs = tuple(Input(entry) for entry in json.loads(self.metadata["torchms.inputs"]))
            self.outputs: tuple[dict[str, Any], ...] = tuple(json.loads(self.metadata["torchms.outputs"]))
            self._result = namedtuple("Outputs", [entry["name"] for entry in self.outputs])
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            raise ValueError(
                f"{path.name}: what it says of its inputs and outputs cannot be read ({error})."
            ) from error
        self.threads, self.block = threads, block

    def __repr__(self) -> str:
        return (
            f"Evaluator({self.metadata['torchms.what']} of {self.metadata['torchms.material']}; "
            f"inputs {', '.join(map(repr, self.inputs))})"
        )

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        given = self._named(arguments, named)
        tensors = any(_is_tensor(value) for value in given.values())
        arrays = {each.name: self._array(each, given[each.name]) for each in self.inputs}
        batch, paths = self._shapes(arrays)
        flat = {each.name: self._flat(arrays[each.name], each, batch, paths) for each in self.inputs}
        results = self._run(flat, math.prod(batch), paths)
        shaped = [result.reshape(*batch, *result.shape[1:]) for result in results]
        if tensors:
            torch = sys.modules["torch"]
            shaped = [torch.from_numpy(result) for result in shaped]
        return shaped[0] if len(shaped) == 1 else self._result(*shaped)

    def _named(self, arguments: Sequence[Any], named: dict[str, Any]) -> dict[str, Any]:
        names = [each.name for each in self.inputs]
        if len(arguments) > len(names):
            raise TypeError(f"this file takes {len(names)} inputs ({', '.join(names)}); got {len(arguments)}.")
        given = dict(zip(names, arguments, strict=False))
        for name, value in named.items():
            if name not in names:
                raise TypeError(f"this file has no input {name!r}; it has {', '.join(names)}.")
            if name in given:
                raise TypeError(f"input {name!r} is given twice.")
            given[name] = value
        missing = [repr(each) for each in self.inputs if each.name not in given]
        if missing:
            raise TypeError(f"inputs are missing: {'; '.join(missing)}.")
        return given

    def _array(self, each: Input, value: Any) -> Array:
        if _is_tensor(value):
            if value.device.type != "cpu":
                raise TypeError(f"{each.name} is on {value.device}; the runtime takes CPU tensors. Move it: .cpu().")
            value = value.detach().resolve_neg().resolve_conj().numpy()
        if isinstance(value, np.ndarray):
            if value.dtype != each.dtype:
                raise TypeError(f"{each.name} must be {each.dtype}; got {value.dtype}. Convert it first.")
            array = value
        elif isinstance(value, int | float | list | tuple) and not isinstance(value, bool):
            array = np.asarray(value)
            if array.dtype.kind not in ("iu" if each.dtype.kind == "i" else "iuf"):
                raise TypeError(f"{each.name} must hold numbers of {each.dtype}; got {value!r}.")
            array = array.astype(each.dtype)
        else:
            raise TypeError(f"{each.name} must be an array, a tensor or a number; got {type(value).__name__}.")
        tail = array.shape[array.ndim - len(each.tail) :] if array.ndim >= len(each.tail) else None
        fits = tail is not None and all(
            size == want or (isinstance(want, str) and size > 0) or (size == 1 and each.low is not None)
            for size, want in zip(tail, each.tail, strict=True)
        )
        if not fits and each.low is not None and array.ndim == 0:
            array, fits = array.reshape(1), True
        if not fits:
            shape = ", ".join(["*batch", *map(str, each.tail)])
            raise ValueError(f"{each.name} must be ({shape}); got shape {array.shape}.")
        if each.low is not None and each.high is not None and array.size:
            least, most = float(array.min()), float(array.max())
            slack = 1e-6 * abs(each.low)
            if not (least >= each.low - slack and most <= each.high * (1 + 1e-6)):
                bad = most if most > each.high else least
                raise ValueError(f"{each.name} must lie in [{each.low:g}, {each.high:g}]; got {bad:g}.")
        return array

    def _shapes(self, arrays: dict[str, Array]) -> tuple[tuple[int, ...], int]:
        """The batch to which the inputs broadcast, and the number of paths of each row."""
        shapes = {each.name: arrays[each.name].shape[: arrays[each.name].ndim - len(each.tail)] for each in self.inputs}
        try:
            batch = np.broadcast_shapes(*shapes.values())
        except ValueError:
            listing = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ValueError(f"batch shapes do not broadcast: {listing}.") from None
        declared = self.metadata["torchms.n_paths"]
        return batch, int(declared) if declared.isdigit() else arrays["u"].shape[-2]

    def _flat(self, array: Array, each: Input, batch: tuple[int, ...], paths: int) -> Array:
        """(rows, tail), or (1, tail) if all rows share it."""
        tail = tuple(paths if isinstance(size, str) else size for size in each.tail)
        own = array.shape[: array.ndim - len(tail)]
        array = np.broadcast_to(array, (*own, *tail))
        if math.prod(own) == 1:
            return array.reshape(1, *tail)
        return np.broadcast_to(array, (*batch, *tail)).reshape(-1, *tail)

    def _run(self, flat: dict[str, Array], rows: int, paths: int) -> list[Array]:
        step = -(-max(1, self.block // paths) // LANES) * LANES
        first, *starts = range(0, max(rows, 1), step)
        head = self._block(flat, first, min(step, rows), rows)
        if not starts:
            return head
        results = [np.empty((rows, *out.shape[1:]), out.dtype) for out in head]

        def put(a: int, outputs: list[Array] | None = None) -> None:
            size = min(step, rows - a)
            for result, out in zip(results, outputs or self._block(flat, a, size, rows), strict=True):
                result[a : a + size] = out

        put(first, head)
        if self.threads == 1:
            for a in starts:
                put(a)
        else:
            with ThreadPoolExecutor(self.threads) as pool:
                for _ in pool.map(put, starts):
                    pass
        return results

    def _block(self, flat: dict[str, Array], a: int, size: int, rows: int) -> list[Array]:
        """Rows a … a + size, computed as full vectors: at the end of an array the runtime's sine, cosine and logarithm
        have other last bits."""
        padded = max(-(-size // LANES), 1) * LANES
        feed = {}
        for name, array in flat.items():
            if len(array) != rows or rows == 1:
                part = np.broadcast_to(array[:1], (padded, *array.shape[1:])) if len(array) else array[:0]
            else:
                part = array[a : a + size]
            if len(part) < padded:
                end = part[-1:] if len(part) else np.ones((1, *array.shape[1:]), array.dtype)
                part = np.concatenate([part, np.broadcast_to(end, (padded - len(part), *array.shape[1:]))])
            feed[name] = np.ascontiguousarray(part)
        return [out[:size] for out in self.session.run(None, feed)]


def runtime() -> Any:
    """ONNX Runtime, or an ImportError that says how to get it."""
    try:
        import onnxruntime
    except ImportError as error:
        raise missing("Evaluator", "onnxruntime") from error
    return onnxruntime


def _session(content: bytes, name: str) -> Any:
    onnxruntime = runtime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = 1, 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises classes of its own that it does not export
        raise ValueError(f"{name} cannot be loaded by onnxruntime {onnxruntime.__version__}: {error}") from error


def _is_tensor(value: Any) -> bool:
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)
