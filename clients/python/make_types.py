#!/usr/bin/env python3
"""Writes the types of requests and answers from the OpenAPI document of the server: make_types.py [--check]

What bodies of requests hold becomes typed dictionaries, what answers hold becomes data classes with arrays of numpy.
With --check nothing is written; the exit code says whether the files are up to date.
"""

from __future__ import annotations

import json
import sys
import textwrap
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
DOCUMENT = HERE / "../../tests/data/openapi.json"
PACKAGE = HERE / "src/slipdrive"
# A completed request, which is sent again more often than it is looked at.
COMPLETED = "ValidateResponse"
# Parts of answers that are asked again: the torques of a plan in a simulation, its end as the next start.
ASKED_AGAIN = {"TorqueSchedule": "TorqueSchedule", "State": "EndState"}
WIDTH = 120
SCALARS = {"null": "None", "string": "str", "integer": "int", "number": "float", "boolean": "bool"}

Schema = dict[str, Any]


class Schemas:
    """The named schemas of a document: which are parts of requests, which are parts of answers."""

    def __init__(self, document: Schema) -> None:
        self.all: dict[str, Schema] = document["components"]["schemas"]
        self.enums = {name for name, schema in self.all.items() if "enum" in schema}
        operations = [operation for path in document["paths"].values() for operation in path.values()]
        asked = {name for operation in operations for name in references(operation.get("requestBody", {}))}
        given = {name for operation in operations for name in references(operation["responses"])} - asked - {COMPLETED}
        self.answers = self.reached_from(given, set()) - self.enums
        # A request that holds an answer takes it as it came.
        self.requests = self.reached_from(asked, given) - self.enums

    def reached_from(self, names: set[str], without: set[str]) -> set[str]:
        """These schemas and all that they hold, apart from some."""
        reached: set[str] = set()
        while names:
            reached |= names
            names = {held for name in names for held in references(self.all[name])} - reached - without
        return reached

    def type_of(self, schema: Schema, in_request: bool) -> str:
        """The Python type of a field."""
        if "$ref" in schema:
            return self.reference(schema["$ref"].rsplit("/", 1)[1], in_request)
        if "oneOf" in schema:
            return " | ".join(self.type_of(one, in_request) for one in schema["oneOf"])
        kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
        return " | ".join(self.plain(kind, schema, in_request) for kind in kinds)

    def reference(self, name: str, in_request: bool) -> str:
        if in_request and name in self.answers - self.requests:
            return f"answers.{name}"
        if in_request and name in ASKED_AGAIN:
            return f"{name} | answers.{ASKED_AGAIN[name]}"
        return name

    def plain(self, kind: str, schema: Schema, in_request: bool) -> str:
        if kind == "array":
            if is_number(schema["items"]):
                return "Numbers" if in_request else "Array"
            item = self.type_of(schema["items"], in_request)
            return f"Sequence[{item}]" if in_request else f"list[{item}]"
        if kind not in SCALARS:
            raise SystemExit(f"a field of type {kind}: {schema}")
        return SCALARS[kind]


def references(schema: Any) -> set[str]:
    """The names of the schemas that a schema mentions."""
    if isinstance(schema, dict):
        held = {schema["$ref"].rsplit("/", 1)[1]} if "$ref" in schema else set()
        return held.union(*(references(value) for value in schema.values()))
    return set().union(*(references(value) for value in schema)) if isinstance(schema, list) else set()


def is_number(schema: Schema) -> bool:
    kinds = schema.get("type")
    return kinds == "number" or (isinstance(kinds, list) and "number" in kinds)


def bounds(schema: Schema) -> str:
    """The bounds of a number, as the server judges them."""
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    texts = [f"{sign} {schema[key]:g}" for key, sign in signs.items() if key in schema]
    return f" [{', '.join(texts)}]" if texts else ""


def docstring(text: str, indent: str) -> list[str]:
    """A literal that says what a class or a field is."""
    text = " ".join(line.strip() for line in text.splitlines()).replace("\\", "\\\\")
    lines = textwrap.wrap(f'"""{text}', WIDTH - len(indent) - 3, break_on_hyphens=False)
    if len(lines) == 1:
        return [f'{indent}{lines[0]}"""']
    return [f"{indent}{line}" for line in [*lines, '"""']]


def described(schema: Schema) -> str:
    held = next((one for one in schema.get("oneOf", ()) if "description" in one), schema)
    return str(held.get("description", ""))


