"""How fast is compiled torchms against scalar code, Mitsuba and itself? Ratios of one run, two threads each.

    python benchmarks/speed.py [section …] [--quick]
(sections: walks single checked backward scaling engines latency contention compiling bounds; all if none)

Times are medians of repetitions that alternate between the two sides, random numbers included. The yardstick of the
walks is benchmarks/yardstick.py (Numba), that of the single bounce Mitsuba's roughconductor. Checked mode is off,
as in the others, but for the section that measures it. Numbers go to results/speed.json, a section at a time.
"""

import argparse
import functools
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
import yardstick
from record import REPEATS, RESULTS, birth_certificate, compiled_anew, first_call, timed

import torchms as ms
from torchms.fresnel import Conductor, Ideal
from torchms.storage.write import write_json

ROWS = 1 << 20


def hemisphere(n: int, seed: int = 0) -> torch.Tensor:
    """Uniform directions above the horizon, (n, 3) whose components are contiguous."""
    generator = torch.Generator().manual_seed(seed)
    z, phi = torch.rand(n, generator=generator), 2 * math.pi * torch.rand(n, generator=generator)
    r = (1 - z * z).sqrt()
    return torch.stack([r * phi.cos(), r * phi.sin(), z]).T


def conductor(kind: str, alpha: float, scattering: ms.Scattering | None = None) -> ms.RoughConductor:
    distribution = {"ggx": ms.GGX, "beckmann": ms.Beckmann}[kind](alpha)
    return ms.RoughConductor(distribution, Ideal(), scattering or ms.SingleBounce())


def yard(kind: str) -> int:
    return yardstick.GGX if kind == "ggx" else yardstick.BECKMANN


def variance(values: torch.Tensor) -> torch.Tensor:
    return values.double().var(1)


def efficiency(kind: str, alpha: float, K: int, bsdf: ms.BSDF, ns: float, yard_ns: float) -> dict[str, float]:
    """Variance × time over that of the yardstick, geometric mean over 24 pairs of directions."""
    wi, wo = hemisphere(24, 1), hemisphere(24, 2)
    n = 40_000
    a = wi.repeat_interleave(n, 0).contiguous(), wo.repeat_interleave(n, 0).contiguous()
    ours = variance(bsdf(*a, ms.Stream(5))[:, 0].reshape(24, n))
    many = variance(
        torch.from_numpy(yardstick.evaluate(a[0].numpy(), a[1].numpy(), alpha, yard(kind), K, 9)).reshape(24, n)
    )
    # Beckmann has pairs that no walk of these many connects.
    seen = (ours > 0) & (many > 0)
    ratio = math.exp(float((ours[seen] / many[seen]).log().mean()))
    return {"variance_ratio": ratio, "variance_times_time_ratio": ratio * ns / yard_ns, "pairs": int(seen.sum())}


@torch.no_grad()
def walks(orders: tuple[int, ...] = (6,)) -> list[dict[str, Any]]:
    """Evaluations and walks against the scalar height walk."""
    rows = []
    wi, wo = hemisphere(ROWS, 1), hemisphere(ROWS, 2)
    wi_n, wo_n = wi.contiguous().numpy(), wo.contiguous().numpy()
    for kind in ("ggx", "beckmann"):
        fast: dict[str, ms.BSDF] = {}
        compile_seconds: dict[str, float] = {}
        alpha = torch.tensor(0.5)
        cases = {"unidirectional": (ms.Unidirectional, 8)}
        cases |= {f"bidirectional{K}": (ms.Bidirectional, K) for K in (orders if kind == "ggx" else ())}
        for a in (0.5, 1.0, 0.25):
            for name, (scattering, K) in cases.items():
                # One code serves every alpha: the engine takes it as an input.
                if name not in fast:
                    fast[name] = ms.compile(conductor(kind, 0.5, scattering(ms.Invariance(), K)))
                    compile_seconds[name] = first_call(lambda: fast[name](wi[:5], wo[:5], ms.Stream(1)))
                surface = fast[name]
                surface.distribution.alpha = alpha.fill_(a)
                call = functools.partial(surface, wi, wo, ms.Stream(1))
                base = functools.partial(yardstick.evaluate, wi_n, wo_n, a, yard(kind), K, 1)
                ours, theirs = (t / ROWS * 1e9 for t in timed(call, base))
                row: dict[str, Any] = {
                    "distribution": kind,
                    "alpha": a,
                    "estimator": name,
                    "max_order": K,
                    "compile_seconds": compile_seconds[name],
                    "ns": ours,
                    "yardstick_ns": theirs,
                    "speed_ratio": theirs / ours,
                } | efficiency(kind, a, K, surface, ours, theirs)
                if name == "unidirectional" and a < 1:
                    sample = functools.partial(surface.sample_walk, wi, ms.Stream(1))
                    base = functools.partial(yardstick.walk, wi_n, a, yard(kind), K, 1)
                    row["walk_ns"], row["yardstick_walk_ns"] = (t / ROWS * 1e9 for t in timed(sample, base))
                    row["walk_ratio"] = row["yardstick_walk_ns"] / row["walk_ns"]
                rows.append(row)
                print({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}, flush=True)
    return rows


