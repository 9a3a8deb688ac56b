#!/usr/bin/env python3
"""The documentation as a reader tries it: every command in it is run, every link leads somewhere, every message that
is explained exists.

  docs_test.py --build FOLDER PAGE     run the commands of a page, in order, in a folder of its own
  docs_test.py --check                 links, labels of blocks, quoted messages

Blocks of commands are fenced as `sh`; a block fenced as `text` after it is what they say on stdout: `*` stands for
anything in a line, a line `...` for any lines. A comment before a block says how it is treated:
  <!-- build -->           builds or fetches the program; the test takes the build that it is given
  <!-- output -->          what follows is the output of such a block
  <!-- bus -->             needs a network for multicast; left out where there is none
  <!-- exit code any -->   what the commands return does not matter
  <!-- not run: reason --> cannot be run here
A comment at the top of a page, <!-- needs: map plan ... -->, names what a reader has by then.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "cli"))
sys.dont_write_bytecode = True
PAGES = ["README.md", "CONTRIBUTING.md", *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md"))]
# Written by scripts that run the commands on them: scripts/gallery, scripts/local_figures,
# scripts/reproduce_paper.
MADE_BY_SCRIPTS = ["docs/gallery/README.md", "docs/local_figures/README.md", "docs/results.md"]
COMMAND = re.compile(r"^(\$ |\w+\$ )?(\./)?(scripts/\w|hedgehop(-[a-z-]+)? |cmake |ctest |git clone|lcm-\w+ |export |build/)")
LABELS = re.compile(r"^<!-- (build|output|bus|exit code any|not run: .{15,}) -->$")


class Failure(Exception):
    pass


class Block:
    def __init__(self, page, line, language, label, lines):
        self.page, self.line, self.language, self.label, self.lines = page, line, language, label, lines

    def __str__(self):
        return f"{self.page}:{self.line}"


def blocks_of(page):
    """Fenced blocks with their labels; indented ones too, which must hold no commands."""
    found, lines = [], (ROOT / page).read_text(encoding="utf-8").splitlines()
    number, label = 0, ""
    while number < len(lines):
        line = lines[number]
        if line.startswith("```"):
            end = lines.index("```", number + 1)
            found.append(Block(page, number + 1, line[3:].strip(), label, lines[number + 1:end]))
            number, label = end + 1, ""
            continue
        if line.startswith("    ") and not lines[number - 1].lstrip().startswith(("-", "*")):
            found.append(Block(page, number + 1, "indented", label, [line[4:]]))
        if line.startswith("<!-- "):
            label = line
        elif line.strip():
            label = ""
        number += 1
    return found


def expect_output(block, wanted, said):
    lines = said.splitlines()
    at, is_free = 0, False
    for line in wanted:
        if line.strip() == "...":
            is_free = True
            continue
        pattern = re.compile(".*".join(re.escape(part) for part in re.sub(r" +", " ", line.rstrip()).split("*")))
        while True:
            if at >= len(lines):
                raise Failure(f"{block}: the output lacks '{line}'\n--- it was\n{said}")
            is_there = pattern.fullmatch(re.sub(r" +", " ", lines[at].rstrip())) is not None
            at += 1
            if is_there:
                break
            if not is_free:
                raise Failure(f"{block}: the output has '{lines[at - 1]}' where the page says '{line}'\n--- it was\n{said}")
        is_free = False


class Reader:
    """Somebody who follows a page."""

    def __init__(self, build, work):
        self.build, self.work = build, work
        self.network = [str(ROOT / "scripts" / "in-own-network")]
        probe = subprocess.run([*self.network, "true"], capture_output=True, text=True)
        self.why_no_network = probe.stdout.strip().removeprefix("SKIPPED: ") if probe.returncode == 77 else ""
        if self.why_no_network:
            self.network = []
        self.environment = {key: value for key, value in os.environ.items() if not key.startswith(("LCM_", "HEDGEHOP_"))}
        self.environment["PATH"] = f"{build}:{self.environment['PATH']}"
        self.environment["REPOSITORY"] = str(ROOT)

    def shell(self, text, cwd, needs_network=False):
        command = [*(self.network if needs_network else []), "bash", "-euo", "pipefail", "-c", text]
        return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=self.environment, timeout=280)

    def must(self, *words, cwd=None):
        result = subprocess.run([str(word) for word in words], capture_output=True, text=True, cwd=cwd or self.work, env=self.environment)
        if result.returncode not in (0, 4):
            raise Failure(f"{' '.join(map(str, words))}: exit code {result.returncode}\n{result.stderr}")

    def provide(self, page, needs):
        """What a reader of the page has already: files of his own, what earlier pages made, the build."""
        import synthetic_inputs as inputs
        for name in ("docs", "scripts", "config", "examples"):
            (self.work / name).symlink_to(ROOT / name)
        (self.work / "build").mkdir()
        (self.work / "build" / "release").symlink_to(self.build)
        hgt = self.work / "N49E011.hgt"
        if needs & {"hgt", "dem", "map", "plan", "log"}:
            inputs.write_hgt(hgt)
            inputs.zip_of(self.work / "N49E011.hgt.zip", hgt)
            inputs.write_osm(self.work / "area.osm", inputs.land_use())
        if "dem" in needs:
            self.must("gdal_translate", "-q", "-projwin", "11.2", "49.8", "11.8", "49.3", hgt, self.work / "dem.tif")
        if needs & {"map", "plan", "log"}:
            self.must("hedgehop", "prepare", "--dem", hgt, "--osm", self.work / "area.osm", "--bbox", "11.40,49.90,11.60,50.00",
                      "--cell-m", "60", "--out", self.work / "map")
        if "plan" in needs:
            self.must("hedgehop", "plan", "--map", "map", "--start", "49.92,11.43", "--goal", "49.98,11.57", "--out", "plan")
        if "demo" in needs or "log" in needs:
            if self.why_no_network:
                print(f"skipped: the page needs the log of the demo, which needs a network of its own: {self.why_no_network}")
                sys.exit(77)
            self.must(*self.network, "hedgehop", "demo", "--out", "demo", "-q")
            if "log" in needs:
                shutil.copy(self.work / "demo" / "flight.lcmlog", self.work / "flight.lcmlog")

    def follow(self, page):
        text = (ROOT / page).read_text(encoding="utf-8")
        match = re.search(r"<!-- needs: ([a-z ]+) -->", text)
        self.provide(page, set(match.group(1).split()) if match else set())
        cwd, said, count, left_out = self.work, "", 0, []
        blocks = [block for block in blocks_of(page) if block.language in ("sh", "text")]
        for block in blocks:
            if block.language == "text":
                if said is not None:
                    expect_output(block, block.lines, said)
                continue
            if "not run" in block.label:
                said = None
                continue
            commands = "\n".join(block.lines)
            if "build" in block.label:
                said = self.instead_of_building(commands)
                clone = self.work / "hedgehop"
                cwd = clone if clone.is_dir() else cwd
                count += 1
                continue
            is_bus = "bus" in block.label
            if is_bus and self.why_no_network:
                left_out.append(f"{block}: {self.why_no_network}")
                said = None
                continue
            result = self.shell(commands, cwd, is_bus)
            if result.returncode != 0 and "exit code any" not in block.label:
                raise Failure(f"{block}: exit code {result.returncode}\n{commands}\n--- stdout\n{result.stdout}\n--- stderr\n{result.stderr}")
            said = result.stdout
            count += 1
        print(f"{page}: {count} blocks of commands run" + "".join(f"\nleft out: {line}" for line in left_out))

    def instead_of_building(self, commands):
        """The same as a reader has after it, from the build at hand. A clone is a real one."""
        if "git clone" in commands:
            self.must("git", "clone", "-q", ROOT, self.work / "hedgehop")
            (self.work / "hedgehop" / "build").mkdir()
            (self.work / "hedgehop" / "build" / "release").symlink_to(self.build)
            for file in ("dem.tif", "area.osm"):
                shutil.copy(self.work / file, self.work / "hedgehop")
        if "scripts/demo" in commands:
            if self.why_no_network:
                print(f"skipped: the demo needs a network of its own: {self.why_no_network}")
                sys.exit(77)
            result = self.shell("hedgehop demo", self.work, True)
            if result.returncode != 0:
                raise Failure(f"hedgehop demo: exit code {result.returncode}\n{result.stderr}")
            return result.stdout
        return None


def anchors_of(path):
    found = set()
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            words = re.sub(r"[^\w\- ]", "", line.lstrip("#").strip().lower())
            found.add(words.replace(" ", "-"))
    return found


def literals():
    """All that the program can say: adjacent string literals are one, as the compiler sees them."""
    texts = []
    for folder in ("common", "cli", "services", "scripts"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".cpp", ".hpp"):
                source = path.read_text(encoding="utf-8")
                for group in re.finditer(r'"(?:[^"\\\n]|\\.)*"(?:\s*"(?:[^"\\\n]|\\.)*")*', source):
                    texts.append("".join(re.findall(r'"((?:[^"\\\n]|\\.)*)"', group.group())))
    return "\0".join(texts)


def sources():
    return "".join(path.read_text(encoding="utf-8") for folder in ("common", "cli", "services")
                   for path in sorted((ROOT / folder).rglob("*.cpp")))


def check():
    problems = []
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        for block in blocks_of(page):
            commands = [line for line in block.lines if COMMAND.match(line)]
            if commands and page not in MADE_BY_SCRIPTS and block.language not in ("sh", "text") and "output" not in block.label:
                problems.append(f"{block}: '{commands[0]}' is a command, but its block is not fenced as sh, so nobody runs it")
            if block.label and not LABELS.match(block.label) and "needs:" not in block.label:
                problems.append(f"{block}: nobody knows the label {block.label}")
        plain = re.sub(r"(?ms)^```.*?^```", "", text)
        for target in re.findall(r"\]\(([^)\s]+)\)", plain):
            if re.match(r"[a-z]+:", target):
                continue
            file, _, anchor = target.partition("#")
            path = (ROOT / page).parent / file if file else ROOT / page
            if not path.exists() and not any((ROOT / made).resolve() == path.resolve() for made in MADE_BY_SCRIPTS):
                problems.append(f"{page}: the link {target} leads nowhere")
            elif anchor and path.exists() and anchor not in anchors_of(path):
                problems.append(f"{page}: {target}: there is no such heading")
    said = literals()
    quoted = re.findall(r"(?m)^- `([^`]+)`", (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8"))
    if len(quoted) < 20:
        problems.append(f"docs/troubleshooting.md quotes only {len(quoted)} messages")
    for message in quoted:
        parts = [part.strip() for part in message.split("*") if len(part.strip()) >= 4]
        for part in parts or [message]:
            if part not in said:
                problems.append(f"docs/troubleshooting.md: no part of the program says '{part}'")
    # docs/json.md names every schema; groups of like ones are named by one of them.
    page = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    alike = {"hedgehop replay", "hedgehop serve", "hedgehop doctor", "hedgehop demo", "hedgehop timings"}
    for schema in sorted(set(re.findall(r'"schema"(?:, |\] = )"(hedgehop [a-z0-9 -]+)"', sources()))):
        if f"`{schema}`" not in page and schema not in alike and not schema.startswith("hedgehop evaluate "):
            problems.append(f"docs/json.md does not name the schema '{schema}'")
    for problem in problems:
        print(problem)
    print(f"{len(PAGES)} pages, {len(quoted)} messages, {len(problems)} problems")
    return 1 if problems else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("page", nargs="?")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(page for page in PAGES if page not in MADE_BY_SCRIPTS and any(block.language == "sh" and "not run" not in block.label for block in blocks_of(page))))
        return 0
    if arguments.check:
        return check()
    with tempfile.TemporaryDirectory() as work:
        try:
            Reader(arguments.build.resolve(), pathlib.Path(work)).follow(arguments.page)
        except Failure as failure:
            print(failure)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
