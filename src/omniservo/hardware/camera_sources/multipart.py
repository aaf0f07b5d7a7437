"""Cuts a stream of `multipart/x-mixed-replace`, as MJPEG cameras send it, into its parts."""

from __future__ import annotations

import re
from collections.abc import Iterator

MOST_PART, MOST_HEAD = 2**25, 2**14
"""longest part and longest head of a part [bytes]"""


class MultipartError(ValueError):
    """A stream is not in parts as it should be."""


def boundary_of(content_type: str) -> bytes:
    """Return what separates the parts.

    Raises:
        MultipartError: it is no stream of parts, or none is stated.
    """
    kind = content_type.split(";")[0].strip().lower()
    if kind != "multipart/x-mixed-replace":
        raise MultipartError(f"sends {kind[:60] or 'no type'}; MJPEG is multipart/x-mixed-replace")
    found = re.search(r';\s*boundary=(?:"([^"]+)"|([^\s;]+))', content_type, re.IGNORECASE)
    if found is None:
        raise MultipartError("states no boundary between its images")
    return (found[1] or found[2]).removeprefix("--").encode("latin-1")


class MultipartParser:
    """Takes a stream in, and gives its parts.

    Args:
        boundary: between the parts, without the dashes before it.
    """

    def __init__(self, boundary: bytes) -> None:
        self._mark = b"--" + boundary
        self._between = re.compile(rb"\r?\n(?:--)?" + re.escape(self._mark))
        """a boundary's own dashes were taken off it, and may stand in the stream or not"""
        self._bytes = bytearray()
        self._headers: dict[str, str] | None = None
        self._searched = 0

    def feed(self, stream: bytes) -> Iterator[tuple[dict[str, str], bytes]]:
        """Yield headers (names in lower case) and content of every part that is whole now.

        Raises:
            MultipartError: no boundary where one must be, or more bytes than an image has.
        """
        self._bytes += stream
        while True:
            if self._headers is None and not self._take_head():
                return
            content = self._content()
            if content is None:
                return
            headers, self._headers = self._headers or {}, None
            yield headers, content

    def _take_head(self) -> bool:
        """Take a boundary and the headers behind it off the stream, once they are whole."""
        start = self._bytes.find(self._mark)
        if start < 0 or start > MOST_HEAD:
            if len(self._bytes) > MOST_HEAD:
                raise MultipartError(f"no boundary in {MOST_HEAD} bytes")
            return False
        end = re.compile(rb"\r?\n\r?\n").search(self._bytes, start)
        if end is None:
            if len(self._bytes) - start > MOST_HEAD:
                raise MultipartError(f"a part's headers are longer than {MOST_HEAD} bytes")
            return False
        lines = bytes(self._bytes[start : end.start()]).decode("latin-1").splitlines()[1:]
        pairs = (line.partition(":") for line in lines)
        self._headers = {name.strip().lower(): value.strip() for name, _, value in pairs}
        del self._bytes[: end.end()]
        self._searched = 0
        return True

    def _content(self) -> bytes | None:
        """Take a part's content off the stream, once it is whole."""
        length = (self._headers or {}).get("content-length")
        if length is not None:
            if not (length.isascii() and length.isdigit() and int(length) <= MOST_PART):
                raise MultipartError(f"an image of {length[:20]} bytes; at most {MOST_PART} are read")
            end = int(length)
            if len(self._bytes) < end:
                return None
        else:
            found = self._between.search(self._bytes, self._searched)
            if found is None:
                if len(self._bytes) > MOST_PART:
                    raise MultipartError(f"an image of more than {MOST_PART} bytes")
                self._searched = max(len(self._bytes) - len(self._mark) - 4, 0)
                return None
            end = found.start()
        content = bytes(self._bytes[:end])
        del self._bytes[:end]
        return content
