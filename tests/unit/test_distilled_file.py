"""Files of distilled lobes: what is written is read, and what is no such file is refused with a reason."""

from pathlib import Path

import numpy as np
import pytest
import torch

from torchms import GGX, Distilled, RoughConductor
from torchms.approximations import distilled_file as files
from torchms.approximations.distilled_networks import NETWORKS
from torchms.approximations.metal_features import FEATURES, OF_ONE
from torchms.approximations.metal_lobes import FACETS, OUTPUTS
from torchms.fresnel import Ideal


def made(generator: torch.Generator, alpha: tuple[float, float] = (0.2, 0.6)) -> files.Distillate:
    """A small file's content, of random weights."""
    layers = [
        (torch.randn(4, FEATURES, generator=generator), torch.randn(4, generator=generator)),
        (torch.randn(OUTPUTS, 4, generator=generator), torch.randn(OUTPUTS, generator=generator)),
    ]
    skip = torch.randn(OUTPUTS, FEATURES, generator=generator)
    each = [
        (torch.randn(3, OF_ONE, generator=generator), torch.randn(3, generator=generator)),
        (torch.randn(1, 3, generator=generator), torch.randn(1, generator=generator)),
    ]
    of_one = each, torch.randn(1, OF_ONE, generator=generator)
    met = [
        (torch.randn(2, FEATURES, generator=generator), torch.randn(2, generator=generator)),
        (torch.randn(FACETS, 2, generator=generator), torch.randn(FACETS, generator=generator)),
    ]
    facets = met, torch.randn(FACETS, FEATURES, generator=generator)
    certificate = {"command": "none", "seed": 3}
    return files.Distillate("metal", "GGX", alpha, layers, skip, certificate, of_one, facets=facets)


def test_what_is_written_is_read(tmp_path: Path, generator: torch.Generator) -> None:
    """Weights to the bit; a file of one's own is used, in its own range only."""
    path, content = tmp_path / "mine.npz", made(generator)
    files.write(path, content)
    found = files.read(path, NETWORKS)
    assert found.certificate == content.certificate and found.alpha == content.alpha
    for one, other in ((found.each, content.each), (found.facets, content.facets)):
        assert one is not None and other is not None
        for (a, b), (c, d) in zip((*found.layers, *one[0]), (*content.layers, *other[0]), strict=True):
            torch.testing.assert_close((a, b), (c, d), rtol=0, atol=0)
    model = Distilled(path)
    assert model.certificates["GGX metal"]["seed"] == 3
    RoughConductor(GGX(0.3), Ideal(), model)
    with pytest.raises(ValueError, match=r"must lie in \[0.2, 0.6\]"):
        RoughConductor(GGX(0.7), Ideal(), model)
    with pytest.raises(FileExistsError):
        files.write(path, content)


def test_what_comes_with_torchms_has_a_certificate() -> None:
    """At most 300 KB, with the command, the commit, the seed, the samples and held-out errors."""
    for name, certificate in Distilled().certificates.items():
        assert {"command", "commit", "options", "rows", "paths", "held_out"} <= certificate.keys(), name
    folder = Path(files.__file__).parent
    sizes = [path.stat().st_size for path in folder.glob("distilled_*.npz")]
    assert sizes and max(sizes) <= 300_000


@pytest.mark.usefixtures("messages")
def test_other_files_are_refused(tmp_path: Path, generator: torch.Generator) -> None:
    """Truncated, foreign, of another version or facet, with weights that do not fit or are not finite."""
    good = tmp_path / "good.npz"
    files.write(good, made(generator))
    arrays = dict(np.load(good, allow_pickle=False))

    def refused(match: str, name: str = "bad.npz", **changes: object) -> None:
        np.savez(tmp_path / name, **{k: v for k, v in (arrays | changes).items() if v is not None})
        with pytest.raises(ValueError, match=match):
            Distilled(tmp_path / name)

    refused("of format 99", format=np.array(99))
    refused("does not say its format", format=None)
    refused("is about wood", facet=np.array("wood"))
    refused("no readable certificate", certificate=np.array("{"))
    refused("which is no range", alpha=np.array([0.5, 0.1]))
    refused("lacks 'skip'", skip=None)
    refused("lacks 'each_skip'", each_skip=None)
    refused("must have shape", weight_0=arrays["weight_0"][:, :-1])
    refused("must have shape", each_weight_1=arrays["each_weight_1"][:, :-1])
    refused("finite numbers", offset_1=np.full_like(arrays["offset_1"], np.nan))
    refused("must be float32", weight_1=arrays["weight_1"].astype(np.float64))
    refused("0 layers", weight_0=None, weight_1=None)
    (tmp_path / "cut.npz").write_bytes(good.read_bytes()[:-40])
    (tmp_path / "text.npz").write_text("no archive")
    for name in ("cut.npz", "text.npz"):
        with pytest.raises(ValueError, match=r"truncated or no \.npz file"):
            Distilled(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=r"approximations\.distil"):
        Distilled(tmp_path / "none.npz")
    table = Path(files.__file__).parent / "ggx.npz"
    with pytest.raises(ValueError, match=r"ggx\.npz"):
        Distilled(table)


def test_objects_share_no_weights() -> None:
    """What comes with torchms is read once; who trains the one does not change the other."""
    one, two = Distilled(), Distilled()
    kept = [x.clone() for x in two.buffers()]
    with torch.no_grad():
        for x in one.buffers():
            x.zero_()
    assert all(torch.equal(x, y) for x, y in zip(two.buffers(), kept, strict=True))
