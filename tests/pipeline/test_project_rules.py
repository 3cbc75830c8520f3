"""What the engine takes for granted of the real stages: what the code digest leaves out has to be harmless."""

from __future__ import annotations

import ast
import builtins
import subprocess
import sys
import typing
from pathlib import Path

import pytest

from pipeline import code
from pipeline.compiled import compiled_modules
from pipeline.experiment import PRESETS
from pipeline.stage import load
from stages import STAGES

ROOT = Path(__file__).resolve().parents[2]
DECLARATIONS = sorted(ROOT.glob("stages/**/parameters.py"))
PACKAGES = sorted([*ROOT.glob("stages/**/__init__.py"), *ROOT.glob("pipeline/**/__init__.py")])


def shown(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def is_type(expression: ast.expr) -> bool:
    """Whether an expression only composes types: names, subscripts, unions, and calls that annotate."""
    if isinstance(expression, ast.Subscript):
        if ast.unparse(expression.value) == "Literal":
            return True
        inner = expression.slice.elts if isinstance(expression.slice, ast.Tuple) else [expression.slice]
        return is_type(expression.value) and all(is_type(item) or is_annotation(item) for item in inner)
    if isinstance(expression, ast.BinOp):
        return isinstance(expression.op, ast.BitOr) and is_type(expression.left) and is_type(expression.right)
    named = isinstance(expression, ast.Name) and (expression.id[0].isupper() or expression.id in dir(builtins))
    nothing = isinstance(expression, ast.Constant) and expression.value in (None, ...)
    return named or nothing


def is_annotation(expression: ast.expr) -> bool:
    """Such as ``Discriminator("kind")`` or ``Ge(1)``."""
    return isinstance(expression, ast.Call) and all(isinstance(argument, ast.Constant) for argument in expression.args)


def is_default(expression: ast.expr | None) -> bool:
    """A literal, or declared parameters made of literals, or a tuple of such."""
    if expression is None or isinstance(expression, ast.Constant):
        return True
    if isinstance(expression, ast.UnaryOp):
        return is_default(expression.operand)
    if isinstance(expression, ast.Tuple):
        return all(is_default(item) for item in expression.elts)
    if isinstance(expression, ast.Call) and isinstance(expression.func, ast.Name):
        return not expression.args and all(is_default(keyword.value) for keyword in expression.keywords)
    return False


def is_declaration(statement: ast.stmt) -> bool:
    """An import, a text, a type alias, or a class of parameters with literal defaults and nothing else."""
    if isinstance(statement, ast.Import | ast.ImportFrom) or is_text(statement):
        return True
    if isinstance(statement, ast.Assign):
        return is_type(statement.value)
    if isinstance(statement, ast.ClassDef):
        decorated = [ast.unparse(decorator) for decorator in statement.decorator_list] == ["parameters"]
        fields = (is_text(s) or (isinstance(s, ast.AnnAssign) and is_default(s.value)) for s in statement.body)
        return decorated and all(fields)
    return False


def test_there_are_parameters_and_packages():
    assert len(DECLARATIONS) >= 5
    assert len(PACKAGES) >= 8


@pytest.mark.parametrize("path", DECLARATIONS, ids=shown)
def test_parameters_hold_declarations_only(path):
    statements = ast.parse(path.read_text(encoding="utf-8")).body
    wrong = [f"line {s.lineno}: {ast.unparse(s)[:60]}" for s in statements if not is_declaration(s)]
    assert wrong == [], "the code digest leaves this module out: move what is no declaration to another one"


@pytest.mark.parametrize(
    "text",
    [
        "LIMIT = 3",
        "LIMIT = tuple(range(3))",
        "def helper(): return 1",
        "if True:\n    X = int",
        "class A:\n    x: int = 1",
        "@parameters\nclass A:\n    x: int = compute()[0]",
        "@parameters\nclass A:\n    def __post_init__(self): pass",
        "@parameters\nclass A:\n    x = 1",
        "X: float = 3.0",
        "print('hello')",
    ],
)
def test_what_is_no_declaration_is_seen(text):
    assert not all(is_declaration(statement) for statement in ast.parse(text).body)


@pytest.mark.parametrize("path", PACKAGES, ids=shown)
def test_packages_hold_texts_and_literals_only(path):
    for statement in ast.parse(path.read_text(encoding="utf-8")).body:
        if is_text(statement):
            continue
        assert isinstance(statement, ast.Assign), f"line {statement.lineno}: the code digest leaves this out"
        ast.literal_eval(statement.value)


def kind_of(member):
    return member.__dataclass_fields__["kind"].default


@pytest.mark.parametrize("reference", STAGES)
def test_stages_fit_together(reference):
    stage = load(reference)
    assert reference.startswith(f"stages.{stage.name}.")
    members = typing.get_args(stage.parameters) or (stage.parameters,)
    kinds = [kind_of(member) for member in members] if len(members) > 1 else []
    # Only what every kind writes can be read by a later stage.
    earlier = [port for other in STAGES[: STAGES.index(reference)] for port in load(other).outputs]
    assert set(stage.inputs) <= {port.name for port in earlier if not port.kinds}
    assert len({port.name for port in (*earlier, *stage.outputs)}) == len(earlier) + len(stage.outputs)
    assert all(set(port.kinds) <= set(kinds) for port in stage.outputs)
    assert set(stage.presets) <= set(PRESETS)
    assert all(set(presets) <= set(PRESETS) for presets in stage.kind_presets.values())
    assert {*stage.kind_presets, *stage.kind_libraries} <= set(kinds)
    spoken = [(preset.get("kind", kinds[0] if kinds else ""), preset) for preset in stage.presets.values()]
    spoken += [(kind, preset) for kind, presets in stage.kind_presets.items() for preset in presets.values()]
    for kind, preset in spoken:
        (spoken_of,) = [m for m in members if not kinds or kind_of(m) == kind]
        assert set(preset) <= set(spoken_of.__dataclass_fields__)
    for kind in stage.implementations:
        assert callable(stage.implementation(kind))
    assert not stage.implementations or set(stage.implementations) == set(map(kind_of, members))
    assert stage.warm == "" or callable(load(stage.warm))


@pytest.mark.parametrize("reference", STAGES)
def test_every_library_that_a_stage_reaches_is_declared(reference):
    """Numerical libraries that the reached modules import are in the key by their version."""
    stage = load(reference)
    numerical = {"numpy", "scipy", "numba", "clarabel", "pyarrow", "cvxpy", "rosbags", "mcap", "pytransform3d"}
    numerical |= {"pybullet", "pygame", "rerun"}
    for kind in [*stage.implementations] or [None]:
        modules = [reference.partition(":")[0]]
        modules += [stage.implementations[kind].partition(":")[0]] if kind else []
        imported = set()
        for module in code.reached(modules):
            tree = ast.parse((ROOT / Path(*module.split("."))).with_suffix(".py").read_text(encoding="utf-8"))
            for node in ast.walk(tree):
                if isinstance(node, ast.Import):
                    imported |= {alias.name.partition(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    imported.add(node.module.partition(".")[0])
        declared = {*stage.libraries, *stage.kind_libraries.get(kind, ())}
        assert imported & numerical <= declared, f"kind {kind}"


def test_importing_the_stages_compiles_and_loads_nothing_heavy():
    """numba's cache folder is set when a stage has to run: nothing may have been compiled for another one before."""
    text = (
        "import sys\nfrom pipeline.stage import load\nfrom stages import STAGES\nfor s in STAGES: load(s)\n"
        "print([m for m in ('numba', 'scipy', 'clarabel', 'cvxpy', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_compiled_function_is_seen():
    """The cache folder is named by the modules that `compiled_modules` finds: it must miss none."""
    found = set(compiled_modules("stages"))
    for path in ROOT.glob("stages/**/*.py"):
        decorators = [
            ast.unparse(decorator).partition("(")[0].rpartition(".")[2]
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.FunctionDef)
            for decorator in node.decorator_list
        ]
        if {"compiled", "njit", "jit", "vectorize", "guvectorize"} & set(decorators):
            assert ".".join(path.relative_to(ROOT).with_suffix("").parts) in found