@torch.no_grad()
def single() -> list[dict[str, Any]]:
    """The single bounce against Mitsuba, copper of three channels."""
    import drjit
    import mitsuba

    rows = []
    wi, wo = hemisphere(ROWS, 1), hemisphere(ROWS, 2)
    wi_n3, wo_n3 = wi.contiguous(), wo.contiguous()
    metal = Conductor.metal("Cu")
    fast = ms.compile(ms.RoughConductor(ms.GGX(0.3), metal, ms.SingleBounce()))
    stream = ms.Stream(1)
    ours = {
        "eval": (lambda: fast(wi, wo), lambda: fast(wi_n3, wo_n3)),
        "pdf": (lambda: fast.pdf(wi, wo), lambda: fast.pdf(wi_n3, wo_n3)),
        "sample": (lambda: fast.sample(wi, stream), lambda: fast.sample(wi_n3, stream)),
    }
    times = {what: timed(*calls) for what, calls in ours.items()}
    for variant in ("llvm_ad_rgb", "scalar_rgb"):
        mitsuba.set_variant(variant)
        plugin: Any = mitsuba.load_dict(
            {"type": "roughconductor", "material": "Cu", "distribution": "ggx", "alpha": 0.3}
        )
        context: Any = mitsuba.BSDFContext()
        si: Any = mitsuba.SurfaceInteraction3f()
        generator: Any = mitsuba.PCG32
        if variant == "scalar_rgb":
            n = 20_000
            first, second = mitsuba.Vector3f(*map(float, wi[0])), mitsuba.Vector3f(*map(float, wo[0]))
            si.wi = first
            point = mitsuba.Point2f(0.3, 0.6)
            # One call a row from Python: what a scalar variant costs there.
            calls = {
                "eval": lambda: [plugin.eval(context, si, second) for _ in range(n)],
                "pdf": lambda: [plugin.pdf(context, si, second) for _ in range(n)],
                "sample": lambda: [plugin.sample(context, si, 0.5, point) for _ in range(n)],
            }
        else:
            n = ROWS
            first, second = (
                mitsuba.Vector3f(*(drjit.llvm.ad.Float(c.contiguous().numpy()) for c in w.T)) for w in (wi, wo)
            )
            si.wi = first

            def draw() -> Any:
                sampler = generator(n)
                return plugin.sample(
                    context, si, sampler.next_float32(), mitsuba.Point2f(sampler.next_float32(), sampler.next_float32())
                )

            calls = {
                "eval": lambda: (lambda v: (drjit.eval(v), drjit.sync_thread()))(plugin.eval(context, si, second)),
                "pdf": lambda: (lambda v: (drjit.eval(v), drjit.sync_thread()))(plugin.pdf(context, si, second)),
                "sample": lambda: (lambda v: (drjit.eval(v[0].wo, v[0].pdf, v[1]), drjit.sync_thread()))(draw()),
            }
        for what, call in calls.items():
            theirs = timed(call)[0] / n
            components, vectors = (t / ROWS for t in times[what])
            row = {
                "what": what,
                "mitsuba": variant,
                "M_per_second": 1e-6 / components,
                "M_per_second_n3": 1e-6 / vectors,
                "mitsuba_M_per_second": 1e-6 / theirs,
                "ratio": theirs / components,
                "ratio_n3": theirs / vectors,
            }
            rows.append(row)
            print({k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}, flush=True)
    return rows


