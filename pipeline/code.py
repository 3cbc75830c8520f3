"""The code digest: which first-party definitions a stage reaches by import, each with a digest of its meaning.

Comments, docstrings and layout do not count. Reached are the modules that the starting modules import, in functions
too, and so on. Modules named ``parameters`` hold declarations only, and every value that they declare is in the key by
value; package ``__init__`` files hold no code that a stage runs: both are left out (tests hold the project to it).

A module is read once in a process, as it imports it once. Whether a file has changed since is for `edited` to say.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

LEFT_OUT = ("parameters", "__init__")

Definitions = Mapping[str, Mapping[str, str]]
"""Module -> top-level name -> digest (12 hexadecimal digits)."""


def reached(modules: Iterable[str]) -> dict[str, dict[str, str]]:
    """Definitions of all first-party modules that `modules` reach; first-party: of the same top-level packages."""
    modules = list(modules)
    tops = frozenset(module.partition(".")[0] for module in modules)
    found: dict[str, dict[str, str]] = {}
    waiting = sorted(modules)
    while waiting:
        module = waiting.pop()
        path = _path(module)
        if module in found or path is None or path.stem in LEFT_OUT:
            continue
        source = _read(module, path)
        found[module] = source.definitions
        waiting.extend(name for name in source.imports if name.partition(".")[0] in tops)
    return dict(sorted(found.items()))


def files(modules: Iterable[str]) -> dict[str, str]:
    """Module -> sha256 of its file when it was read."""
    paths = {module: _path(module) for module in modules}
    return {module: _read(module, path).digest for module, path in paths.items() if path is not None}


def edited(digests: Mapping[str, str]) -> list[str]:
    """Modules whose files are not, or no longer, what `files` said."""
    return [module for module, digest in digests.items() if _file_digest(_path(module)) != digest]


def code_digest(definitions: Definitions) -> str:
    """One sha256 over all definitions."""
    lines = [
        f"{module} {name} {value}"
        for module in sorted(definitions)
        for name, value in sorted(definitions[module].items())
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def changes(before: Definitions, after: Definitions) -> list[str]:
    """Sentences that name the modules and definitions in which two sets of definitions differ."""
    found = []
    for module in sorted({*before, *after}):
        if module not in before:
            found.append(f"{module} is new")
        elif module not in after:
            found.append(f"{module} is no longer used")
        else:
            old, new = before[module], after[module]
            names = [name for name in {**old, **new} if old.get(name) != new.get(name)]
            found.extend(f"{module}.{name} changed" for name in sorted(names))
    return found


@cache
def _path(module: str) -> Path | None:
    """Source file of a first-party module, without importing it; none where it is a namespace or a name in a module."""
    top, *rest = module.split(".")
    spec = importlib.util.find_spec(top)
    if spec is None or spec.origin is None:
        return None
    if not rest:
        return Path(spec.origin)
    if spec.submodule_search_locations is None:
        return None
    base = Path(spec.origin).parent.joinpath(*rest)
    for candidate in (base.with_suffix(".py"), base / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


@dataclass(frozen=True, kw_only=True)
class _Source:
    """A module's file: digest of its bytes, digests of its top-level definitions in order, modules that it imports."""

    digest: str
    definitions: dict[str, str]
    imports: tuple[str, ...]


@cache
def _read(module: str, path: Path) -> _Source:
    content = path.read_bytes()
    tree = _without_docstrings(ast.parse(content, filename=module))
    parts: dict[str, list[str]] = {}
    for statement in tree.body:
        parts.setdefault(_name(statement), []).append(ast.dump(statement))
    return _Source(
        digest=hashlib.sha256(content).hexdigest(),
        definitions={name: hashlib.sha256("\n".join(text).encode()).hexdigest()[:12] for name, text in parts.items()},
        imports=tuple(_imports(module, tree)),
    )


def _file_digest(path: Path | None) -> str:
    try:
        return "" if path is None else hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in _blocks(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            # Every bare text counts as documentation: attribute docstrings stand behind what they describe.
            node.body = [s for s in node.body if not _bare_text(s)]
    return tree


def _blocks(node: ast.AST) -> Iterator[ast.AST]:
    """A module and its statements, however deep; expressions, which hold neither docstrings nor imports, are spared."""
    yield node
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        statements = getattr(node, part, ())
        for statement in statements if isinstance(statements, list) else ():
            yield from _blocks(statement)


def _bare_text(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def _name(statement: ast.stmt) -> str:
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return statement.name
    if isinstance(statement, ast.Assign) and all(isinstance(target, ast.Name) for target in statement.targets):
        return "=".join(target.id for target in statement.targets if isinstance(target, ast.Name))
    if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
        return statement.target.id
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return "imports"
    return "statements"


def _imports(module: str, tree: ast.Module) -> Iterable[str]:
    package = module.rpartition(".")[0]
    for node in _blocks(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join(
                    package.split(".")[: len(package.split(".")) - node.level + 1] + ([base] if base else [])
                )
            # `from a.b import c` reaches a.b, or a.b.c where c is a module.
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
