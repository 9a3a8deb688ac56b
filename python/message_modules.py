#!/usr/bin/env python3
"""Makes hedgehop/messages.py and messages.pyi of what lcm-gen wrote.

  message_modules.py PROJECT GENERATED PACKAGE

lcm-gen gives one module a type, which name each other as if they were the whole package `hedgehop`; here they
become one module, and a stub says of which type each field is.
"""

import pathlib
import re
import sys

PYTHON_TYPES = {"string": "str", "float": "float", "double": "float", "boolean": "bool", "byte": "int"}


def module_of(generated):
    bodies = []
    for path in sorted(generated.glob("*_t.py")):
        text = path.read_text()
        body = text[text.index(f"class {path.stem}(object)"):].rstrip()
        body = re.sub(r"\bhedgehop\.(\w+_t)\b", r"\1", body)
        bodies.append(body)
    return ('"""LCM types of hedgehop, made by lcm-gen."""\n\nfrom io import BytesIO\nimport struct\n\n\n'
            + "\n\n\n".join(bodies) + "\n")


def stub_of(structs):
    lines = ["from typing import Sequence", ""]
    for struct in structs.values():
        lines += ["", f"class {struct.name}:"]
        lines += [f"    {name}: int" for name in struct.constants]
        for field in struct.fields:
            python = PYTHON_TYPES.get(field.type, field.type if field.type in structs else "int")
            if field.dimension is not None:
                python = "bytes" if field.type == "byte" else f"Sequence[{python}]"
            lines.append(f"    {field.name}: {python}")
        lines += ["    def __init__(self) -> None: ...", "    def encode(self) -> bytes: ...", "    @staticmethod",
                  f"    def decode(data: bytes) -> {struct.name}: ..."]
    return "\n".join(lines) + "\n"


def main():
    project, generated, package = map(pathlib.Path, sys.argv[1:])
    sys.path.insert(0, str(project / "scripts"))
    import lcm_schema
    package.mkdir(parents=True, exist_ok=True)
    (package / "messages.py").write_text(module_of(generated))
    (package / "messages.pyi").write_text(stub_of(lcm_schema.load(project / "lcmtypes")))


if __name__ == "__main__":
    main()
