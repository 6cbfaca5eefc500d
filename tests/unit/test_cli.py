"""The command line: what it prints and writes, and what it says about arguments that do not fit."""

import json
import re
import shlex
import subprocess
import sys

import pytest
import tyro

import torchms
from torchms.cli import COMMANDS, main

QUICK = ["--samples", "2000", "--max-order", "3", "--theta", "0.5"]


@pytest.mark.parametrize("arguments", [["--help"], ["energy", "--help"]])
def test_help_answers_without_torch(arguments: list[str]) -> None:
    """`--help` must not wait for torch: it is not imported."""
    code = f"import sys, torchms.cli as c\ntry: c.main({arguments})\nexcept SystemExit: pass\n"
    code += "sys.exit(int('torch' in sys.modules or 'numpy' in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60).returncode == 0


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_that_is_understood(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The line is wrapped to the terminal's width, but begins with the command; its options are parsed."""
    with pytest.raises(SystemExit, match="0"):
        main([command, "--help"])
    assert f"Example: torchms {command}" in capsys.readouterr().out
    options, _ = COMMANDS[command]
    (example,) = re.findall(rf"Example: torchms {command} (.+)", options.__doc__ or "")
    assert isinstance(tyro.cli(options, args=shlex.split(example)), options)


def test_help_of_all_commands(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    out = capsys.readouterr().out
    assert "Example: torchms energy" in out
    for command in COMMANDS:
        assert command in out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"torchms {torchms.__version__}\n"


def test_table_and_json(capsys: pytest.CaptureFixture[str], tmp_path) -> None:
    file = tmp_path / "energy.json"
    arguments = ["energy", "--metal", "Cu", "--alpha", "0.5,0.2", "--models", "invariance", "correlated", *QUICK]
    assert main([*arguments, "--json", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "conductor Cu" in lines[0] and "alpha = 0.5,0.2" in lines[0]
    assert len({len(line) for line in lines[2:3]}) == 1
    assert [line.split()[0] for line in lines[4:8]] == ["2", "3", "remaining", "total"]
    document = json.loads(file.read_text())
    assert [row["model"] for row in document["rows"]] == ["invariance", "correlated"]
    row = document["rows"][0]
    assert len(row["reflected"]) == 3 and len(row["reflected"][0]) == 3
    total = [sum(channel) for channel in zip(*row["reflected"], strict=True)]
    assert total == pytest.approx(row["total"], rel=1e-9)
    assert row["total"][0] > row["total"][2] > 0, "copper is red"


def test_gtr(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["energy", "--distribution", "gtr", "--models", "invariance", *QUICK]
    assert main([*arguments, "--gamma", "3"]) == 0
    assert "gtr alpha = 0.5, gamma = 3" in capsys.readouterr().out
    assert main(arguments) == 0


def test_dielectric_leaves_invariance_out(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["energy", "--material", "dielectric", *QUICK]) == 0
    out = capsys.readouterr().out
    assert "height-walk E_t" in out and "invariance: left out. Invariance() holds on one side" in out
    assert main(["energy", "--material", "dielectric", "--models", "invariance", *QUICK]) == 2
    assert "Use HeightWalk()" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--alpha", "0"], ["GGX(alpha=...)", "[0.001, 2]", "got 0"]),
        (["--alpha", "a"], ["--alpha", "0.5,0.2"]),
        (["--gamma", "2"], ["--gamma", "--distribution gtr", "ggx"]),
        (["--distribution", "gtr", "--gamma", "11"], ["GTR(gamma=...)", "(0, 10]", "got 11"]),
        (["--distribution", "gtr", "--alpha", "0.5,0.2"], ["isotropic", "0.5,0.2"]),
        (["--metal", "Xx"], ["Xx", "Au", "Cu"]),
        (["--material", "dielectric", "--eta", "-1"], ["Dielectric(eta=...)", "got -1"]),
        (["--material", "diffuse", "--albedo", "1.5"], ["RoughDiffuse(albedo=...)", "[0, 1]", "got 1.5"]),
        (["--material", "diffuse", "--metal", "Au"], ["--metal", "conductor"]),
        (["--samples", "1.5"], ["--samples", "whole number"]),
        (["--theta", "2"], ["--theta", "[0, pi/2)", "got 2"]),
        (["--max-order", "0"], ["max_order", "[1, 256]", "got 0"]),
        (["--json", "missing-folder/x.json"], ["missing-folder", "does not exist"]),
    ],
)
def test_arguments_that_do_not_fit(arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["energy", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("torchms: error: ")
    for word in words:
        assert word in error


def test_unknown_choice(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["energy", "--material", "wood"])
    assert stop.value.code == 2
    captured = capsys.readouterr()
    assert "dielectric" in captured.out + captured.err


def test_never_overwrites(capsys: pytest.CaptureFixture[str], tmp_path) -> None:
    file = tmp_path / "energy.json"
    file.write_text("mine")
    assert main(["energy", *QUICK, "--json", str(file)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert main(["energy", "--models", "single-bounce", *QUICK, "--json", str(file), "--force"]) == 0
    assert json.loads(file.read_text())["rows"]
    assert [p.name for p in tmp_path.iterdir()] == ["energy.json"], "no temporary file is left"
