#!/usr/bin/env python3
"""Checks lcmtypes/ against the rules of its README, and the channel list against channels.hpp.

usage: scripts/check_lcmtypes.py [PROJECT_FOLDER]

Prints one line for each fault, file:line first; exit code 1 if there is any.
"""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import lcm_schema  # noqa: E402

SUFFIX_OF_UNIT = {
    "m": "_m", "s": "_s", "us": "_us", "m/s": "_mps", "m/s2": "_mps2", "rad": "_rad", "rad/s": "_radps",
    "1/m": "_1pm", "rad m": "_rad_m", "kg": "_kg", "N": "_n", "bytes": "_bytes",
}
UNIT_SUFFIXES = sorted(SUFFIX_OF_UNIT.values(), key=len, reverse=True)
STAMP = [("utime", "int64_t"), ("sender_id", "int64_t"), ("seq", "int64_t"), ("version", "int16_t")]
TAGS = {"range", "invalid", "frame", "epoch", "equals"}
BARE_NAMES = {"x", "y", "z", "theta", "phi", "psi", "lat", "lon", "alt", "angle", "speed", "height", "time"}
HEADER_KEYS = ["Channel", "Publisher", "Readers", "Loss", "Version"]
MESSAGE_BYTES_MAX = 1400


def header_of(struct):
    values = {}
    for line in struct.header:
        if match := re.fullmatch(r"(\w+):\s+(.+)", line):
            values.setdefault(match[1], match[2])
    return values


def check_field(struct, field, earlier, structs, fault):
    where = field.line
    first = field.comment[0] if field.comment else ""
    match = re.match(r"\[([^\]@]+)\]", first)
    if not match:
        fault(where, f"the comment above '{field.name}' does not begin with [unit]")
        return
    unit = match[1]
    for tag in re.findall(r"\[@(\w+)", " ".join(field.comment)):
        if tag not in TAGS:
            fault(where, f"'{field.name}': unknown tag @{tag}; known are {', '.join(sorted(TAGS))}")
    suffix = next((s for s in UNIT_SUFFIXES if field.name.endswith(s)), None)
    if field.name.startswith("num_"):
        suffix = None
    if field.name == "utime":
        suffix = "_us"
    if unit == "-":
        if suffix:
            fault(where, f"'{field.name}' ends in {suffix}, but its comment says that it has no unit")
    elif unit not in SUFFIX_OF_UNIT:
        fault(where, f"'{field.name}': unknown unit [{unit}]")
    elif suffix != SUFFIX_OF_UNIT[unit]:
        fault(where, f"'{field.name}' is in [{unit}] and must end in {SUFFIX_OF_UNIT[unit]}")
    if field.name in BARE_NAMES:
        fault(where, f"'{field.name}' says neither frame nor unit")
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", field.name):
        fault(where, f"'{field.name}' is not snake_case")
    if field.type not in lcm_schema.PRIMITIVE_BYTES and field.type not in structs:
        fault(where, f"'{field.name}' has the unknown type {field.type}")
    if field.name.startswith("num_"):
        if "MAX_" + field.name[4:].upper() not in struct.constants:
            fault(where, f"'{field.name}' has no constant MAX_{field.name[4:].upper()}")
        if field.type != "int32_t" or "[@range" not in first:
            fault(where, f"'{field.name}' must be an int32_t with a [@range]")
    if field.is_variable:
        if not field.dimension.startswith("num_") or field.dimension not in earlier:
            fault(where, f"the length of '{field.name}' must be a field num_<plural> above it")
        if field.type in structs and any(
                f.is_variable or f.type == "string" for f in structs[field.type].fields):
            fault(where, f"'{field.name}': elements of an array must have a fixed size")


def most_bytes(structs, struct):
    """Longest encoding, texts left out."""
    total = 8
    for field in struct.fields:
        count = 1
        if field.is_variable:
            count = struct.constants.get("MAX_" + field.dimension[4:].upper(), 0)
        elif field.dimension:
            count = int(field.dimension)
        total += count * lcm_schema.least_bytes(structs, field.type)
    return total


