#!/usr/bin/env python3
"""Code lines, without blanks, comments and unit tests, of what lies between callers and the numerics."""

from pathlib import Path

ROOT = Path(__file__).parent.parent
PARTS = ["build.rs", "build", "src/rules.rs", "src/service", "src/queue", "src/metrics", "src/contract", "src/jobs", "src/api"]


def code_lines(path: Path) -> int:
    code = path.read_text().split("#[cfg(test)]\nmod tests {")[0]
    lines = (line.strip() for line in code.splitlines())
    return sum(1 for line in lines if line and not line.startswith("//"))


def files(part: Path) -> list[Path]:
    return [part] if part.is_file() else [path for path in part.rglob("*.rs") if path.stem != "tests"]


counts = {part: sum(map(code_lines, files(ROOT / part))) for part in PARTS}
for part, count in counts.items():
    print(f"{count:6} {part}")
print(f"{sum(counts.values()):6} in all")
