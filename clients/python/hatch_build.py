"""A step of the build that hatchling lacks."""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class LicenceTexts(BuildHookInterface[Any]):
    """Puts the text of the licences into the source distribution, where hatchling puts links that lead out of it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Names the file that a link leads to in place of the link."""
        files: dict[str, str] = build_data["force_include"]
        build_data["force_include"] = {str(Path(source).resolve()): name for source, name in files.items()}
