"""Plans as files for controllers, written by the server."""

from __future__ import annotations

from base64 import b64decode
from dataclasses import dataclass
from pathlib import Path

from . import answers


@dataclass(frozen=True, kw_only=True, eq=False)
class Exported(answers.ExportResponse):
    """Files of a plan, and what a controller that follows its twist alone would miss."""

    def __getitem__(self, name: str) -> bytes:
        """The content of the file of this name."""
        for file in self.files:
            if file.name == name:
                return b64decode(file.base64)
        raise KeyError(f"no file {name!r}, but {', '.join(file.name for file in self.files)}")

    def save(self, folder: str | Path) -> list[Path]:
        """Writes all files; the folder of a bag is the bag."""
        Path(folder).mkdir(parents=True, exist_ok=True)
        paths = []
        for file in self.files:
            paths.append(Path(folder) / file.name)
            paths[-1].write_bytes(b64decode(file.base64))
        return paths
