"""The lobe lab in a browser: it shows eager's numbers, every control works, and a bad file gets a sentence.

Skipped where Node, Chromium, the lab's packages (npm ci --ignore-scripts --prefix export/lab) or its evaluators
(make lab) are missing.
"""

import importlib
import json
import math
import os
import random
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lab_page import ROOT, driven

from torchms.maths.frame import direction

KOROBOV, FINE = 1564, 8191
PATHS = 2


@pytest.fixture(scope="module")
def lab_set() -> Any:
    sys.path.insert(0, str(ROOT))
    try:
        return importlib.import_module("export.lab_set")
    finally:
        sys.path.remove(str(ROOT))


def evaluators(built: Path) -> list[tuple[str, str, str]]:
    """Material, distribution and model of each lobe in the set."""
    listed = json.loads((built / "models" / "models.json").read_text())["models"]
    return [(e["material"], e["distribution"], e["model"]) for e in listed if e["what"] == "orders"]


def states(seed: int, models: list[tuple[str, str, str]], metals: list[str]) -> list[dict[str, Any]]:
    """Random surfaces and directions, every model of the set among them."""
    draw = random.Random(seed)
    found = []
    for i in range(50):
        material, distribution, model = models[i % len(models)]
        alpha, alpha_y = draw.uniform(0.1, 1), draw.uniform(0.1, 1)
        glass = material == "dielectric"
        angles = [draw.uniform(0, 85) if not glass or draw.random() < 0.6 else draw.uniform(95, 180) for _ in range(2)]
        found.append(
            {
                "material": material,
                "distribution": distribution,
                "model": model,
                "models": [],
                "against": model,
                "round": draw.random() < 0.5 or (material == "dielectric" and model in ("kulla-conty", "turquin")),
                "gamma": draw.uniform(1.1, 5),
                "alpha": alpha,
                "alphaY": alpha_y,
                "metal": draw.choice(metals),
                "eta": draw.uniform(1.1, 2.4),
                "albedo": draw.uniform(0.1, 1),
                "theta": angles[0],
                "phi": draw.uniform(-180, 180),
                "outTheta": angles[1],
                "outPhi": draw.uniform(-180, 180),
                "paths": PATHS,
                "view": "lobes",
            }
        )
    return found