def check_struct(struct, structs, fault):
    if struct.path.stem != struct.name:
        fault(1, f"the file must be called {struct.name}.lcm")
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*_t", struct.name):
        fault(1, f"'{struct.name}' is not snake_case_t")
    if struct.package != "hedgehop":
        fault(1, f"the package is {struct.package}, not hedgehop")
    header = header_of(struct)
    for key in HEADER_KEYS:
        if key not in header:
            fault(1, f"the header line '{key}:' is missing")
    if not struct.header or re.match(r"\w+:\s", struct.header[0]):
        fault(1, "the header does not begin with a line that says what the message is")
    channel = header.get("Channel", "none")
    is_part = channel.startswith("none, part of")
    is_blob = channel.startswith("none, travels")
    is_replaced = channel.startswith("none, replaced by")
    names = [(f.name, f.type) for f in struct.fields]
    if is_part:
        if "VERSION" in struct.constants:
            fault(1, "a part of other types has no version of its own")
    else:
        wanted = STAMP[3:] if is_blob else STAMP
        if names[:len(wanted)] != wanted:
            fault(1, "must begin with " + ", ".join(f"{t} {n}" for n, t in wanted))
        version = header.get("Version", "").split(" ")[0]
        if str(struct.constants.get("VERSION")) != version:
            fault(1, f"VERSION is {struct.constants.get('VERSION')}, the header line says {version}")
    if not is_part and not is_blob:
        if not is_replaced and not re.fullmatch(r"[A-Z][A-Z0-9]*(_[A-Z0-9]+)*", channel):
            fault(1, f"'{channel}' is no channel name")
        if (size := most_bytes(structs, struct)) > MESSAGE_BYTES_MAX:
            fault(1, f"may have {size} bytes and more, must fit {MESSAGE_BYTES_MAX}")
    earlier = set()
    for field in struct.fields:
        check_field(struct, field, earlier, structs, fault)
        earlier.add(field.name)
    for constant in struct.constants:
        if constant == "VERSION" or constant.startswith("MAX_"):
            continue
        if not any(constant.startswith(f.name.upper() + "_") for f in struct.fields):
            fault(1, f"constant {constant} does not begin with the name of a field")


def table_of(readme):
    """channel -> type, from the first table."""
    rows = {}
    for line in readme.read_text().splitlines():
        if match := re.match(r"\| `([A-Z_0-9]+)` \| `(\w+)` \|", line):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if len(cells) != 6 or not all(cells):
                yield None, f"{readme}: row of {match[1]} has an empty cell"
            elif match[1] in rows:
                yield None, f"{readme}: {match[1]} twice"
            rows[match[1]] = match[2]
    yield rows, None


def check_channels(folder, structs, faults):
    readme = folder / "lcmtypes" / "README.md"
    header = folder / "common" / "messages" / "channels.hpp"
    listed = {}
    for rows, error in table_of(readme):
        if error:
            faults.append(error)
        else:
            listed = rows
    text = header.read_text()
    constants = dict(re.findall(r'inline constexpr Channel<\w+> (k\w+Channel)\{"([A-Z_0-9]+)"\};', text))
    typed = {constants.get(name, name): type_name
             for name, type_name in re.findall(r'\{(k\w+Channel)\.name, "(\w+)"\}', text)}
    in_types = {header_of(s)["Channel"]: s.name for s in structs.values()
                if not header_of(s).get("Channel", "none").startswith("none")}
    for what, found in ((header, set(constants.values())), (header, set(typed))):
        for channel in sorted(set(listed) ^ found):
            faults.append(f"{what}: channel {channel} stands only {'in the README' if channel in listed else 'here'}")
    for channel, type_name in sorted(listed.items()):
        if typed.get(channel, type_name) != type_name:
            faults.append(f"{header}: {channel} carries {typed[channel]}, the README says {type_name}")
        if in_types.get(channel) != type_name:
            faults.append(f"{readme}: {channel} carries {type_name}, but the type files say {in_types.get(channel)}")
    for channel, type_name in sorted(in_types.items()):
        if channel not in listed:
            faults.append(f"{readme}: channel {channel} of {type_name} is missing")
    blobs = set(re.findall(r"^\| `(\w+_t)` \|", readme.read_text(), re.MULTILINE))
    wanted = {s.name for s in structs.values() if header_of(s).get("Channel", "").startswith("none, travels")}
    for name in sorted(blobs ^ wanted):
        faults.append(f"{readme}: the table of blobs and the type files disagree about {name}")


def main():
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        return 0
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent
    faults = []
    try:
        structs = lcm_schema.load(folder / "lcmtypes")
    except lcm_schema.SchemaError as error:
        sys.exit(str(error))
    if not structs:
        sys.exit(f"{folder / 'lcmtypes'}: no type found")
    for struct in structs.values():
        check_struct(struct, structs, lambda line, what, s=struct: faults.append(f"{s.path}:{line}: {what}"))
    seen = {}
    for name in structs:
        fingerprint = lcm_schema.fingerprint(structs, name)
        if fingerprint in seen:
            faults.append(f"{structs[name].path}:1: same fingerprint as {seen[fingerprint]}: a reader cannot tell them apart")
        seen[fingerprint] = name
    check_channels(folder, structs, faults)
    for fault in faults:
        print(fault, file=sys.stderr)
    print(f"{len(structs)} types, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