@torch.no_grad()
def checked() -> list[dict[str, Any]]:
    """What the checked mode costs a row of a compiled call on many rows, and a call on few."""
    fast = ms.compile(ms.RoughConductor(ms.GGX(0.3), Conductor.metal("Cu"), ms.SingleBounce()))
    rows = []
    for n in (64, ROWS):
        wi, wo = hemisphere(n, 1), hemisphere(n, 2)
        calls = {"eval": lambda i=wi, o=wo: fast(i, o), "pdf": lambda i=wi, o=wo: fast.pdf(i, o)}
        for what, call in calls.items():

            def in_mode(on: bool, call: Callable[[], Any] = call) -> None:
                before = ms.set_validation(on)
                call()
                ms.set_validation(before)

            on, off = timed(
                lambda f=in_mode: f(True), lambda f=in_mode: f(False), repeats=REPEATS if n > 4096 else 10 * REPEATS
            )
            rows.append({"what": what, "rows": n, "checked_us": on * 1e6, "unchecked_us": off * 1e6})
            rows[-1]["ns_a_row"] = (on - off) / n * 1e9
            print(rows[-1], flush=True)
    return rows


def backward() -> list[dict[str, Any]]:
    """Forward and backward to α, η and k against forward alone, compiled and eager."""
    rows = []
    n = ROWS // 8
    wi, wo = hemisphere(n, 1), hemisphere(n, 2)
    for name, scattering in (
        ("single bounce", ms.SingleBounce()),
        ("unidirectional invariance K=4", ms.Unidirectional(ms.Invariance(), 4)),
    ):
        eta, k = (torch.nn.Parameter(torch.tensor(v)) for v in ([0.2, 0.9, 1.1], [3.9, 2.5, 2.4]))
        eager = ms.RoughConductor(ms.GGX(torch.nn.Parameter(torch.tensor(0.5))), Conductor(eta, k), scattering)
        for engine, surface in (("compiled", ms.compile(eager)), ("eager", eager)):

            def forward(surface: ms.BSDF = surface) -> None:
                with torch.no_grad():
                    surface(wi, wo, ms.Stream(1))

            def both(surface: ms.BSDF = surface) -> None:
                surface(wi, wo, ms.Stream(1)).sum().backward()

            f, b = (t / n * 1e9 for t in timed(forward, both))
            rows.append({"case": name, "engine": engine, "forward_ns": f, "forward_backward_ns": b, "ratio": b / f})
            print(rows[-1], flush=True)
    return rows


