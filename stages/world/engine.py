"""PyBullet, imported quietly: its library prints a line, where a command's result or its errors belong."""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from typing import Any


@cache
def bullet() -> Any:
    """The module `pybullet`."""
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    kept, nowhere = (os.dup(1), os.dup(2)), os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in (1, 2):
            os.dup2(nowhere, descriptor)
        import pybullet

        return pybullet
    finally:
        ctypes.CDLL(None).fflush(None)  # the line may wait in the C library's buffer
        for descriptor, before in zip((1, 2), kept, strict=True):
            os.dup2(before, descriptor)
            os.close(before)
        os.close(nowhere)
