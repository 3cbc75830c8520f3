"""Where machine code that numba compiles is kept: a folder named by what the code depends on.

numba's own on-disk cache looks at the file of a compiled function only, so that after an edit of a helper in another
module it serves the stale caller. The folder's name is therefore a digest of all first-party modules that compiled
modules reach, of numba's version and of the processor: an edit leads to another folder.
"""

from __future__ import annotations

import errno
import hashlib
import importlib.util
import os
import re
import sys
from pathlib import Path

from pipeline import code
from pipeline.environment import processor
from pipeline.errors import StoreError
from pipeline.key import version

VARIABLE = "NUMBA_CACHE_DIR"


def use_cache_for(package: str) -> Path:
    """Set numba's cache folder for the compiled modules of a package; call before numba is imported.

    Returns the folder. Changes the environment of this process, which workers inherit. Raises StoreError where the
    folder cannot be written: numba would use its own cache, and serve stale code from it.
    """
    try:
        folder = cache_root() / "compiled" / _digest(package)
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home
        raise StoreError(
            f"The cache of compiled code cannot be written ({error}): set CLPV_CACHE_DIR to a folder that can."
        ) from None
    os.environ[VARIABLE] = str(folder)
    numba = sys.modules.get("numba")
    if numba is not None:
        numba.config.CACHE_DIR = str(folder)
    return folder


def cache_root() -> Path:
    """The user's cache folder of this program: CLPV_CACHE_DIR, or below XDG_CACHE_HOME, or below ~/.cache."""
    own = os.environ.get("CLPV_CACHE_DIR")
    if own:
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "clpv"


def _digest(package: str) -> str:
    definitions = code.reached(compiled_modules(package))
    text = "\n".join((code.code_digest(definitions), version("numba"), version("numpy"), sys.version, processor()))
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def compiled_modules(package: str) -> list[str]:
    """Names of the modules of a package that import numba, or the package's own `compiled`."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return []
    base = Path(spec.origin).parent
    wanted = re.compile(rf"^\s*(?:from|import)\s+(?:numba|{re.escape(package)}\.compiled)\b", re.MULTILINE)
    names = []
    for path in sorted(base.rglob("*.py")):
        if wanted.search(path.read_text(encoding="utf-8")):
            names.append(".".join((package, *path.relative_to(base).with_suffix("").parts)))
    return names