@torch.no_grad()
def scaling() -> list[dict[str, Any]]:
    """ns a row and path against rows, paths and K."""
    rows = []
    for name, segment, orders in (("correlated", ms.Correlated, (2, 4, 8)), ("invariance", ms.Invariance, (2, 4, 8))):
        for K in orders:
            fast = ms.compile(conductor("ggx", 0.5, ms.Unidirectional(segment(), K)))
            for n, paths in [(ROWS, 1)] if K != 4 else [(10**k, 1) for k in range(0, 8)] + [(ROWS, 4), (ROWS // 4, 16)]:
                wi, wo = hemisphere(n, 1), hemisphere(n, 2)
                (t,) = timed(lambda f=fast, i=wi, o=wo, p=paths: f(i, o, ms.Stream(1, p)), repeats=3 if n > ROWS else 7)
                rows.append({"segment": name, "max_order": K, "rows": n, "paths": paths, "ns": t / n / paths * 1e9})
                print(rows[-1], flush=True)
    return rows


@torch.no_grad()
def engines() -> list[dict[str, Any]]:
    """Eager in blocks, compiled and ONNX Runtime on the same work; rounding between eager and compiled."""
    import tempfile

    from torchms.onnx import Evaluator, export

    rows = []
    n = ROWS // 4
    wi, wo = hemisphere(n, 1).contiguous(), hemisphere(n, 2).contiguous()
    for name, scattering in (
        ("single bounce", ms.SingleBounce()),
        ("unidirectional invariance K=4", ms.Unidirectional(ms.Invariance(), 4)),
    ):
        eager = conductor("ggx", 0.5, scattering)
        fast = ms.compile(eager)
        deterministic = scattering.max_order == 1
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "file.onnx"
            export(eager, path, uniforms="seed", n_paths=1)
            evaluator = Evaluator(path, threads=2)
        stream = ms.Stream(1)
        given = (wi, wo) if deterministic else (wi, wo, stream.seeds((n,)))
        times = timed(
            lambda e=eager: e(wi, wo, stream), lambda f=fast: f(wi, wo, stream), lambda v=evaluator, g=given: v(*g)
        )
        a, b = eager(wi, wo, stream), fast(wi, wo, stream)
        off = ((a - b).abs() / a.abs().clamp_min(1e-6)).flatten().sort().values
        row = {"case": name} | dict(
            zip(("eager_ns", "compiled_ns", "onnx_ns"), (t / n * 1e9 for t in times), strict=True)
        )
        row |= {"compiled_error_median": float(off[n // 2]), "compiled_error_999": float(off[n * 999 // 1000])}
        row |= {"compiled_error_max": float(off[-1])}
        rows.append(row)
        print(row, flush=True)
    return rows


CASES: dict[str, Callable[[], ms.Scattering]] = {
    "single bounce": ms.SingleBounce,
    "unidirectional invariance K=4": lambda: ms.Unidirectional(ms.Invariance(), 4),
}
SIZES = (1, 64, 4096, 65536)


def latency() -> list[dict[str, Any]]:
    """Microseconds of a call on few rows, copper of three channels: forward, and forward with backward to α, η and k."""
    import tempfile

    from torchms.onnx import Evaluator, export

    rows = []
    for name, scattering in CASES.items():
        eta, k = (torch.nn.Parameter(torch.tensor(v)) for v in ([0.2, 0.9, 1.1], [3.9, 2.5, 2.4]))
        eager = ms.RoughConductor(ms.GGX(torch.nn.Parameter(torch.tensor(0.5))), Conductor(eta, k), scattering())
        fast = ms.compile(eager)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "file.onnx"
            export(eager, path, uniforms="seed", n_paths=1)
            evaluator = Evaluator(path, threads=2)
        for n in SIZES:
            wi, wo, stream = hemisphere(n, 1).contiguous(), hemisphere(n, 2).contiguous(), ms.Stream(1)
            given = (wi, wo) if eager.max_order == 1 else (wi, wo, stream.seeds((n,)))

            def forward(surface: ms.BSDF, a: torch.Tensor = wi, b: torch.Tensor = wo) -> None:
                with torch.no_grad():
                    surface(a, b, ms.Stream(1))

            def both(surface: ms.BSDF, a: torch.Tensor = wi, b: torch.Tensor = wo) -> None:
                surface(a, b, ms.Stream(1)).sum().backward()

            times = timed(
                lambda f=forward: f(eager),
                lambda f=forward: f(fast),
                lambda v=evaluator, g=given: v(*g),
                lambda f=both: f(eager),
                lambda f=both: f(fast),
                repeats=REPEATS if n > 4096 else 10 * REPEATS,
            )
            names = ("eager_us", "compiled_us", "onnx_us", "eager_backward_us", "compiled_backward_us")
            rows.append({"case": name, "rows": n} | dict(zip(names, (t * 1e6 for t in times), strict=True)))
            # In turns the others drive it out of the caches; a renderer or a training calls it again at once.
            (again,) = timed(lambda f=forward: f(fast), repeats=30 * REPEATS)
            rows[-1]["compiled_again_us"] = again * 1e6
            print(rows[-1], flush=True)
    return rows


def _busy() -> None:
    while True:
        pass


@torch.no_grad()
def contention() -> list[dict[str, Any]]:
    """ns a row with one thread, with two, and with two while another process keeps one core busy."""
    import multiprocessing

    rows = []
    n = ROWS // 5
    wi, wo = hemisphere(n, 1), hemisphere(n, 2)
    before = torch.get_num_threads()
    eager = conductor("ggx", 0.5, ms.Unidirectional(ms.Invariance(), 8))
    for engine, surface in (("eager", eager), ("compiled", ms.compile(eager))):
        times = {}
        for label, threads, busy in (("one", 1, False), ("two", 2, False), ("two_busy", 2, True)):
            torch.set_num_threads(threads)
            other = multiprocessing.get_context("spawn").Process(target=_busy, daemon=True)
            if busy:
                other.start()
            (times[label],) = timed(lambda s=surface: s(wi, wo, ms.Stream(1)))
            if busy:
                other.terminate()
                other.join()
        torch.set_num_threads(before)
        row = {"engine": engine} | {f"{label}_ns": t / n * 1e9 for label, t in times.items()}
        row |= {"two_over_one": times["one"] / times["two"], "busy_over_idle": times["two_busy"] / times["two"]}
        rows.append(row)
        print(row, flush=True)
    return rows


def compiling() -> list[dict[str, Any]]:
    """Seconds of the first call and of the first backward, with an empty cache on disk."""
    rows = []
    wi, wo = hemisphere(5, 1), hemisphere(5, 2)
    cases = CASES | {
        "unidirectional invariance K=8": lambda: ms.Unidirectional(ms.Invariance(), 8),
        "bidirectional invariance K=6": lambda: ms.Bidirectional(ms.Invariance(), 6),
        "bidirectional invariance K=8": lambda: ms.Bidirectional(ms.Invariance(), 8),
        "Kulla-Conty": ms.KullaConty,
    }
    for name, scattering in cases.items():
        with compiled_anew():
            alpha = torch.nn.Parameter(torch.tensor(0.5))
            fast = ms.compile(ms.RoughConductor(ms.GGX(alpha), Ideal(), scattering()), verbose=False)
            forward = first_call(lambda f=fast: f(wi, wo, ms.Stream(1)))
            value = fast(wi, wo, ms.Stream(1)).sum()
            rows.append({"case": name, "forward_s": forward, "backward_s": first_call(value.backward)})
            print(rows[-1], flush=True)
    return rows


def bounds() -> list[dict[str, Any]]:
    """What this machine can do, by the same compiler: ns of an operation on one number, two threads."""
    rows = []
    x = torch.rand(1 << 14) + 0.5
    operations: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
        "multiply and add": lambda v: v * 0.999 + 0.001,
        "divide": lambda v: 1 / (v + 1),
        "square root": torch.sqrt,
        "sine": torch.sin,
        "exponential": lambda v: torch.exp(-v),
        "logarithm": lambda v: torch.log(v + 1),
    }
    for name, operation in operations.items():

        def chain(v: torch.Tensor, f: Callable[[torch.Tensor], torch.Tensor] = operation) -> torch.Tensor:
            parts = [v * (1 + 0.01 * i) for i in range(8)]
            for _ in range(8):
                parts = [f(p) for p in parts]
            return sum(parts[1:], parts[0])

        torch._dynamo.reset()
        fast = torch.compile(chain, dynamic=False, fullgraph=True)
        (t,) = timed(lambda f=fast: [f(x) for _ in range(100)])
        rows.append({"operation": name, "ns": t / 100 / len(x) / 64 * 1e9})
        print(rows[-1], flush=True)
    big = torch.rand(1 << 25)
    out = torch.empty_like(big)
    (t,) = timed(lambda: torch.add(big, 1.0, out=out))
    rows.append(
        {"operation": "memory, read and written [GB/s]", "ns": None, "gigabytes_per_second": 8 * len(big) / t * 1e-9}
    )
    print(rows[-1])
    return rows


SECTIONS = {
    f.__name__: f for f in (walks, single, checked, backward, scaling, engines, latency, contention, compiling, bounds)
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", choices=[*SECTIONS, []], default=[])
    parser.add_argument("--orders", type=int, nargs="+", default=[6], help="bidirectional K of the section walks")
    parser.add_argument(
        "--quick", action="store_true", help="an eighth of the rows, three repetitions; nothing is written"
    )
    options = parser.parse_args()
    path = RESULTS / "speed.json"
    if options.quick:
        global ROWS, REPEATS
        ROWS, REPEATS = ROWS // 8, 3
    ms.set_validation(False)
    for name in options.sections or SECTIONS:
        print(f"-- {name}", flush=True)
        found = walks(tuple(options.orders)) if name == "walks" else SECTIONS[name]()
        if options.quick:
            continue
        content = json.loads(path.read_text()) if path.exists() else {}
        content[name] = {"birth": birth_certificate(), "load": os.getloadavg(), "rows": found}
        write_json(path, content, force=True)


if __name__ == "__main__":
    main()
