#!/usr/bin/env python3
"""Writes a version into every file that names it, and dates the changelog's section `Unreleased`.

set-version.py VERSION DATE      in the root of the repository; DATE as 2026-11-21

Prints the section, which is what the release says of itself. `cargo test --test service release` holds the files together.
"""
import pathlib, re, sys

VERSION, DATE = sys.argv[1:]
# File, and what stands before and after its version. Workers of sweeps are services of the same image.
PLACES = [
    ("Cargo.toml", r'\[package\]\nname = "slipdrive"\nversion = "', '"'),
    ("Cargo.lock", r'name = "slipdrive"\nversion = "', '"'),
    ("clients/python/pyproject.toml", r'\nname = "slipdrive"\nversion = "', '"'),
    ("tests/data/openapi.json", r'"version": "', r'"\n  }'),
    ("Dockerfile", r"ARG VERSION=", r"\n"),
    ("deploy/compose.yaml", r"image: slipdrive:", r"\n", 2),
    ("deploy/kubernetes/base/deployment.yaml", r"image: slipdrive:", r"\n"),
    ("deploy/kubernetes/sweeps/indexed-job/job.yaml", r"image: slipdrive:", r"\n"),
    ("deploy/kubernetes/sweeps/workers/deployment.yaml", r"image: slipdrive:", r"\n"),
    # Dots divide the parts of a subject.
    ("deploy/kubernetes/sweeps/workers/scaler.yaml", r"consumer: workers-", r"\n", 1, VERSION.replace(".", "_")),
    ("deploy/kubernetes/overlays/site/kustomization.yaml", r"newTag: ", r"\n"),
]


def set_version(path, before, after, places=1, version=VERSION):
    file = pathlib.Path(path)
    text, count = re.subn(f"({before})[0-9][^\\s\"]*(?={after})", lambda found: found[1] + version, file.read_text())
    if count != places:
        sys.exit(f"{path}: {count} places name a version, want {places}")
    file.write_text(text)


def date_changelog():
    file = pathlib.Path("CHANGELOG.md")
    head, mark, rest = file.read_text().partition("## Unreleased\n")
    section, older, tail = rest.partition("\n## ")
    if not mark or not section.strip():
        sys.exit("CHANGELOG.md: no section `## Unreleased` that says what is new")
    file.write_text(f"{head}## {VERSION} - {DATE}\n{section}{older}{tail}")
    return section.strip()


for place in PLACES:
    set_version(*place)
print(date_changelog())
