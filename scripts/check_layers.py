#!/usr/bin/env python3
"""Holds the include table of the project against the source.

Every #include in common/, services/, cli/ and python/ is checked: which rooms a room may use, which
third-party libraries, and whether those may show in a public header. A few words are checked too:
clock and environment outside the bus, transcendental functions of libm where decisions are made.

  scripts/check_layers.py               check the project; exit 1 and one line a finding
  scripts/check_layers.py --root DIR    check another tree of the same shape
  scripts/check_layers.py --self-test   plant faults in a copy and demand that each is found
  scripts/check_layers.py --table       print the table
"""

import argparse
import pathlib
import re
import shutil
import sys
import tempfile

# room: (rooms it may use, third party in public headers, third party in .cpp files and private headers)
# What a used room may use is allowed too. A private header is one that the room's CMakeLists.txt does
# not list under HEADERS; no other room may include it.
GDAL = ["gdal", "ogr", "cpl_"]
POSIX = ["unistd.h", "fcntl.h", "sys/", "spawn.h", "poll.h", "signal.h"]
SOCKETS = ["netinet/", "arpa/", "net/", "ifaddrs.h", "netdb.h", "pthread.h"]
JSON = ["nlohmann/"]
HIGHWAY = ["hwy/"]
TBB = ["tbb/", "oneapi/"]
EIGEN = ["Eigen/"]

ROOMS = {
    "base": ([], [], ["yaml-cpp/", "xxhash.h", "openssl/"] + POSIX),
    "geo": (["base"], [], ["proj", "geodesic.h"] + GDAL),
    "raster": (["base", "geo"], [], []),
    "map": (["raster", "geo", "base"], [], ["zstd.h"] + JSON + GDAL),
    "map_sources": (["raster", "geo", "base"], [], ["osmium/", "zlib.h"] + GDAL),
    "preparation": (["map_sources", "map", "raster"], [],
                    ["opencv2/"] + JSON + GDAL + TBB + HIGHWAY),
    "flight": (["base", "geo"], EIGEN, []),
    "risk": (["map", "flight"], [], ["opencv2/"]),
    "global_planning": (["risk", "map", "flight"], [], ["ompl/", "boost/"] + EIGEN + TBB),
    "command_model": (["flight", "base"], EIGEN, []),
    "local_planning": (["risk", "map", "flight", "command_model"], [], EIGEN + HIGHWAY),
    "verification": (["map", "flight"], [], []),
    "planning": (["global_planning", "local_planning", "verification", "command_model", "risk", "map",
                  "flight"], [], JSON),
    "briefing": (["risk", "map", "flight"], [], []),
    "output": (["briefing", "verification", "map", "flight", "risk"], [], JSON + GDAL + POSIX),
    "messages": (["planning", "map", "flight"], [], ["hedgehop/"]),
    "bus": (["messages", "base"], [], ["lcm/", "zstd.h"] + POSIX + SOCKETS),
    "fetch": (["geo", "base"], [], ["curl/", "openssl/"] + JSON + POSIX),
    "evaluation": (["planning", "output", "preparation"], [], ["boost/math/", "nlopt.h"] + GDAL + JSON + POSIX + TBB),
}

# Rooms in their order of dependency; these folders stand on top.
SERVICES = (["bus", "messages", "planning", "preparation", "output", "map"], [], ["CLI/", "malloc.h"] + JSON + POSIX + TBB)
CLI = (sorted(ROOMS), [], ["CLI/"] + JSON + POSIX + TBB)
PYTHON = (["planning", "preparation", "output", "bus"], [], ["pybind11/"] + TBB)

EVERYWHERE_IN_SOURCES = ["fmt/"]

# C++ headers that only some may include, with the reason.
RESTRICTED_STD = {
    "chrono": (["bus", "fetch", "services", "cli", "evaluation"], "time comes from messages; only the edges read a clock"),
    "ctime": (["bus", "services", "cli", "evaluation"], "time comes from messages; only the edges read a clock"),
    "iostream": (["bus", "services", "cli"], "libraries do not talk; they return values and use base/observer.hpp"),
    "regex": ([], "std::regex overflows the stack on long hostile input"),
}

DECIDING_ROOMS = ["geo", "raster", "map", "preparation", "flight", "risk", "global_planning",
                  "command_model", "local_planning", "verification"]
LIBM = re.compile(r"(?:\bstd::|(?<![\w:.>]))(?:::)?(sin|cos|tan|asin|acos|atan|atan2|exp|exp2|log|log2|log10|log1p|expm1"
                  r"|pow|cbrt|sinh|cosh|tanh)\s*\(")