def enum(name: str, schema: Schema) -> list[str]:
    values = ", ".join(json.dumps(value) for value in schema["enum"])
    # One line per value, as the schema has it.
    notes = [f"# {part}" for line in schema["description"].splitlines() for part in textwrap.wrap(line, WIDTH - 2)]
    return [*notes, f"{name} = Literal[{values}]", ""]


def typed_dict(name: str, schemas: Schemas) -> list[str]:
    """A request; Python 3.10 needs a class of its own for the fields that must be there."""
    schema = schemas.all[name]
    required = [field for field in schema["properties"] if field in schema.get("required", ())]
    optional = [field for field in schema["properties"] if field not in required]
    lines: list[str] = []

    def fields(names: list[str]) -> list[str]:
        body = []
        for field in names:
            of = schema["properties"][field]
            body += [f"    {field}: {schemas.type_of(of, in_request=True)}"]
            body += docstring(described(of) + bounds(of), "    ")
        return body

    base = "TypedDict"
    if required and optional:
        base = f"_{name}Required"
        lines += [f"class {base}(TypedDict):", *fields(required), "", ""]
    total = "" if required and not optional else ", total=False"
    lines += [f"class {name}({base}{total}):", *docstring(schema["description"], "    "), ""]
    return [*lines, *fields(optional or required), "", ""]


def data_class(name: str, schemas: Schemas) -> list[str]:
    schema = schemas.all[name]
    lines = [
        "@dataclass(frozen=True, kw_only=True, eq=False)",
        f"class {name}:",
        *docstring(schema["description"], "    "),
        "",
    ]
    for field, of in schema["properties"].items():
        kind = schemas.type_of(of, in_request=False)
        # What a schema does not promise is left out where there is none.
        absent = field not in schema.get("required", ())
        kind = f"{kind} | None" if absent and not kind.endswith("| None") else kind
        lines += [f"    {field}: {kind}{' = None' if absent else ''}", *docstring(described(of), "    ")]
    return [*lines, "", ""]


def head(summary: str, *imports: str) -> list[str]:
    return [
        f'"""{summary}"""',
        "",
        "# Written by make_types.py: do not edit.",
        "",
        "from __future__ import annotations",
        "",
        *imports,
        "",
    ]


def requests_module(schemas: Schemas) -> str:
    used = {held for name in schemas.requests for held in references(schemas.all[name])} & schemas.enums
    lines = head(
        "Requests, as dictionaries.",
        "from collections.abc import Sequence",
        "from typing import Any, Literal, TypedDict",
        "",
        "import numpy as np",
        "import numpy.typing as npt",
        "",
        "from . import answers",
    )
    lines += ["Numbers = Sequence[float] | npt.NDArray[np.floating[Any]]", ""]
    for name in sorted(used):
        lines += enum(name, schemas.all[name])
    lines += [""]
    for name in sorted(schemas.requests):
        lines += typed_dict(name, schemas)
    return "\n".join(lines).rstrip("\n") + "\n"


def answers_module(schemas: Schemas) -> str:
    used = {held for name in schemas.answers for held in references(schemas.all[name])} & schemas.enums
    lines = head(
        "Answers; nan stands for numbers of arrays that are not finite, None for other ones.",
        "from dataclasses import dataclass",
        "from typing import Literal",
        "",
        "import numpy as np",
        "import numpy.typing as npt",
    )
    lines += ["Array = npt.NDArray[np.float64]", ""]
    for name in sorted(used):
        lines += enum(name, schemas.all[name])
    lines += [""]
    for name in sorted(schemas.answers):
        lines += data_class(name, schemas)
    return "\n".join(lines).rstrip("\n") + "\n"


def main() -> None:
    schemas = Schemas(json.loads(DOCUMENT.read_text()))
    modules = {"requests.py": requests_module(schemas), "answers.py": answers_module(schemas)}
    stale = [name for name, text in modules.items() if not is_file_with(PACKAGE / name, text)]
    if "--check" in sys.argv[1:]:
        if stale:
            raise SystemExit(f"run clients/python/make_types.py: {', '.join(stale)} not up to date")
        return
    for name in stale:
        (PACKAGE / name).write_text(modules[name])


def is_file_with(path: Path, text: str) -> bool:
    return path.is_file() and path.read_text() == text


if __name__ == "__main__":
    main()
