#!/usr/bin/env python3
"""Writes the fields of all message types as a C++ table, for programs that show any message.

usage: scripts/lcm_fields.py LCMTYPES_FOLDER OUTPUT_FILE
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import lcm_schema  # noqa: E402


def main():
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        return 0
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    lines = ["// Made by scripts/lcm_fields.py: type, field, type of the field, dimension."]
    for struct in lcm_schema.load(sys.argv[1]).values():
        for field in struct.fields:
            lines.append(f'{{"{struct.name}", "{field.name}", "{field.type}", "{field.dimension or ""}"}},')
    Path(sys.argv[2]).write_text("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