# (words, where they are wrong, why)
WORDS = [
    (re.compile(r"\b(getenv|setenv|secure_getenv)\b"),
     lambda folder, room: folder == "common" and room != "bus", "the environment is read at the edges only"),
    (re.compile(r"\b(srand|drand48|random_device)\b"),
     lambda folder, room: folder == "common", "seeds come with the request, so that a run can be repeated"),
    (LIBM, lambda folder, room: folder == "common" and room in DECIDING_ROOMS,
     "its last bit depends on the processor; use hedgehop::elementary"),
]
# A line may be excused by a reason: // layers: reason
EXCUSE = re.compile(r"//\s*layers:\s*\S+")

STD_HEADERS = set("""
algorithm any array atomic barrier bit bitset cassert cctype cerrno cfenv cfloat charconv chrono
cinttypes climits clocale cmath codecvt compare complex concepts condition_variable coroutine csetjmp
csignal cstdarg cstddef cstdint cstdio cstdlib cstring ctime cuchar cwchar cwctype deque exception
execution filesystem format forward_list fstream functional future initializer_list iomanip ios iosfwd
iostream istream iterator latch limits list locale map memory memory_resource mutex new numbers numeric
optional ostream queue random ranges ratio regex scoped_allocator semaphore set shared_mutex
source_location span sstream stack stdexcept stop_token streambuf string string_view strstream
syncstream system_error thread tuple type_traits typeindex typeinfo unordered_map unordered_set utility
valarray variant vector version
""".split())

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
# An include inside a comment or a raw string is not one; block comments are blanked first.
BLOCK_COMMENT = re.compile(r"/\*.*?\*/", re.S)
SUFFIXES = (".hpp", ".cpp", ".h", ".cc", ".inl", ".ipp")


def closure(rooms):
    """The rooms and everything that they may use."""
    found, queue = set(), list(rooms)
    while queue:
        room = queue.pop()
        if room not in found:
            found.add(room)
            queue.extend(ROOMS[room][0])
    return found


def public_headers(folder):
    """Names under HEADERS in a room's CMakeLists.txt; None if it has none."""
    recipe = folder / "CMakeLists.txt"
    if not recipe.exists():
        return set()
    text = re.sub(r"#.*", "", recipe.read_text())
    found = set()
    for match in re.finditer(r"\bHEADERS\b(.*?)(?=\b(?:NAME|SOURCES|DEPENDS|PRIVATE_DEPENDS)\b|\))", text, re.S):
        found.update(match.group(1).split())
    return found


def matches(name, prefixes):
    return any(name.startswith(prefix) for prefix in prefixes)


