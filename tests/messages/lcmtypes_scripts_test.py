"""check_lcmtypes.py finds each planted fault; harden_lcmtypes.py stops at what it does not know.

usage: lcmtypes_scripts_test.py RAW_FOLDER     (what lcm-gen wrote)
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
RAW = pathlib.Path(sys.argv.pop(1)) if len(sys.argv) > 1 else None


def run(script, *arguments):
    command = [sys.executable, "-B", str(ROOT / "scripts" / script), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


class Planted(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        shutil.copytree(ROOT / "lcmtypes", self.folder / "lcmtypes")
        (self.folder / "common" / "messages").mkdir(parents=True)
        shutil.copy(ROOT / "common/messages/channels.hpp", self.folder / "common/messages")

    def edit(self, path, old, new):
        file = self.folder / path
        text = file.read_text()
        self.assertIn(old, text)
        file.write_text(text.replace(old, new))

    def expect(self, what):
        result = run("check_lcmtypes.py", self.folder)
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertRegex(result.stderr, what)

    def test_the_project_is_clean(self):
        result = run("check_lcmtypes.py", self.folder)
        self.assertEqual(result.returncode, 0, result.stderr)

    def test_suffix_and_unit_disagree(self):
        self.edit("lcmtypes/waypoint_t.lcm", "double altitude_m;", "double altitude_ft;")
        self.expect(r"waypoint_t\.lcm:\d+: 'altitude_ft' is in \[m\] and must end in _m")

    def test_a_unit_in_the_name_alone(self):
        self.edit("lcmtypes/waypoint_t.lcm", "// [m] Above", "// [-] Above")
        self.expect("'altitude_m' ends in _m, but its comment says that it has no unit")

    def test_a_field_without_comment(self):
        self.edit("lcmtypes/waypoint_t.lcm", "    // [m] [@frame map] Grid east\n", "")
        self.expect("the comment above 'x_m' does not begin with")

    def test_an_unknown_unit(self):
        self.edit("lcmtypes/waypoint_t.lcm", "// [m] Above", "// [ft] Above")
        self.expect(r"unknown unit \[ft\]")

    def test_a_bare_name(self):
        self.edit("lcmtypes/violation_t.lcm", "double found;", "double x;")
        self.expect("'x' says neither frame nor unit")

    def test_a_missing_header_line(self):
        self.edit("lcmtypes/route_t.lcm", "// Loss:       repeated with the request\n", "")
        self.expect("the header line 'Loss:' is missing")

    def test_versions_that_disagree(self):
        self.edit("lcmtypes/route_t.lcm", "VERSION = 1", "VERSION = 2")
        self.expect("VERSION is 2, the header line says 1")

    def test_a_message_without_stamp(self):
        self.edit("lcmtypes/route_t.lcm", "int64_t sender_id;", "int64_t origin;")
        self.expect("must begin with int64_t utime, int64_t sender_id")

    def test_a_count_without_limit(self):
        self.edit("lcmtypes/chunk_request_t.lcm", "MAX_RANGES = 50", "MAX_OTHERS = 50")
        self.expect("'num_ranges' has no constant MAX_RANGES")

    def test_a_message_that_does_not_fit_a_datagram(self):
        self.edit("lcmtypes/chunk_request_t.lcm", "MAX_RANGES = 50", "MAX_RANGES = 500")
        self.expect("must fit 1400")

    def test_two_types_that_nobody_can_tell_apart(self):
        text = (self.folder / "lcmtypes/waypoint_t.lcm").read_text()
        (self.folder / "lcmtypes/place_t.lcm").write_text(text.replace("waypoint_t", "place_t"))
        self.expect("same fingerprint as place_t")

    def test_a_constant_of_no_field(self):
        self.edit("lcmtypes/map_patch_t.lcm", "KIND_AREA", "SORT_AREA")
        self.expect("constant SORT_AREA does not begin with the name of a field")

    def test_a_channel_missing_in_the_readme(self):
        readme = self.folder / "lcmtypes/README.md"
        readme.write_text(re.sub(r"\| `MAP_PATCH`.*\n", "", readme.read_text()))
        self.expect("MAP_PATCH")

    def test_a_channel_with_two_types(self):
        self.edit("common/messages/channels.hpp", '{kRouteChannel.name, "route_t"}', '{kRouteChannel.name, "chunk_t"}')
        self.expect("ROUTE carries chunk_t, the README says route_t")

    def test_a_field_that_is_no_lcm(self):
        self.edit("lcmtypes/waypoint_t.lcm", "double altitude_m;", "double altitude_m[3][3];")
        result = run("check_lcmtypes.py", self.folder)
        self.assertNotEqual(result.returncode, 0)
        self.assertIn("not understood", result.stderr)


@unittest.skipIf(RAW is None, "no folder with the output of lcm-gen")
class Hardening(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        shutil.copytree(RAW, self.folder / "raw")

    def harden(self):
        return run("harden_lcmtypes.py", ROOT / "lcmtypes", self.folder / "raw", self.folder / "out")

    def test_every_allocation_is_guarded(self):
        result = self.harden()
        self.assertEqual(result.returncode, 0, result.stderr)
        guarded = 0
        for file in (self.folder / "out").glob("*_t.hpp"):
            lines = file.read_text().splitlines()
            for above, line in zip(lines, lines[1:]):
                if ".resize(" in line:
                    self.assertIn("maxlen - pos)) return -1;", above, f"{file.name}: {line}")
                    guarded += 1
        self.assertGreaterEqual(guarded, 20)

    def test_an_unknown_line_stops_it(self):
        file = self.folder / "raw/hedgehop/chunk_t.hpp"
        text = file.read_text()
        begin = text.index("int chunk_t::_decodeNoHash(const void *buf, int offset, int maxlen)\n{")
        text = text[:begin] + text[begin:].replace("    return pos;", "    this->piece.reserve(1 << 30);\n    return pos;", 1)
        file.write_text(text)
        result = self.harden()
        self.assertNotEqual(result.returncode, 0)
        self.assertIn("not known", result.stderr)


if __name__ == "__main__":
    unittest.main()
