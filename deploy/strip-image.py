#!/usr/bin/env python3
"""Takes the random names of the machine that built it out of an image in a folder (`dir:`), and prints its digest.

strip-image.py FOLDER

Buildah writes the names of its build container into the configuration of images in Docker's format, which alone knows health
checks. Without them, the same sources give the same digest.
"""
import hashlib
import json
import pathlib
import sys

folder = pathlib.Path(sys.argv[1])


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


manifest = json.loads((folder / "manifest.json").read_text())
old = folder / manifest["config"]["digest"].removeprefix("sha256:")
config = json.loads(old.read_text())
config.pop("container", None)
for part in ("config", "container_config"):
    config.get(part, {}).pop("Hostname", None)
content = json.dumps(config, separators=(",", ":")).encode()
old.unlink()
(folder / digest(content)).write_bytes(content)
manifest["config"].update(digest=f"sha256:{digest(content)}", size=len(content))
content = json.dumps(manifest, separators=(",", ":")).encode()
(folder / "manifest.json").write_bytes(content)
print(f"sha256:{digest(content)}")
