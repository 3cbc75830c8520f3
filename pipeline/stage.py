"""The contract that a stage signs: what it reads, what it writes, its parameters, its presets, what its key depends on.

A stage is one `Stage` object in its own module. The engine finds it by import string, computes its key without running
it, and calls `run` with a `StageContext` when the store does not know that key. Nothing here knows any stage.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast, dataclass_transform

from annotated_types import Ge, Gt, Interval

if TYPE_CHECKING:
    import numpy as np

CONTRACT = 1
"""Version of this contract; part of every stage key. Raise it when the engine hands stages something else."""

Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
UnitInterval = Annotated[float, Interval(ge=0, le=1)]
Count = Annotated[int, Ge(1)]
Whole = Annotated[int, Ge(0)]

T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def parameters(cls: type[T]) -> type[T]:
    """Declare a class of parameters: a frozen, keyword-only dataclass that refuses unknown keys, wrong types, nan."""
    # Read by pydantic when a file is validated; a plain dictionary, so that declaring costs no import.
    cls.__pydantic_config__ = {"extra": "forbid", "strict": True, "allow_inf_nan": False}  # type: ignore[attr-defined]
    return cast("type[T]", dataclass(frozen=True, kw_only=True)(cls))


@dataclass(frozen=True, kw_only=True)
class Port:
    """One artifact that a stage writes, known to later stages by `name`.

    Attributes:
        name: of the artifact.
        filename: of the file, or the folder.
        folder: whether it is a folder of files, without folders in it.
        kinds: of the parameters with which it is written; (): always.
    """

    name: str
    filename: str
    folder: bool = False
    kinds: tuple[str, ...] = ()


@dataclass(kw_only=True)
class StageContext:
    """What a running stage is given.

    Attributes:
        stage: its name.
        parameters: its validated parameters.
        inputs: artifact name -> file to read.
        sources: label -> external file to read.
        outputs: artifact name -> file to write; all of them must exist when `run` returns.
        seed: of the experiment; none where the stage does not declare that it is random.
        failures: folder for what a failing stage leaves to be studied, by `keep`; it need not exist.
        warnings: sentences for the user, kept with the result; appended by `warn`.
    """

    stage: str
    parameters: Any
    inputs: Mapping[str, Path]
    sources: Mapping[str, Path]
    outputs: Mapping[str, Path]
    seed: int | None = None
    failures: Path = Path("failed")
    warnings: list[str] = field(default_factory=list)

    def generator(self, *names: str) -> np.random.Generator:
        """A random generator that depends on the seed, the stage, the replicate and `names`, and on nothing else."""
        import numpy as np

        if self.seed is None:
            raise RuntimeError(f"stage {self.stage} draws random numbers: declare it with random=True")
        replicate = int(getattr(self.parameters, "replicate", 0))
        entropy = [self.seed, _word(self.stage), replicate]
        return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=tuple(map(_word, names))))

    def warn(self, sentence: str) -> None:
        """Say something that the user should know; appended to `warnings`."""
        self.warnings.append(sentence)

    def keep(self, filename: str) -> Path:
        """Where a stage that is about to fail may write a file for study; it stays until garbage is collected."""
        self.failures.mkdir(parents=True, exist_ok=True)
        return self.failures / filename


def _no_sources(parameters: Any, root: Path) -> Mapping[str, Path]:
    return {}


def _no_facts(parameters: Any, root: Path) -> Mapping[str, str]:
    return {}


def _no_headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    return {}


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A step of the pipeline.

    Attributes:
        name: of the stage and of its table in experiment.toml.
        summary: one line for people.
        parameters: a class made with `parameters`, or a union of such classes told apart by `kind`.
        inputs: names of artifacts of earlier stages.
        outputs: what it writes.
        run: does the work.
        presets: preset -> parameters that it sets below those of the experiment file.
        kind_presets: kind -> preset -> parameters, of kinds for which `presets` does not speak.
        implementations: kind -> ``module:function``; the selected one counts in the key, the others do not.
        libraries: distributions whose version counts in the key; `kind_libraries`: more of them, by kind.
        random: whether the experiment's seed counts in the key.
        sources: (parameters, project root) -> label -> external file; their bytes count in the key.
        about: (parameters, project root) -> facts about the external data, for people.
        headline: output files -> figures for the manifest.
        rows: output files -> the rows that people want to see of it; summarise: rows -> a few rows that say the same.
        tables: output files -> further tables of rows, by title.
        warm: import string of a function that compiles what `run` needs, called once before workers start with the
            parameters of all points; or "".
        plots: import string of a function, files of the stage and of those before it -> `Plot`s and `Bars` that show
            them in a terminal, the most telling first; or "". A string, so that no key depends on it.
    """

    name: str
    summary: str
    parameters: Any
    inputs: tuple[str, ...]
    outputs: tuple[Port, ...]
    run: Callable[[StageContext], None]
    presets: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    kind_presets: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    implementations: Mapping[str, str] = field(default_factory=dict)
    libraries: tuple[str, ...] = ()
    kind_libraries: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    random: bool = False
    sources: Callable[[Any, Path], Mapping[str, Path]] = _no_sources
    about: Callable[[Any, Path], Mapping[str, str]] = _no_facts
    headline: Callable[[Mapping[str, Path]], Mapping[str, float]] = _no_headline
    rows: Callable[[Mapping[str, Path]], list[dict[str, Any]]] | None = None
    summarise: Callable[[list[dict[str, Any]]], list[dict[str, Any]]] | None = None
    tables: Callable[[Mapping[str, Path]], Mapping[str, list[dict[str, Any]]]] | None = None
    warm: str = ""
    plots: str = ""

    def preset(self, name: str, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """What a preset sets below the given parameters, which may name a kind."""
        return self.kind_presets.get(str(given.get("kind", "")), self.presets).get(name, {})

    def ports(self, chosen: Any) -> tuple[Port, ...]:
        """What is written with the chosen parameters."""
        kind = str(getattr(chosen, "kind", ""))
        return tuple(port for port in self.outputs if not port.kinds or kind in port.kinds)

    def modules(self, chosen: Any) -> tuple[str, ...]:
        """Modules from which the code digest starts, for the chosen parameters."""
        kind = str(getattr(chosen, "kind", ""))
        selected = (self.implementations[kind].partition(":")[0],) if kind in self.implementations else ()
        return (self.run.__module__, *selected)

    def versioned(self, chosen: Any) -> tuple[str, ...]:
        """Distributions whose version counts in the key, for the chosen parameters."""
        return self.libraries + self.kind_libraries.get(str(getattr(chosen, "kind", "")), ())

    def implementation(self, kind: str) -> Callable[..., Any]:
        """The function that the table of implementations names for `kind`, imported now."""
        return cast("Callable[..., Any]", load(self.implementations[kind]))


def load(reference: str) -> Any:
    """The object that an import string ``module:name`` names."""
    module, _, name = reference.partition(":")
    return getattr(importlib.import_module(module), name)


def _word(name: str) -> int:
    """A number that stands for a name in a seed sequence."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
