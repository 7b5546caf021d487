"""What a package index shows: the project's links, and a README whose links lead there.

A package index has none of the files that README links to, so each relative link gets the
project's address and the version that is built.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(?P<picture>!?)(?P<words>\[[^\]]*\]\()(?P<path>[^)\s:#]+)(?=[)#])")
BLOCKS_OF_CODE = re.compile(r"(```.*?```)", re.DOTALL)


class PublicMetadata(MetadataHookInterface):
    """Derives ``urls`` and ``readme`` from the one address in ``pyproject.toml``."""

    def update(self, metadata: dict[str, Any]) -> None:
        address, ref = self.config["address"], ref_of(metadata["version"])
        metadata["urls"] = urls(address, ref)
        text = (Path(self.root) / "README.md").read_text()
        metadata["readme"] = {
            "content-type": "text/markdown",
            "text": readme(text, address, ref),
        }


def ref_of(version: str) -> str:
    """The tag or commit of a version, as links name it.

    A build between releases names its commit; one without git can only name the newest state.
    """
    if commit := re.search(r"\+g([0-9a-f]+)", version):
        return commit[1]
    return "HEAD" if "+" in version or version == "0.0" else f"v{version}"


def urls(address: str, ref: str) -> dict[str, str]:
    """The links beside the README, by the names that package indexes know."""
    return {
        "Homepage": address,
        "Documentation": f"{address}/blob/{ref}/docs/README.md",
        "Changelog": f"{address}/blob/{ref}/CHANGELOG.md",
        "Issues": f"{address}/issues",
        "Source": f"{address}/tree/{ref}",
    }


def readme(text: str, address: str, ref: str) -> str:
    """README with absolute links; pictures come as files, not as pages that show them."""

    def absolute(link: re.Match[str]) -> str:
        form = "raw" if link["picture"] else "blob"
        return f"{link['picture']}{link['words']}{address}/{form}/{ref}/{link['path']}"

    parts = BLOCKS_OF_CODE.split(text)
    return "".join(part if part.startswith("```") else LINK.sub(absolute, part) for part in parts)