class Check:
    def __init__(self, root):
        self.root = root
        self.findings = []
        self.includes = 0
        self.files = 0
        self.public = {}

    def say(self, path, line, text):
        self.findings.append(f"{path.relative_to(self.root)}:{line}: {text}")

    def run(self):
        common = self.root / "common"
        for folder in sorted(p for p in common.iterdir() if p.is_dir()):
            if folder.name not in ROOMS:
                self.findings.append(f"common/{folder.name}: a room that scripts/check_layers.py does not know; "
                                     "add it to the table with what it may use")
            self.public[folder.name] = public_headers(folder)
        for room in ROOMS:
            if not (common / room).is_dir():
                self.findings.append(f"common/{room}: in the table, but the folder is missing")
        for folder in ("common", "services", "cli", "python"):
            for path in sorted((self.root / folder).rglob("*")):
                if path.is_file() and path.suffix in SUFFIXES:
                    self.check_file(folder, path)
        return self.findings

    def check_file(self, folder, path):
        parts = path.relative_to(self.root / folder).parts
        room = parts[0] if len(parts) > 1 else ""
        if folder == "common":
            if room not in ROOMS:
                return
            used, in_headers, in_sources = ROOMS[room]
            allowed = closure(used) | {room}
        else:
            used, in_headers, in_sources = {"services": SERVICES, "cli": CLI, "python": PYTHON}[folder]
            allowed = closure(used)
        inside = "/".join(parts[1:])
        is_public = folder == "common" and inside in self.public[room]
        self.files += 1
        text = BLOCK_COMMENT.sub(lambda m: re.sub(r"[^\n]", " ", m.group()), path.read_text())
        own_header = inside[:-4] + ".hpp"
        if folder == "common" and path.suffix == ".cpp" and own_header in self.public[room]:
            self.check_own_header(path, text, f"{room}/{own_header}")
        for number, line in enumerate(text.split("\n"), 1):
            if EXCUSE.search(line):
                continue
            match = INCLUDE.match(line)
            if match:
                self.includes += 1
                self.check_include(folder, room, path, number, match.group(1), match.group(2), allowed,
                                   in_headers, in_sources, is_public)
            else:
                code = line.split("//")[0]
                for words, is_wrong, why in WORDS:
                    hit = words.search(code)
                    if hit and is_wrong(folder, room):
                        self.say(path, number, f"{hit.group(0).rstrip('( ')}: {why}")

    def check_own_header(self, path, text, header):
        """A source that begins with its own header proves that this compiles alone."""
        for number, line in enumerate(text.split("\n"), 1):
            match = INCLUDE.match(line)
            if match:
                if match.group(2) != header:
                    self.say(path, number, f'begin with "{header}": so it is seen to compile alone')
                return
        self.say(path, 1, f'includes nothing; begin with "{header}"')

    def check_include(self, folder, room, path, number, kind, name, allowed, in_headers, in_sources, is_public):
        owner = room if folder == "common" else folder
        first = name.split("/")[0]
        if kind == "<" and name in STD_HEADERS:
            if name in RESTRICTED_STD:
                where, why = RESTRICTED_STD[name]
                if owner not in where:
                    self.say(path, number, f"<{name}> in {owner}: {why}")
            return
        if first in ROOMS and "/" in name:
            if kind == "<":
                self.say(path, number, f"<{name}>: our own headers stand in quotes")
            if first not in allowed:
                self.say(path, number, f"{owner} may not use {first} ({name})")
            elif first != room or folder != "common":
                if name[len(first) + 1:] not in self.public.get(first, set()):
                    self.say(path, number, f"{name} is no public header of {first} (HEADERS in its CMakeLists.txt)")
            return
        if kind == '"' and "/" not in name:
            if not any((path.parent / (name + suffix)).exists() for suffix in ("", ".in")):
                self.say(path, number, f'"{name}" is not in the same folder; write "room/{name}"')
            return
        if folder in ("services", "cli") and kind == '"' and first == "services" and (self.root / name).exists():
            if folder == "services" and name.split("/")[1] not in (room, "shared"):
                self.say(path, number, f"a service never includes another one ({name}); they meet on channels")
            return
        if folder in ("services", "cli") and kind == '"' and (self.root / folder / name).exists():
            if folder == "services" and first != room:
                self.say(path, number, f"a service never includes another one ({name}); they meet on channels")
            return
        if matches(name, in_headers):
            return
        if matches(name, in_sources + EVERYWHERE_IN_SOURCES):
            if is_public:
                self.say(path, number, f"{name} in a public header of {owner}: hide it in a .cpp file")
            return
        self.say(path, number, f"{owner} may not use {name}")


