#!/usr/bin/env python3
"""Hardens the C++ that lcm-gen 1.3.1 writes, so that hostile bytes cost neither memory nor the process.

usage: harden_lcmtypes.py LCMTYPES_FOLDER RAW_FOLDER OUT_FOLDER

In each decoder, a count is compared with its stated maximum (constant MAX_<PLURAL>) and with the bytes that are left
before anything is allocated; a string must have a length of at least one and exactly one zero, at its end; an array of
zero length is emptied. A line that is not known here stops the build: another lcm-gen needs another look.
Also writes all_types.hpp, which includes every type and lists them in HEDGEHOP_FOR_EACH_LCM_TYPE.
"""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import lcm_schema  # noqa: E402

PRIMITIVE = r"(?:byte|boolean|int8_t|int16_t|int32_t|int64_t|float|double)"
WHERE = r"buf, offset \+ pos, maxlen - pos"
UNCHANGED = [
    r"", r"\{", r"\}", r"int pos = 0, tlen;", r"return pos;",
    r"if\(tlen < 0\) return tlen; else pos \+= tlen;",
    rf"tlen = __{PRIMITIVE}_decode_array\({WHERE}, &this->\w+, 1\);",
    rf"tlen = __{PRIMITIVE}_decode_array\({WHERE}, &this->\w+\[0\], \d+\);",
    rf"tlen = __int32_t_decode_array\({WHERE}, &(?:__\w+_len__|__elem_len), 1\);",
    r"int32_t (?:__\w+_len__|__elem_len);",
    r"this->\w+(?:\[a0\])?\.assign\(\(\(const char\*\)buf\) \+ offset \+ pos, (?:__\w+_len__|__elem_len) - +1\);",
    r"pos \+= (?:__\w+_len__|__elem_len);",
    rf"tlen = this->\w+(?:\[a0\])?\._decodeNoHash\({WHERE}\);",
    r"for \(int a0 = 0; a0 < \d+; a0\+\+\) \{",
]


class UnknownLine(Exception):
    pass


def hardened_line(line, structs, struct, guarded):
    indent, text = re.fullmatch(r"(\s*)(.*)", line).groups()
    if any(re.fullmatch(pattern, text) for pattern in UNCHANGED):
        return [line]
    if match := re.fullmatch(r"if\((__\w+_len__|__elem_len) > maxlen - pos\) return -1;", text):
        length = match[1]
        begin = "((const char*)buf) + offset + pos"
        return [
            f"{indent}if({length} < 1 || {length} > maxlen - pos) return -1;",
            f"{indent}if(memchr({begin}, 0, (size_t){length}) != {begin} + {length} - 1) return -1;",
        ]
    if match := re.fullmatch(r"if\(this->(\w+)\) \{", text):
        return [f"{indent}if(this->{match[1]} < 0) return -1;", line]
    if match := re.fullmatch(r"this->(\w+)\.resize\(this->(\w+)\);", text):
        array, count = struct.field_named(match[1]), match[2]
        limit = struct.constants.get("MAX_" + count.removeprefix("num_").upper())
        if array is None or array.dimension != count or limit is None:
            raise UnknownLine(f"{struct.name}.{match[1]}: no constant bounds its length '{count}'")
        least = lcm_schema.least_bytes(structs, array.type)
        guarded.add(array.name)
        return [
            f"{indent}if(this->{count} < 0 || this->{count} > {limit} ||",
            f"{indent}   (int64_t)this->{count} * {least} > (int64_t)(maxlen - pos)) return -1;",
            line,
        ]
    if match := re.fullmatch(rf"tlen = __{PRIMITIVE}_decode_array\({WHERE}, &this->(\w+)\[0\], this->(\w+)\);", text):
        if match[1] not in guarded:
            raise UnknownLine(f"{struct.name}.{match[1]} is decoded before its length is checked")
        return [line]
    if match := re.fullmatch(r"for \(int a0 = 0; a0 < this->(\w+); a0\+\+\) \{", text):
        return [line]
    raise UnknownLine(f"{struct.name}: lcm-gen wrote a line that is not known: {text}")


def hardened(source, structs, struct):
    begin = re.search(rf"^int {struct.name}::_decodeNoHash\(.*\)$", source, re.MULTILINE)
    if not begin:
        raise UnknownLine(f"{struct.name}: no decoder found")
    end = source.index("\n}\n", begin.end())
    guarded, lines = set(), []
    variable = [f for f in struct.fields if f.is_variable]
    body = source[begin.end() + 1:end].split("\n")
    for line in body:
        lines += hardened_line(line, structs, struct, guarded)
        if line.strip() == "int pos = 0, tlen;":
            lines += [f"    this->{f.name}.clear();" for f in variable]
    if guarded != {f.name for f in variable}:
        raise UnknownLine(f"{struct.name}: unchecked arrays: {sorted({f.name for f in variable} - guarded)}")
    return source[:begin.end() + 1] + "\n".join(lines) + source[end:]


def main():
    types, raw, out = (Path(argument) for argument in sys.argv[1:4])
    structs = lcm_schema.load(types)
    out.mkdir(parents=True, exist_ok=True)
    for name, struct in structs.items():
        source = (raw / struct.package / f"{name}.hpp").read_text()
        text = hardened(source, structs, struct).replace("#include <lcm/lcm_coretypes.h>",
                                                         "#include <string.h>\n#include <lcm/lcm_coretypes.h>")
        target = out / f"{name}.hpp"
        if not target.exists() or target.read_text() != text:
            target.write_text(text)
    everything = "#pragma once\n" + "".join(f'#include "{struct.package}/{name}.hpp"\n'
                                            for name, struct in structs.items())
    everything += "#define HEDGEHOP_FOR_EACH_LCM_TYPE(X)" + "".join(f" X({name})" for name in structs) + "\n"
    target = out / "all_types.hpp"
    if not target.exists() or target.read_text() != everything:
        target.write_text(everything)


if __name__ == "__main__":
    try:
        main()
    except (UnknownLine, lcm_schema.SchemaError, OSError) as error:
        sys.exit(f"harden_lcmtypes: {error}")
