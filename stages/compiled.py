"""The decorators by which first-party functions are compiled to machine code.

Not fast-math: sums keep their order, so the same input gives the same bytes. Which folder the compiled code is kept in
is the engine's affair (`pipeline/compiled.py`): numba's own cache does not notice an edit in another module.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")

_LEAN: dict[str, Any] = {"_nrt": False}
"""Numba's option for functions without its run-time memory management; `numba.extending` describes it."""


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with numba, keep the machine code on disk; division by zero gives inf or nan as in numpy."""
    return cast("Callable[P, R]", numba.njit(cache=True, error_model="numpy")(function))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`; and where compiled code calls `function`, its machine code is merged into it.

    A call hands over every array as seven or more words and counts its references; in a small function that is called
    millions of times in a fit that took a quarter of the time. The numbers are the same.
    """
    return cast("Callable[P, R]", numba.njit(cache=True, error_model="numpy", forceinline=True)(function))


def lean(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, of a function that allocates nothing: references to its arrays are not counted.

    A step of a policy touches some forty small arrays hundreds of times; counting who holds them, in atomic
    operations, took more time than the mathematics.
    """
    return cast("Callable[P, R]", numba.njit(cache=True, error_model="numpy", **_LEAN)(function))