# What the self-test plants: file, text, and what the finding must say.
FAULTS = [
    ("common/base/planted.hpp", '#include "geo/map_projection.hpp"\n', "base may not use geo"),
    ("common/risk/planted.cpp", '#include "global_planning/global_planner.hpp"\n', "risk may not use global_planning"),
    ("common/local_planning/planted.cpp", '#include "bus/planted.hpp"\n', "local_planning may not use bus"),
    ("common/verification/planted.cpp", '#include "local_planning/local_planner.hpp"\n',
     "verification may not use local_planning"),
    ("common/planning/planted.cpp", "#include <lcm/lcm-cpp.hpp>\n", "planning may not use lcm/lcm-cpp.hpp"),
    ("common/bus/planted.cpp", '#include "hedgehop/route_t.hpp"\n', "bus may not use hedgehop/route_t.hpp"),
    ("common/local_planning/planted.cpp", "#include <ompl/base/Planner.h>\n", "local_planning may not use ompl/"),
    ("common/global_planning/global_planner.hpp", "#include <ompl/base/Planner.h>\n", "hide it in a .cpp file"),
    ("common/base/config_reader.hpp", "  #  include <yaml-cpp/yaml.h>\n", "hide it in a .cpp file"),
    ("common/risk/planted.cpp", "#include <chrono>\n", "only the edges read a clock"),
    ("common/risk/planted.cpp", "#include <iostream>\n", "libraries do not talk"),
    ("common/risk/planted.cpp", "#include <base/time.hpp>\n", "our own headers stand in quotes"),
    ("common/risk/planted.cpp", '#include "base/unlisted.hpp"\n', "no public header of base"),
    ("common/risk/planted.cpp", '#include "elsewhere.hpp"\n', "not in the same folder"),
    ("common/risk/planted.cpp", "double f(double x) { return std::sin(x); }\n", "use hedgehop::elementary"),
    ("common/risk/planted.cpp", "double f(double x) { return 2.0 * atan2(x, 1.0); }\n", "use hedgehop::elementary"),
    ("common/map/planted.cpp", 'const char* f() { return std::getenv("HOME"); }\n', "read at the edges only"),
    ("common/global_planning/planted.cpp", "std::random_device device;\n", "seeds come with the request"),
    ("common/base/errors.cpp", "#include <vector>\n#include \"base/errors.hpp\"\n", 'begin with "base/errors.hpp"'),
    ("common/new_room/planted.cpp", "\n", "a room that scripts/check_layers.py does not know"),
    ("cli/planted.cpp", "#include <lcm/lcm-cpp.hpp>\n", "cli may not use lcm/lcm-cpp.hpp"),
    ("cli/planted.cpp", '#include "hedgehop/route_t.hpp"\n', "cli may not use hedgehop/route_t.hpp"),
    ("python/planted.cpp", "#include <lcm/lcm-cpp.hpp>\n", "python may not use lcm/lcm-cpp.hpp"),
    ("services/one/planted.cpp", '#include "evaluation/planted.hpp"\n', "services may not use evaluation"),
    ("services/one/planted.cpp", '#include "two/two_service.hpp"\n', "a service never includes another one"),
    ("services/one/planted.cpp", '#include "services/two/two_service.hpp"\n', "a service never includes another one"),
]
# What must not be found.
GOOD = [
    ("common/risk/planted.cpp", "double f(double x) { return elementary::sin(x) + hedgehop::elementary::exp(x); }\n"),
    ("common/risk/planted.cpp", "double f(double x) { return std::sqrt(x) + asin_table(x) + route.log(x); }\n"),
    ("common/risk/planted.cpp", "// #include <lcm/lcm-cpp.hpp>\n/*\n#include <lcm/lcm-cpp.hpp>\n*/\n#include <vector>\n"),
    ("common/global_planning/planted.cpp", '#include <ompl/base/Planner.h>\n#include "base/errors.hpp"\n'),
    ("common/messages/planted.cpp", '#include "hedgehop/route_t.hpp"\n'),
    ("common/risk/planted.cpp", "double f(double x) { return std::sin(x); }  // layers: shown to a person only\n"),
]


def self_test(root):
    failures = 0
    with tempfile.TemporaryDirectory() as scratch:
        for index, (name, text, wanted) in enumerate(FAULTS + [(n, t, None) for n, t in GOOD]):
            copy = pathlib.Path(scratch) / str(index)
            for room in ROOMS:
                target = copy / "common" / room
                target.mkdir(parents=True)
                recipe = root / "common" / room / "CMakeLists.txt"
                if recipe.exists():
                    shutil.copy(recipe, target)
            for folder in ("services/one", "services/two", "cli", "python"):
                (copy / folder).mkdir(parents=True)
            (copy / "services/two/two_service.hpp").write_text("\n")
            planted = copy / name
            planted.parent.mkdir(parents=True, exist_ok=True)
            planted.write_text(text)
            findings = Check(copy).run()
            if wanted is None and findings:
                failures += 1
                print(f"self-test: {name}: found in right code: {findings}")
            elif wanted is not None and not (len(findings) == 1 and wanted in findings[0] and name.split('/')[1] in findings[0]):
                failures += 1
                print(f"self-test: {name} with {text.strip()!r}: wanted one finding '{wanted}', got {findings}")
    print(f"check_layers self-test: {len(FAULTS)} planted faults, {len(GOOD)} right files, {failures} failures")
    return failures


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parent.parent)
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("--table", action="store_true")
    arguments = parser.parse_args()
    if arguments.table:
        for room, (used, in_headers, in_sources) in ROOMS.items():
            print(f"{room}: {', '.join(sorted(closure(used))) or '-'}; in headers: {', '.join(in_headers) or '-'}; "
                  f"in sources: {', '.join(in_sources) or '-'}")
        return 0
    root = arguments.root.resolve()
    if arguments.self_test:
        return 1 if self_test(root) else 0
    check = Check(root)
    for finding in check.run():
        print(finding)
    print(f"check_layers: {check.files} files, {check.includes} includes, {len(check.findings)} findings")
    return 1 if check.findings else 0


if __name__ == "__main__":
    sys.exit(main())
