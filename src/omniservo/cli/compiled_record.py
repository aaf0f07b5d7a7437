"""What has been compiled, remembered from one call of ``omniservo warm-up`` to the next."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path

import omniservo
from omniservo.errors import InputError
from omniservo.files import read_document, write_whole


class CompiledRecord:
    """Holds which files of compiled code there were when everything was compiled.

    There is one for each text of this package's code, Numba, Python and processor: as Numba keeps what it
    compiles. It stands in the user's folder for caches.
    """

    def __init__(self) -> None:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        self.path = folder / "omniservo" / f"compiled-{_key()}.json"

    def is_complete(self) -> bool:
        """Return whether everything was compiled and is still there."""
        try:
            files = read_document(self.path)
        except InputError:
            return False
        return isinstance(files, list) and bool(files) and all(Path(str(file)).is_file() for file in files)

    def save(self) -> bool:
        """Note the files that there are now; return whether they could be noted."""
        files = sorted(str(file) for folder in _cache_folders() for file in folder.glob("*.nb[ic]"))
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.path, json.dumps(files), force=True)
        except (OSError, InputError):
            return False
        return True


def _key() -> str:
    import llvmlite.binding as llvm

    package = Path(omniservo.__file__).parent
    hashed = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        hashed.update(file.read_bytes())
    settings = {name: value for name, value in os.environ.items() if name.startswith("NUMBA_")}
    processor = (llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    versions = (version("numba"), version("llvmlite"), platform.python_version())
    hashed.update(repr((str(package), sorted(settings.items()), processor, versions)).encode())
    return hashed.hexdigest()[:16]


def _cache_folders() -> set[Path]:
    """Return where Numba keeps what this process has loaded or compiled."""
    from numba.core.dispatcher import Dispatcher

    ours = [module for name, module in list(sys.modules.items()) if name.startswith("omniservo.")]
    found = (value for module in ours for value in vars(module).values() if isinstance(value, Dispatcher))
    return {Path(kernel.stats.cache_path) for kernel in found if kernel.stats.cache_path}
