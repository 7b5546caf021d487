"""Parameter files: what the base decides, laid over the file that a package comes with."""

import os
import tempfile
from typing import Any, Dict

import yaml

Tree = Dict[str, Any]


def merged(own: Tree, over: Tree) -> Tree:
    """A new tree with all of both; where both have a value, the second one's."""
    found = dict(own)
    for key, value in over.items():
        below = found.get(key)
        both = isinstance(value, dict) and isinstance(below, dict)
        found[key] = merged(below, value) if both else value
    return found


def namespaced(own: Tree, namespace: str) -> Tree:
    """A new tree whose absolute topics are below a namespace: ``/scan`` is ``/bot1/scan``."""
    if not namespace:
        return own

    found = dict(own)
    for key, value in own.items():
        if isinstance(value, dict):
            found[key] = namespaced(value, namespace)
        elif key.endswith("topic") and str(value).startswith("/"):
            found[key] = f"/{namespace}{value}"
    return found


def packaged(package: str, *path: str) -> Tree:
    """A parameter file that an installed package comes with."""
    from ament_index_python.packages import get_package_share_directory

    return read(os.path.join(get_package_share_directory(package), *path))


def read(path: str) -> Tree:
    """A parameter file."""
    with open(path) as file:
        return dict(yaml.safe_load(file) or {})


def written(tree: Tree, name: str) -> str:
    """The path of a new parameter file; it stays until the system clears its temporary files."""
    descriptor, path = tempfile.mkstemp(prefix=f"yahboomd-{name}-", suffix=".yaml")
    with os.fdopen(descriptor, "w") as file:
        yaml.safe_dump(tree, file, sort_keys=False)
    return path
