"""Files at the program's edge: untrusted ones read within bounds, results written whole or not at all."""

from omniservo.files.documents import (
    MAX_BYTES,
    MAX_YAML,
    MOST_YAML_VALUES,
    UNITS,
    as_text,
    file_inside,
    is_file,
    noting_reads,
    parse_document,
    read_bytes,
    read_document,
    read_text,
    require_file,
    stated_units,
)
from omniservo.files.python_class import python_class, stdout_to_stderr
from omniservo.files.results import (
    copy_whole,
    exists,
    unused,
    whole_folder,
    writable,
    writable_folder,
    write_whole,
)

__all__ = [
    "MAX_BYTES",
    "MAX_YAML",
    "MOST_YAML_VALUES",
    "UNITS",
    "as_text",
    "copy_whole",
    "exists",
    "file_inside",
    "is_file",
    "noting_reads",
    "parse_document",
    "python_class",
    "read_bytes",
    "read_document",
    "read_text",
    "require_file",
    "stated_units",
    "stdout_to_stderr",
    "unused",
    "whole_folder",
    "writable",
    "writable_folder",
    "write_whole",
]
