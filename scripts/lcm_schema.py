"""Reads the subset of the .lcm language that lcmtypes/ uses. Anything else is an error."""

import re
from dataclasses import dataclass, field
from pathlib import Path

PRIMITIVE_BYTES = {
    "int8_t": 1, "int16_t": 2, "int32_t": 4, "int64_t": 8, "float": 4, "double": 8, "byte": 1, "boolean": 1,
    "string": 5,  # at least: length and terminating zero
}


class SchemaError(Exception):
    pass


@dataclass
class Field:
    name: str
    type: str
    dimension: str | None  # None, a number, or the name of the count field
    comment: list[str]
    line: int

    @property
    def is_variable(self):
        return self.dimension is not None and not self.dimension.isdigit()


@dataclass
class Struct:
    name: str
    path: Path
    package: str
    header: list[str]
    fields: list[Field] = field(default_factory=list)
    constants: dict[str, int] = field(default_factory=dict)

    def field_named(self, name):
        return next((f for f in self.fields if f.name == name), None)


def parse(path):
    struct, package, comment = None, None, []
    for number, raw in enumerate(Path(path).read_text().splitlines(), 1):
        line = raw.strip()
        where = f"{path}:{number}"
        if line.startswith("//"):
            comment.append(line[2:].strip())
            continue
        if match := re.fullmatch(r"package (\w+);", line):
            package = match[1]
        elif match := re.fullmatch(r"struct (\w+)", line):
            if struct:
                raise SchemaError(f"{where}: a second struct in one file")
            struct = Struct(match[1], Path(path), package, comment)
            comment = []
        elif line in ("{", "}"):
            comment = []
        elif match := re.fullmatch(r"const (int8_t|int16_t|int32_t|int64_t) (.*);", line):
            for assignment in match[2].split(","):
                name, value = assignment.split("=")
                if name.strip() in struct.constants:
                    raise SchemaError(f"{where}: constant {name.strip()} twice")
                struct.constants[name.strip()] = int(value)
            comment = []
        elif match := re.fullmatch(r"(\w+) (\w+)(?:\[(\w+)\])?;", line):
            struct.fields.append(Field(match[2], match[1], match[3], comment, number))
            comment = []
        elif line:
            raise SchemaError(f"{where}: not understood: {line}")
        elif comment and struct is None and package is None:
            comment = []
    if struct is None:
        raise SchemaError(f"{path}: no struct")
    return struct


def load(folder):
    structs = {}
    for path in sorted(Path(folder).glob("*.lcm")):
        struct = parse(path)
        structs[struct.name] = struct
    return structs


def least_bytes(structs, type_name):
    """Encoded size of one value at least."""
    if type_name in PRIMITIVE_BYTES:
        return PRIMITIVE_BYTES[type_name]
    total = 0
    for f in structs[type_name].fields:
        if f.is_variable:
            continue
        total += least_bytes(structs, f.type) * (int(f.dimension) if f.dimension else 1)
    return total


def _signed_shift_right(value, bits):
    return (value - (1 << 64) >> bits) if value >= 1 << 63 else value >> bits


def _update(hash_value, byte):
    byte = byte - 256 if byte > 127 else byte
    return (((hash_value << 8) ^ _signed_shift_right(hash_value, 55)) + byte) & (2**64 - 1)


def _update_string(hash_value, text):
    hash_value = _update(hash_value, len(text))
    for character in text.encode():
        hash_value = _update(hash_value, character)
    return hash_value


def _own_hash(struct):
    value = 0x12345678
    for f in struct.fields:
        value = _update_string(value, f.name)
        if f.type in PRIMITIVE_BYTES:
            value = _update_string(value, f.type)
        value = _update(value, 1 if f.dimension is not None else 0)
        if f.dimension is not None:
            value = _update(value, 1 if f.is_variable else 0)
            value = _update_string(value, f.dimension)
    return value


def fingerprint(structs, name):
    """The 64 bits that LCM puts before a message of this type."""
    value = _own_hash(structs[name])
    for f in structs[name].fields:
        if f.type not in PRIMITIVE_BYTES:
            value += fingerprint(structs, f.type)
    value &= 2**64 - 1
    return ((value << 1) + (value >> 63)) & (2**64 - 1)
