#!/usr/bin/env python3
"""What is installed and packed: an outside project, units, packages.

  packages_test.py --list                                          names of the tests
  packages_test.py --build DIR --source DIR --map-maker PROGRAM NAME...   runs these (all)

A test that cannot run here exits with 77 and a line "skipped: reason".
"""

import argparse
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import unittest

import units_in_chroot

SOURCE = BUILD = MAP_MAKER = None
OUTSIDE = pathlib.Path(__file__).resolve().parent / "outside"
SERVICES = ["map-tiler", "global-planner", "local-planner", "command-model", "flight-logger"]
# No sanitizer, no cache of a user: what an outsider has.
PLAIN = {**os.environ, "CXXFLAGS": "", "LDFLAGS": ""}


def run(*command, **options):
    options = {"capture_output": True, "text": True, "timeout": 200, **options}
    return subprocess.run([str(word) for word in command], **options)


class PackagesTest(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory(prefix="hedgehop_packages_")
        self.addCleanup(scratch.cleanup)
        self.scratch = pathlib.Path(scratch.name)

    def good(self, *command, **options):
        result = run(*command, **options)
        self.assertEqual(result.returncode, 0, f"{command}\n{result.stdout}\n{result.stderr}")
        return result.stdout

    def install(self, *components):
        # The folder moves after the installation: nothing may hold its first name.
        first, prefix = self.scratch / "first", self.scratch / "prefix"
        for component in components:
            self.good("cmake", "--install", BUILD, "--prefix", first, "--component", component)
        first.rename(prefix)
        return prefix

    def need(self, *tools):
        for tool in tools:
            if shutil.which(tool) is None:
                self.skipTest(f"{tool} is not installed")

    def test_an_outside_project_plans_as_the_program_does_and_is_heard(self):
        if "sanitize" in (BUILD / "build.ninja").read_text():
            self.skipTest("libraries with sanitizers do not link without them")
        prefix = self.install("development", "types")
        target = self.scratch / "target"
        environment = {**PLAIN, "CMAKE_PREFIX_PATH": str(prefix),
                       "PKG_CONFIG_PATH": f"{prefix}/lib/pkgconfig:{prefix}/share/pkgconfig"}
        # By hand and pkg-config, while CMake builds the same.
        by_hand = subprocess.Popen(
            ["sh", "-c", f"g++ {OUTSIDE}/plan_and_publish.cpp -O0 -o {self.scratch}/by_hand "
             "$(pkg-config --cflags --libs hedgehop) && "
             f"g++ {OUTSIDE}/types_only.cpp -o {self.scratch}/types_by_hand "
             "$(pkg-config --cflags --libs hedgehop-types)"],
            env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            self.good("cmake", "-G", "Ninja", "-S", OUTSIDE, "-B", target, "-D", "CMAKE_BUILD_TYPE=Debug",
                      env=environment)
            self.good("cmake", "--build", target, env=environment)
        finally:
            said, _ = by_hand.communicate(timeout=200)
        self.assertEqual(by_hand.returncode, 0, said)

        ends = self.good(MAP_MAKER, self.scratch / "map").split()
        places = [number for end in ends for number in end.split(",")]
        reference = self.scratch / "reference"
        self.good(BUILD / "hedgehop", "plan", "--map", self.scratch / "map", "--start", ends[0], "--goal", ends[1],
                  "--work", 20000, "--out", reference)
        for name, program in (("cmake", target / "plan_and_publish"), ("pkg-config", self.scratch / "by_hand")):
            with self.subTest(name=name):
                out = self.scratch / f"plan_{name}"
                said = self.good(program, self.scratch / "map", *places, 20000, out)
                self.assertRegex(said, r"^heard [0-9a-f]{32}\n$")
                for file in ("plan.json", "route.geojson", "trajectory.csv"):
                    self.assertEqual((out / file).read_bytes(), (reference / file).read_bytes(), file)
        for program in (target / "types_only", self.scratch / "types_by_hand"):
            self.assertEqual(self.good(program), "heard 1234567 42\n")

    def test_every_public_header_and_every_type_is_installed(self):
        prefix = self.install("development", "types")
        installed = {str(path.relative_to(prefix / "include/hedgehop"))
                     for path in (prefix / "include/hedgehop").rglob("*.hpp")}
        recipes = list((SOURCE / "common").glob("*/CMakeLists.txt"))
        self.assertGreater(len(recipes), 15)
        for recipe in recipes:
            listed = re.search(r"HEADERS(.*?)(?=DEPENDS|PRIVATE_DEPENDS|\))", recipe.read_text(), re.S).group(1).split()
            for header in listed:
                self.assertIn(f"{recipe.parent.name}/{header}", installed)
            self.assertTrue((prefix / f"lib/libhedgehop_{recipe.parent.name}.a").is_file())
        for header in sorted(installed):
            text = (prefix / "include/hedgehop" / header).read_text()
            for included in re.findall(r'(?m)^#include "(?:hedgehop/)?([^"]+)"', text):
                self.assertIn(included, installed, f"{header} includes what is not installed")
        for file in (SOURCE / "lcmtypes").glob("*.lcm"):
            self.assertIn(f"{file.stem}.hpp", installed)
            self.assertTrue((prefix / "share/lcm/hedgehop" / file.name).is_file())
        for file in prefix.rglob("*.cmake"):
            self.assertNotIn(str(SOURCE), file.read_text(), f"{file} names the source tree")

    def test_the_java_archive_holds_every_type(self):
        self.need("javac", "jar")
        if not pathlib.Path("/usr/share/java/lcm.jar").exists():
            self.skipTest("lcm.jar is not installed")
        jar = self.install("types") / "share/java/hedgehop-types.jar"
        listed = self.good("jar", "tf", jar).split()
        for file in (SOURCE / "lcmtypes").glob("*.lcm"):
            self.assertIn(f"hedgehop/{file.stem}.class", listed)

    def units(self):
        """Units where the programs are found, and their folder."""
        prefix = self.install("tools")
        folder = self.scratch / "units"
        folder.mkdir()
        for unit in (prefix / "lib/systemd/system").iterdir():
            text = unit.read_text()
            (folder / unit.name).write_text(re.sub(r"(?m)^ExecStart=hedgehop", f"ExecStart={prefix}/bin/hedgehop", text))
        return prefix, folder

    def test_units_are_understood_by_systemd_and_closed(self):
        self.need("systemd-analyze")
        _, folder = self.units()
        self.assertEqual(sorted(path.name for path in folder.iterdir()),
                         sorted(["hedgehop@.target"] + [f"hedgehop-{name}@.service" for name in SERVICES]))
        names = []
        for path in list(folder.iterdir()):
            path.rename(folder / path.name)
            instance = folder / path.name.replace("@.", "@alpha.")
            shutil.copy(path, instance)
            names.append(instance)
        result = run("systemd-analyze", "verify", "--man=no", "--recursive-errors=yes", *names,
                     env={**os.environ, "SYSTEMD_UNIT_PATH": f"{folder}:"})
        about_ours = [line for line in result.stderr.splitlines() if "hedgehop" in line]
        self.assertEqual((result.returncode, about_ours), (0, []), result.stderr)
        for name in SERVICES:
            said = run("systemd-analyze", "security", "--offline=true", "--threshold=25", "--no-pager",
                       folder / f"hedgehop-{name}@alpha.service")
            self.assertEqual(said.returncode, 0, f"{name}: {said.stdout[-400:]}{said.stderr}")

    def test_a_misspelt_line_of_a_unit_would_be_found(self):
        self.need("systemd-analyze")
        _, folder = self.units()
        unit = folder / "hedgehop-command-model@alpha.service"
        unit.write_text((folder / "hedgehop-command-model@.service").read_text().replace("MemoryMax", "MemoryMacks"))
        result = run("systemd-analyze", "verify", "--man=no", unit)
        self.assertIn("MemoryMacks", result.stderr)

    def test_services_tell_the_supervisor_that_they_are_ready_alive_and_leaving(self):
        prefix, folder = self.units()
        address = str(self.scratch / "notify")
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.addCleanup(listener.close)
        listener.bind(address)
        self.good(MAP_MAKER, self.scratch / "map")
        logs = self.scratch / "logs"
        logs.mkdir()
        for name in SERVICES:
            with self.subTest(service=name):
                text = (folder / f"hedgehop-{name}@.service").read_text()
                environment, command = units_in_chroot.setup_of(text)
                environment.update(PATH=f"{prefix}/bin:/usr/sbin:/usr/bin:/sbin:/bin", NOTIFY_SOCKET=address,
                                   STATE_DIRECTORY=str(logs), HEDGEHOP_MAP=str(self.scratch / "map"))
                heard, code, said = units_in_chroot.talk(
                    [SOURCE / "scripts/in-own-network", "sh", "-c", f"exec {command}"], environment, listener)
                if code == 77:
                    self.skipTest(said.strip())
                self.assertEqual(code, 0, said)
                self.assertEqual(heard[0], "READY=1")
                self.assertIn("STOPPING=1", heard)
        self.assertEqual(len(list(logs.glob("2*T*Z.lcmlog"))), 1)

    def test_packages_hold_what_their_names_say(self):
        self.need("cpack", "dpkg-deb", "dpkg-shlibdeps", "strip")
        if "sanitize" in (BUILD / "build.ninja").read_text():
            self.skipTest("nobody packs a build with sanitizers")
        out = self.scratch / "deb"
        # gzip: half the time of xz, which scripts/packages takes
        self.good("cpack", "-G", "DEB", "-B", out, "-D", "CPACK_DEBIAN_COMPRESSION_TYPE=gzip",
                  "-D", "CPACK_THREADS=0", cwd=BUILD)
        packages = {path.name.split("_")[0]: path for path in out.glob("*.deb")}
        wanted = {
            "hedgehop": ["usr/bin/hedgehop", "usr/bin/hedgehop-map-tiler", "usr/lib/systemd/system/hedgehop@.target",
                         "usr/share/man/man1/hedgehop-plan.1.gz", "usr/share/man/man1/hedgehop-local-planner.1.gz",
                         "usr/share/bash-completion/completions/hedgehop", "usr/libexec/hedgehop/net-setup"],
            "libhedgehop-dev": ["usr/include/hedgehop/planning/planning.hpp", "usr/lib/libhedgehop_planning.a",
                                "usr/lib/cmake/Hedgehop/HedgehopConfig.cmake", "usr/lib/pkgconfig/hedgehop.pc"],
            "hedgehop-lcmtypes": ["usr/share/lcm/hedgehop/route_t.lcm", "usr/include/hedgehop/route_t.hpp",
                                  "usr/share/pkgconfig/hedgehop-types.pc"],
            "hedgehop-doc": ["usr/share/doc/hedgehop/README.md", "usr/share/doc/hedgehop/docs/packages.md"],
        }
        if (BUILD / "python/hedgehop").is_dir():
            wanted["python3-hedgehop"] = ["usr/lib/python3/dist-packages/hedgehop/__init__.py",
                                          "usr/lib/python3/dist-packages/hedgehop/messages.py"]
        self.assertEqual(set(wanted), set(packages))
        owner = {}
        for name, path in packages.items():
            listed = [line.split(None, 5)[5] for line in self.good("dpkg-deb", "-c", path).splitlines()]
            files = {entry.removeprefix("./") for entry in listed if not entry.endswith("/")}
            for file in files:
                self.assertNotIn(file, owner, f"in {name} and in {owner.get(file)}")
                owner[file] = name
                self.assertTrue(file.startswith("usr/"), file)
            for file in wanted.get(name, []):
                self.assertIn(file, files, name)
            for file in ("copyright", "changelog.gz"):
                self.assertIn(f"usr/share/doc/{name}/{file}", files)
        control = self.good("dpkg-deb", "-f", packages["hedgehop"])
        for library in ("libgdal", "liblcm1", "libompl", "libtbb", "libopencv-core", "libyaml-cpp", "libc6"):
            self.assertRegex(control, rf"(?m)^Depends:.*\b{library}")


def names():
    return sorted(name for name in dir(PackagesTest) if name.startswith("test_"))


def main():
    global SOURCE, BUILD, MAP_MAKER
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--build", type=pathlib.Path)
    parser.add_argument("--source", type=pathlib.Path)
    parser.add_argument("--map-maker", type=pathlib.Path)
    parser.add_argument("names", nargs="*")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(name.removeprefix("test_") for name in names()))
        return 0
    SOURCE, BUILD, MAP_MAKER = arguments.source, arguments.build, arguments.map_maker
    chosen = [f"test_{name}" for name in arguments.names] or names()
    result = unittest.TextTestRunner(verbosity=2).run(unittest.TestSuite(PackagesTest(name) for name in chosen))
    if result.skipped and len(chosen) == 1:
        print(f"skipped: {result.skipped[0][1]}")
        return 77
    return 0 if result.wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main())
