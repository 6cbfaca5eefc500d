"""A `Program` as C++: one loop over elements, a vector register of them at a time."""

import math
from importlib import resources

from torchms.machine.program import Operation, Program

TYPES = {"f": "F", "d": "D", "i": "I", "l": "W", "b": "M"}
SCALARS = {"f": "float", "d": "double", "i": "int32_t", "l": "int64_t", "b": "char"}
SIZES = {"f": 4, "d": 8, "i": 4, "l": 8, "b": 1}
INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "and": "&", "or": "|", "xor": "^", "shr": ">>", "shl": "<<"}
COMPARE = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}


def source(program: Program, fast: bool) -> str:
    """The whole file: types, `prelude`, `body`, and the driver."""
    needed = program.needed()
    wide = any(o.kind == "d" for o, n in zip(program.operations, needed, strict=True) if n)
    columns = _columns(program)
    results = program.results
    head = [
        f"#define WIDE {int(wide)}",
        f"#define FAST {int(fast)}",
        f"constexpr int N_COLUMNS = {len(columns)}, N_RESULTS = {len(results)};",
        _sizes("COLUMN_SIZE", columns),
        _sizes("RESULT_SIZE", [program.operations[v].kind for v in results]),
    ]
    here = resources.files("torchms.machine")
    parts = ["\n".join(head), (here / "vectors.cpp").read_text(), _functions(program, needed, fast)]
    return "\n".join([*parts, (here / "driver.cpp").read_text()])


def _sizes(name: str, kinds: list[str]) -> str:
    return f"constexpr int {name}[] = {{{', '.join([*(str(SIZES[k]) for k in kinds), '0'])}}};"


def _columns(program: Program) -> list[str]:
    """Kind of each column, in order."""
    found = {o.arguments[0]: o.kind for o in program.operations if o.name == "column"}
    return [found[i] for i in range(len(found))]


def _cells(program: Program, needed: list[bool]) -> dict[int, int]:
    """Places of what all elements share and the loop reads, computed once a call."""
    operations, varies = program.operations, program.varies
    read = [
        argument
        for value, operation in enumerate(operations)
        if needed[value] and varies[value] and operation.name != "column"
        for argument in program.taken(operation)
    ]
    cells: dict[int, int] = {}
    for value in [*read, *program.results]:
        if not varies[value] and operations[value].name not in ("number", "array", "matrix"):
            cells.setdefault(value, len(cells))
    return cells


def _functions(program: Program, needed: list[bool], fast: bool) -> str:
    operations, varies = program.operations, program.varies
    cells = _cells(program, needed)
    prelude, before, loop = [], [], []
    for value, operation in enumerate(operations):
        if not needed[value]:
            continue
        if operation.name == "column":
            # Not in the loop: what it writes might be these addresses.
            before.append(f"const void* const c{operation.arguments[0]} = columns[{operation.arguments[0]}];")
        line = _statement(value, operation, program, fast)
        if varies[value]:
            loop.append(line)
        else:
            prelude.append(line)
            if operation.name == "number":
                before.append(line)
            if value in cells:
                scalar = "int64_t" if operation.kind == "b" else SCALARS[operation.kind]
                prelude.append(f"*({scalar}*)(cells + {8 * cells[value]}) = v{value}[0];")
                read = f"*(const {scalar}*)(cells + {8 * cells[value]})"
                before.append(f"const {TYPES[operation.kind]} v{value} = all_{operation.kind}({read});")
    for k, value in enumerate(program.results):
        before.append(f"void* const r{k} = results[{k}];")
        loop.append(f"store_{operations[value].kind}(r{k}, i, v{value});")
    return "\n".join(
        [
            f"constexpr int64_t N_CELLS = {len(cells)};",
            'extern "C" int64_t n_cells() { return N_CELLS; }',
            # It runs once a call: what it takes to optimise it is never earned.
            'extern "C" UNOPTIMISED void prelude(const void* const* shared, char* cells) {',
            *prelude,
            "}",
            # Not part of its caller, whose addresses of what belongs to a thread would be asked for in every round.
            "static UNMIXED void body(const void* const* columns, void* const* results, const char* cells,",
            "                 const void* const* shared, int64_t count) {",
            *before,
            "for (int64_t i = 0; i < count; i += LANES) {",
            *loop,
            "}",
            "}",
        ]
    )


def _statement(value: int, operation: Operation, program: Program, fast: bool) -> str:
    name, kind, arguments = operation
    if name == "array":
        return f"const {TYPES[kind]} v{value}[{len(arguments)}] = {{{', '.join(f'v{a}' for a in arguments)}}};"
    if name == "matrix":
        (vector, tensor, down, rows), first = arguments[:4], ", ".join(str(a) for a in arguments[4:])
        memory = f"(const {SCALARS[kind]}*)shared[{tensor}]"
        return f"{TYPES[kind]} v{value}[{rows}]; matrix<{rows}, {down}, {first}>(v{value}, v{vector}, {memory});"
    return f"const {TYPES[kind]} v{value} = {_expression(operation, program, fast)};"


def _number(text: str, kind: str) -> str:
    if kind == "b":
        return "all_b(-1)" if text == "True" else "all_b(0)"
    if kind in "il":
        return f"all_{kind}({text}{'ll' if kind == 'l' else ''})"
    value = float(text)
    suffix = "f" if kind == "f" else ""
    if math.isnan(value):
        return f'all_{kind}(__builtin_nan(""))'
    if math.isinf(value):
        return f"all_{kind}({'-' if value < 0 else ''}__builtin_inf{suffix}())"
    return f"all_{kind}({value.hex()}{suffix})"


def _expression(operation: Operation, program: Program, fast: bool) -> str:
    name, kind, arguments = operation
    if name == "number":
        return _number(str(arguments[0]), kind)
    if name == "column":
        return f"load_{kind}(c{arguments[0]}, i)"
    if name == "shared":
        return f"all_{kind}(((const {SCALARS[kind]}*)shared[{arguments[0]}])[{arguments[1]}])"
    operands = [f"v{a}" for a in arguments]
    if name == "element":
        return f"v{arguments[0]}[{arguments[1]}]"
    kinds = [program.operations[a].kind for a in arguments]  # type: ignore[index]
    if name == "div" and kind in "fd":
        return f"quotient({operands[0]}, {operands[1]})"
    if name in INFIX:
        return f"{operands[0]} {INFIX[name]} {operands[1]}"
    if name in COMPARE:
        return f"mask({operands[0]} {COMPARE[name]} {operands[1]})"
    if name in ("sin", "cos") and fast and kind == "f":
        return f"turn(v{arguments[0]}).{name}"
    if name == "where":
        return f"pick({operands[0]}, {operands[1]}, {operands[2]})"
    if name == "neg":
        return f"-{operands[0]}"
    if name == "not":
        return f"~{operands[0]}"
    if name == "cast":
        return f"{kinds[0]}_to_{kind}({operands[0]})"
    if name in ("max", "min"):
        # A bound that is no NaN needs no look for it.
        limits = [n for n in (program.constant(int(a)) for a in arguments) if n is not None]
        name = f"{name}_of" if limits and kind in "fd" and not math.isnan(limits[0]) else name
        operands.sort(key=lambda v: program.constant(int(v[1:])) is None)
    return f"m_{name}({', '.join(operands)})"
