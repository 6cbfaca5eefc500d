"""Runs the kernels of a BSDF as machine code: one program for any number of rows and paths.

A kernel is recorded on one element with its parameters, and the other tensors of its BSDF, as inputs; so another BSDF of
the same classes, or the same one after a step of training, runs the same code. Where that cannot be done it runs in blocks.
"""

import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import torch
from rich.console import Console
from torch import Tensor

from torchms.evaluation import blocks, threads
from torchms.evaluation.arguments import is_checked
from torchms.evaluation.inputs import Inputs
from torchms.evaluation.kernel import Kernel
from torchms.evaluation.numbers import Source, Without, source
from torchms.evaluation.program import Compiled, Differentiated
from torchms.evaluation.recent import Recent
from torchms.evaluation.signature import Signature
from torchms.machine.record import UnknownOperation
from torchms.parameters.declared import Parametric
from torchms.sampling.stream import Stream

MOST_PROGRAMS = 256
MOST_RECENT = 32
"""Calls of a BSDF that are remembered: of its kernels, on batches of several shapes."""

_programs: dict[Signature, Compiled | None] = {}
"""Those of this process, for all BSDFs of the same structure; None where there can be no machine code."""

_console = Console(stderr=True)


class Engine:
    """Runs the kernels of BSDFs as machine code, which is made at their first call.

    verbose: whether that shows on stderr. exact: whether results are rounded as in eager mode, operation by operation.
    """

    def __init__(self, verbose: bool, exact: bool = False) -> None:
        self.verbose, self.exact = verbose, exact
        self.compiled: dict[Signature, Compiled | None] = {}
        self.last: dict[tuple[Any, ...], Recent] = {}

    def __deepcopy__(self, memo: dict[int, Any]) -> "Engine":
        return Engine(self.verbose, self.exact)

    def __reduce__(self) -> tuple[Any, ...]:
        return Engine, (self.verbose, self.exact)

    def run(
        self,
        kernel: Kernel,
        bsdf: Parametric,
        directions: Sequence[Tensor],
        numbers: Source,
        look: Callable[[], None] = lambda: None,
    ) -> tuple[Tensor, ...]:
        """What `blocks.run` gives. look: raises for values that checked mode refuses; called where some may be bad."""
        if not (torch.compiler.is_compiling() or directions[0].device.type != "cpu" or threads.bound_to_this_thread()):
            batch = blocks.batch_shape(bsdf, directions, numbers)
            inputs = Inputs.of(bsdf, batch, directions, numbers) if batch.numel() else None
            program = None if inputs is None else self._program(kernel, bsdf, inputs)
            if inputs is not None and program is not None:
                inputs.look = look if is_checked() else None
                self._remember(kernel, bsdf, directions, batch, inputs, program)
                return self._evaluated(program, inputs, batch)
        look()
        return blocks.run(kernel, bsdf, directions, numbers)

    def _evaluated(self, program: Compiled, inputs: Inputs, batch: torch.Size) -> tuple[Tensor, ...]:
        if torch.is_grad_enabled() and any(x.requires_grad for x in inputs.tensors):
            found = Differentiated.apply(program, inputs, *inputs.tensors)
        else:
            found = program.values(inputs)
        return tuple(out.reshape((*batch, *out.shape[1:])) if len(batch) != 1 else out for out in found)

    # Calls like the last one.

    def recent(self, kernel: Kernel, bsdf: Parametric, given: tuple[Any, ...], u: Any) -> Recent | None:
        """The last call of this kernel, if a call with these arguments is like it."""
        last = self.last.get(_likeness(kernel, given))
        if last is None or torch.compiler.is_compiling() or threads.bound_to_this_thread():
            return None
        return last if last.fits(bsdf, given, u if last.numbers is not None else None) else None

    def again(
        self, last: Recent, directions: tuple[Tensor, ...], u: Tensor | Stream | None, look: Callable[[], None]
    ) -> tuple[Tensor, ...]:
        """What `run` gives for a call that is like the last one."""
        checked = is_checked()
        if last.plan is not None and (
            done := last.plan.run(directions, u if last.numbers is not None else None, checked)
        ):
            found, bad = done
            if bad:
                look()
            return found
        numbers = source(u, last.n_uniforms, last.dtype) if last.numbers is not None else Without()
        inputs = Inputs.with_rest(last.bsdf, last.batch, directions, numbers, last.rest)
        inputs.look = look if checked else None
        return self._evaluated(last.program, inputs, last.batch)

    def _remember(
        self,
        kernel: Kernel,
        bsdf: Parametric,
        directions: Sequence[Tensor],
        batch: torch.Size,
        inputs: Inputs,
        program: Compiled,
    ) -> None:
        rest = inputs.rest
        known = {id(x) for x in (*bsdf.parameters(), *bsdf.buffers())}
        # A view does not follow a tensor whose storage is exchanged; a copy of a BSDF is not that of the next call.
        if getattr(bsdf, "engine", None) is not self or not all(id(x) in known for _, x in rest):
            return
        last = Recent(kernel, bsdf, tuple(directions), inputs, batch, program)
        if last.snapshot.comparable:
            while len(self.last) >= MOST_RECENT:
                del self.last[next(iter(self.last))]
            self.last[_likeness(kernel, directions)] = last

    def _program(self, kernel: Kernel, bsdf: Parametric, inputs: Inputs) -> Compiled | None:
        """The program for these inputs, which is made if there is none."""
        signature = inputs.signature(kernel, self.exact)
        if signature not in self.compiled:
            if signature not in _programs:
                while len(_programs) >= MOST_PROGRAMS:
                    del _programs[next(iter(_programs))]
                _programs[signature] = self._compile(signature, bsdf, inputs)
            self.compiled[signature] = _programs[signature]
        return self.compiled[signature]

    def _compile(self, signature: Signature, bsdf: Any, inputs: Inputs) -> Compiled | None:
        """Record the kernel and build its machine code; None, with a warning, where that cannot be done."""
        of = f"{type(bsdf).__name__}, {type(bsdf.scattering).__name__} of {bsdf.max_order} orders"
        try:
            return Compiled(signature, inputs, f"{signature.kernel.name} of {of}", self.announced)
        except (UnknownOperation, RuntimeError) as error:
            warnings.warn(
                f"torchms.compile: {signature.kernel.name} of {of} runs eagerly, because there is no machine code for it: "
                f"{error}",
                RuntimeWarning,
                stacklevel=2,
            )
            return None

    def announced(self, what: str) -> "_Announced":
        """Shows on stderr what is being compiled, and how long it took."""
        return _Announced(what if self.verbose else "")


def _likeness(kernel: Kernel, given: Sequence[Any]) -> tuple[Any, ...]:
    """By what the last call like another one is found."""
    return kernel.name, torch.is_grad_enabled(), *(getattr(x, "shape", None) for x in given)


class _Announced:
    def __init__(self, what: str) -> None:
        self.what = what

    def __enter__(self) -> None:
        self.start = time.perf_counter()
        self.status = _console.status(f"torchms.compile: {self.what} …") if self.what else None
        if self.status is not None:
            self.status.start()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self.status is not None:
            self.status.stop()
            if kind is None:
                seconds = time.perf_counter() - self.start
                _console.print(f"torchms.compile: {self.what}: {seconds:.1f} s", highlight=False)
