"""Shipped tasks with something changed."""

import json
from importlib import resources

from omniservo.files import read_document


def shipped(name):
    """The document of a shipped task, free to be changed."""
    with resources.as_file(resources.files("omniservo.tasks") / "shipped" / f"{name}.yaml") as path:
        return read_document(path)


def written(folder, document):
    """A task file with this document."""
    path = folder / "task.yaml"
    path.write_text(json.dumps(document))  # JSON is YAML
    return path
