"""What has been compiled, remembered from one call of ``omniservo warm-up`` to the next."""

from __future__ import annotations

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


def _kernels() -> int:
    return len({file.name for folder in kernel_folders() for file in folder.glob("*.kernel")})
