"""`torchms export`."""

from pathlib import Path

import torch

from torchms.bsdfs import BSDF
from torchms.cli.arguments import parse_count
from torchms.cli.description import modelled
from torchms.cli.options import ExportOptions
from torchms.onnx.evaluator import runtime
from torchms.onnx.exporter import checked, exported
from torchms.onnx.parity.compare import check
from torchms.onnx.parity.table import FOOTNOTE, Entry, table
from torchms.storage.write import check_writable, write_json, write_whole


def build(options: ExportOptions) -> BSDF:
    """The BSDF that the options describe."""
    bsdf = modelled(options, glass="height-walk", opaque="invariance")
    return bsdf.to(torch.float64) if options.double else bsdf


def run_export(options: ExportOptions) -> None:
    """Write the file and, if asked for, check it. Raises ValueError for options that do not fit and missed bounds."""
    path = check_writable(options.path, options.force)
    if options.json is not None:
        if not options.check:
            raise ValueError("--json holds the comparison: it goes with --check.")
        check_writable(options.json, options.force)
    rows = parse_count(options.rows, "--rows", 1)
    if options.check:
        runtime()
    bsdf = build(options)
    arguments = {
        "what": options.what,
        "parameters": options.parameters,
        "uniforms": options.uniforms,
        "n_paths": options.n_paths,
    }
    graph = checked(bsdf, **arguments)
    content = exported(bsdf, **arguments)
    if options.check:
        entry = Entry.of(Path(path).stem, content, check(content, graph, rows))
        print(table([entry]))
        print(FOOTNOTE)
        if options.json is not None:
            write_json(options.json, entry.as_json(), options.force)
        if entry.parity is not None and entry.parity.failures:
            raise ValueError(f"{path.name} was not written: {'; '.join(entry.parity.failures)}.")
    write_whole(path, content, options.force)
    print(
        f"{path}: {len(content)} bytes, inputs {', '.join(graph.input_names)}, outputs {', '.join(graph.output_names)}"
    )
