#!/usr/bin/env python3
"""How many numbers and lines the search has: numeric literals and code lines of `src/solver` and `src/optimizer`.

Not counted are 0, 1, 2 and 1/2, lengths of arrays and sizes of types, comments, strings and tests; nor the paper's Nelder-Mead
and the bounds, which are no part of the search.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("src/solver", "src/optimizer")
LEFT_OUT = ("src/optimizer/nelder_mead.rs", "src/solver/bounds")
STRUCTURAL = {0.0, 0.5, 1.0, 2.0}

COMMENT = r"//[^\n]*|/\*.*?\*/"
STRING = r'b?r(?P<hashes>#*)".*?"(?P=hashes)|b?"(?:\\.|[^"\\])*"'
# A lifetime has no closing quote.
CHARACTER = r"b?'(?:\\[^']*|[^'\\])'"
NO_CODE = re.compile(rf"{COMMENT}|(?<!\w)(?:{STRING})|{CHARACTER}", re.DOTALL)
TEST_ONLY = re.compile(r"#\[cfg\(test\)\]\s*(?:#\[[^\]]*\]\s*)*")
TEST_FILE = re.compile(TEST_ONLY.pattern + r"(?:pub(?:\([^)]*\))?\s+)?mod (\w+);")
NUMBER = re.compile(r"(?<![\w.])(?:0[xob][\da-fA-F_]+|\d[\d_]*(?:\.\d[\d_]*)?(?:[eE][+-]?\d+)?)(?:_?[fiu](?:8|16|32|64|128|size))?")
NAME_OF_TYPE = re.compile(r"_?[fiu](?:8|16|32|64|128|size)$")
# What stands before a length in `[f64; 3]` and a size in `SMatrix<f64, 3, 5>`; comparisons have a space before `<`.
BEFORE_SIZE = re.compile(r"(?:;\s*|[\w:]<[\w\s,:&']*)$")
BRACKETED = re.compile(r"\[[^\[\]]*;\s*$")


def without_text(source: str) -> str:
    """The source without comments, strings and characters; line ends stay."""
    return NO_CODE.sub(lambda match: "\n" * match.group().count("\n") or " ", source)


def without_tests(code: str) -> str:
    """The code without items under `#[cfg(test)]`."""
    while match := TEST_ONLY.search(code):
        code = code[: match.start()] + code[end_of_item(code, match.end()) :]
    return code


def end_of_item(code: str, begin: int) -> int:
    """Where an item ends: at its semicolon, or at the brace that closes its first one."""
    depth = 0
    for place in range(begin, len(code)):
        if code[place] == "{":
            depth += 1
        elif code[place] == "}":
            depth -= 1
        if depth == 0 and code[place] in ";}":
            return place + 1
    return len(code)


def constants(code: str) -> list[str]:
    """The numbers that somebody chose."""
    # Ranges and tuple fields look like decimal points.
    code = re.sub(r"\.\.=?", " to ", code)
    matches = [match for match in NUMBER.finditer(code) if not is_size(code[: match.start()])]
    return [match.group() for match in matches if value(match.group()) not in STRUCTURAL]


def is_size(before: str) -> bool:
    """Whether a number after this text is the length of an array or the size of a type."""
    line = before[-200:]
    if not BEFORE_SIZE.search(line):
        return False
    return BRACKETED.search(line) is not None or not re.search(r";\s*$", line)


def value(number: str) -> float:
    """The value of a literal."""
    digits = NAME_OF_TYPE.sub("", number).replace("_", "")
    return float(int(digits, 0)) if digits[:2] in ("0x", "0o", "0b") else float(digits)


def code_lines(code: str) -> int:
    """Lines that are not blank."""
    return sum(1 for line in code.splitlines() if line.strip())


def sources() -> list[Path]:
    """The files that are counted."""
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.rs"))]
    tests = {path.parent / name for path in files for name in TEST_FILE.findall(path.read_text())}
    tests |= {path.with_suffix("") / name for path in files for name in TEST_FILE.findall(path.read_text())}
    out = {ROOT / name for name in LEFT_OUT} | {folder / "tests" for folder in {path.parent for path in files}} | tests

    def is_left_out(path: Path) -> bool:
        return path.stem == "tests" or any(part in out for part in (path, path.with_suffix(""), *path.parents))

    return [path for path in files if not is_left_out(path)]


def main() -> None:
    """Prints a line for each file, and the totals."""
    total_constants = total_lines = 0
    print("constants  lines")
    for path in sources():
        code = without_tests(without_text(path.read_text()))
        found, lines = constants(code), code_lines(code)
        total_constants, total_lines = total_constants + len(found), total_lines + lines
        print(f"{len(found):9} {lines:6} {path.relative_to(ROOT)}: {' '.join(found)}")
    print(f"{total_constants:9} {total_lines:6} in all")


if __name__ == "__main__":
    main()
