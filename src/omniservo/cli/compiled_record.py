"""What has been compiled, remembered from one call of ``omniservo warm-up`` to the next."""

from __future__ import annotations

import os

from omniservo.errors import InputError
from omniservo.files import read_document, write_whole
from omniservo.geometry.kernel_cache import kernel_folders, user_folder


class CompiledRecord:
    """Holds how many compiled kernels there were when everything was compiled, beside the user's kernels."""

    def __init__(self) -> None:
        self.path = user_folder() / "complete.json"

    def is_complete(self) -> bool:
        """Return whether everything was compiled and is still there."""
        try:
            count = read_document(self.path)
        except InputError:
            return False
        return isinstance(count, int) and 0 < count <= _kernels()

    def save(self) -> bool:
        """Note how many kernels there are now; return whether that could be noted."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.path, str(_kernels()), force=True)
        except (OSError, InputError):
            return False
        return True


def where_compiled_is_kept() -> str:
    """Say whether what was compiled just now is there the next time."""
    folder = user_folder()
    if folder.is_dir() and os.access(folder, os.W_OK):  # compiling makes the folder where it can
        return "what is compiled is kept for the next time"
    return f"it is not kept, as {folder} cannot be written to: XDG_CACHE_HOME names another folder"


def _kernels() -> int:
    return len({file.name for folder in kernel_folders() for file in folder.glob("*.kernel")})