def files(folder: Path, good: Path) -> tuple[list[str], list[str]]:
    """Files that are refused, and what is said of them."""
    content = good.read_bytes()
    bad = {
        "letter.onnx": (b"Dear lab, this is no network.", "was not written by torchms"),
        "cut.onnx": (content[:-20], "damaged, or was changed by another tool"),
        "half.onnx": (content[: len(content) // 2], "was not written by torchms"),
        "bit.onnx": (content[:999] + bytes([content[999] ^ 1]) + content[1000:], "does not match its seal"),
        "empty.onnx": (b"", "is empty"),
        "density.onnx": ((good.parent / "conductor-ggx-sample.onnx").read_bytes(), "only “orders” and “forward”"),
    }
    for name, (each, _) in bad.items():
        (folder / name).write_bytes(each)
    return [str(folder / name) for name in bad], [says for _, says in bad.values()]


@pytest.fixture(scope="module")
def seen(built: Path, lab_set: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a visitor saw."""
    folder = tmp_path_factory.mktemp("plan")
    good = built / "models" / "conductor-ggx-distilled.onnx"
    refused, says = files(folder, good)
    shutil.copy(good, folder / "mine.onnx")
    plan = {
        "states": states(20261127, evaluators(built), [*lab_set.metals()]),
        "refused": refused,
        "taken": str(folder / "mine.onnx"),
    }
    (folder / "plan.json").write_text(json.dumps(plan))
    return driven(built, "check.mjs", str(folder / "plan.json")) | {"says": says}


def uniforms(seed: int, n: int) -> np.ndarray:
    """The page's generator, mulberry32."""
    mask = 0xFFFFFFFF
    a = (seed + 0x6D2B79F5 * np.arange(1, n + 1, dtype=np.uint64)) & mask
    t = ((a ^ (a >> np.uint64(15))) * (a | np.uint64(1))) & mask
    t ^= (t + (((t ^ (t >> np.uint64(7))) * (t | np.uint64(61))) & mask)) & mask
    return (((t ^ (t >> np.uint64(14))) & mask) >> np.uint64(8)).astype(np.float64) / 2**24


def lattice(n: int, d: int) -> torch.Tensor:
    """The page's quadrature, (n, d)."""
    z = [pow(KOROBOV, j, n) for j in range(d)]
    points = ((np.arange(n)[:, None] * np.array(z) % n) + 0.5) / n
    return torch.from_numpy(np.minimum(points.astype(np.float32), np.float32(1 - 2**-24)))


def surface_of(lab_set: Any, state: dict[str, Any], model: str) -> Any:
    """The state's surface in torchms."""
    from torchms.onnx.graph import replaced, slots

    surface = lab_set.surface(state["material"], state["distribution"], model)
    metal = lab_set.metals()[state["metal"]]
    given = {
        "alpha": state["alpha"],
        "alpha_y": state["alphaY"],
        "gamma": state["gamma"],
        "eta": metal["eta"] if state["material"] == "conductor" else state["eta"],
        "k": metal["k"],
        "albedo": [state["albedo"]] * 3,
    }
    found = {slot: torch.tensor(given[name]) for name, slot in slots(surface).items() if name in given}
    return replaced(surface, {slot: v for slot, v in found.items() if slot.value is not None})


def eager(lab_set: Any, state: dict[str, Any], model: str) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Value (K, C), reflected and transmitted energy (K, C) of the state, by torchms itself."""
    surface = surface_of(lab_set, state, model)
    # One file draws directions for all chalk: its density holds whatever the roughness.
    chalk = state["material"] == "diffuse"
    sampler = (
        lab_set.surface("diffuse", "ggx", "single-bounce") if chalk else surface_of(lab_set, state, "single-bounce")
    )
    wi, wo = (direction(math.radians(state[a]), math.radians(state[b])).float() for a, b in ANGLES)
    D = surface.n_uniforms
    exact = not surface.scattering.is_deterministic(surface.vertex)

    def numbers(seed: int, rows: int, paths: int) -> tuple[torch.Tensor, ...]:
        u = torch.from_numpy(uniforms(seed, rows * paths * D).astype(np.float32)).reshape(rows, paths, D)
        return (u,) if exact else ()

    value = surface.orders(wi[None], wo[None], *numbers(1, 1, PATHS))[0]
    u = torch.zeros(FINE, sampler.n_uniforms)
    n = sampler.proposal.n_uniforms
    u[:, :n] = lattice(FINE, n)
    nodes, pdf = sampler.sample(wi, u)
    passes = [surface.orders(wi, nodes, *numbers(k + 1, FINE, 1)) for k in range(PATHS if exact else 1)]
    orders = torch.stack(passes).mean(0)
    share = torch.where(pdf > 0, 1 / pdf, 0.0)[:, None, None] * orders / FINE
    same = (nodes[:, 2] * wi[2] > 0)[:, None, None]
    return value, torch.where(same, share, 0).sum(0), torch.where(same, 0, share).sum(0)


ANGLES = (("theta", "phi"), ("outTheta", "outPhi"))


@pytest.mark.slow
def test_its_numbers_are_eagers(seen: dict[str, Any], built: Path, lab_set: Any) -> None:
    """Within 1e-4 on 50 random states: the value at both directions, and the energies by the same quadrature."""
    assert len(seen["numbers"]) == 50
    models, errors = set(), {}
    for got in seen["numbers"]:
        state, model = got["state"], got["model"]
        models.add((state["material"], state["distribution"], model))
        with torch.no_grad():
            expected = eager(lab_set, state, model)
        for name, each in zip(("value", "reflected", "transmitted"), expected, strict=True):
            page = torch.tensor(got[name]).reshape(len(got["labels"]), -1)
            last = len(got["labels"]) - 1
            folded = torch.cat([each[:last], each[last:].sum(0, keepdim=True)])
            error = float(((page - folded).abs() / folded.abs().clamp_min(1)).max())
            assert error < 1e-4, (name, error, model, state)
            errors[name] = max(error, errors.get(name, 0.0))
        shown = [float(row[1]) for row in got["shown"][:-1]]
        weights = torch.tensor([0.2126, 0.7152, 0.0722]) if got["channels"] == 3 else torch.ones(1)
        value = torch.tensor(got["value"], dtype=torch.float32).reshape(-1, got["channels"]) @ weights
        assert shown == pytest.approx(value.tolist(), rel=1e-5)
    print({name: f"{error:.1e}" for name, error in errors.items()})
    assert models == set(evaluators(built))


@pytest.mark.slow
def test_energies_are_those_of_a_random_walk(seen: dict[str, Any], lab_set: Any) -> None:
    """The quadrature itself: against `measure`, which knows nothing of it."""
    from torchms import GGX, Distilled, RoughConductor
    from torchms.fresnel import Conductor
    from torchms.lobes import measure

    state = seen["first"]["state"]
    gold = RoughConductor(GGX(state["alpha"]), Conductor.metal("Au"), Distilled())
    tally = measure(gold, direction(math.radians(state["theta"]), 0.0).float(), n_paths=400_000, progress=False)
    page = torch.tensor(seen["first"]["reflected"]).reshape(4, 3)
    assert torch.allclose(page.double(), tally.reflected.double(), atol=3e-3)


@pytest.mark.slow
def test_it_is_whole(seen: dict[str, Any]) -> None:
    """Nothing is fetched from elsewhere, the console is silent, and every control does what it says."""
    assert seen["errors"] == [] and seen["foreign"] == []
    used = seen["controls"]
    for view in ("energy", "surface", "graphs", "lobes"):
        assert used[f"view {view}"] == view
    expected = {"material-dielectric": "dielectric", "bounce-2+": "2+", "scale-log": "log", "tint-colour": "colour"}
    expected |= {"channel-R": "R", "theme-dark": "dark", "round": False, "metal": "Cu", "arrow": -1}
    assert {key: used[key] for key in expected} == expected
    assert all(used[key] for key in ("alpha", "alphaY", "theta", "phi", "outTheta", "outPhi"))
    assert "metal=Cu" in seen["address"] and "theme=dark" in seen["address"]
    head, *rows = seen["csv"].split("# plane of incidence")[1].strip().splitlines()[:20]
    assert "[degrees]" in head and "[1/sr]" in head and len(rows) == 19
    assert bytes(seen["png"]) == b"\x89PNG\r\n\x1a\n"


@pytest.mark.slow
def test_a_bad_file_gets_a_sentence(seen: dict[str, Any]) -> None:
    for text, says in zip(seen["sentences"], seen["says"], strict=True):
        assert says in text and text.endswith((".", "orders.", "“torchms export”.")) and "Error" not in text
    assert seen["taken"]["model"] == "dropped:mine"
    assert seen["taken"]["labels"] == ["1", "2", "3", "4+"]


@pytest.mark.slow
def test_it_is_there_at_once(seen: dict[str, Any], record_property: Any) -> None:
    """Within 3 s, with what it is served from this machine; a busy one says nothing about that."""
    for name in ("loaded", "settled", "drag"):
        record_property(name, seen[name])
    print({name: seen[name] for name in ("loaded", "settled", "drag")})
    assert seen["drag"]["drawn"] > 0 and seen["drag"]["updates"] > 0
    if os.getloadavg()[0] > (os.cpu_count() or 1):
        pytest.skip(f"the machine is busy; the page was there after {seen['loaded']} ms")
    assert seen["loaded"] <= 3000


@pytest.mark.slow
def test_it_is_small(built: Path) -> None:
    """At most 5 MB without the runtime."""
    size = sum(file.stat().st_size for file in built.rglob("*") if file.is_file() and file.suffix != ".wasm")
    assert size < 5e6
