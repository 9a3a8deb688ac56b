"""The scripts that people and continuous integration run: help, refusal of nonsense, honest sums."""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "scripts"


def is_command(path):
    return path.is_file() and os.access(path, os.X_OK)


def run(*command, **options):
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=60, **options)


JUNIT = """<?xml version="1.0" encoding="UTF-8"?>
<testsuite name="s" tests="9" failures="2" disabled="1" skipped="5">
<testcase name="good" time="0.1" status="run"><system-out>fine \x1b[0m</system-out></testcase>
<testcase name="bad" time="0.1" status="fail"><failure message=""/><system-out>seed 7
a.cpp:3: Failure</system-out></testcase>
<testcase name="gone" time="0" status="notrun"><skipped message="Unable to find executable"/></testcase>
<testcase name="gtest_skip" time="0" status="notrun"><skipped message="SKIP_REGULAR_EXPRESSION_MATCHED"/>
<system-out>[ RUN      ] A.b
a.cpp:4: Skipped
no multicast
route here

[  SKIPPED ] A.b (0 ms)
</system-out></testcase>
<testcase name="fails_and_skips" time="0" status="notrun"><skipped message="SKIP_REGULAR_EXPRESSION_MATCHED"/>
<system-out>a.cpp:4: Skipped
why
[  SKIPPED ] A.c
[  FAILED  ] A.c
</system-out></testcase>
<testcase name="code_skip" time="0" status="notrun"><skipped message="SKIP_RETURN_CODE=77"/>
<system-out>skipped: not root
</system-out></testcase>
<testcase name="off" time="0" status="disabled"><system-out>Disabled</system-out></testcase>
</testsuite>
"""


class Scripts(unittest.TestCase):
    def test_each_script_explains_itself(self):
        for script in sorted(filter(is_command, SCRIPTS.iterdir())):
            with self.subTest(script=script.name):
                result = run(script, "--help", cwd="/")
                self.assertEqual(result.returncode, 0, result.stderr)
                self.assertIn("scripts/" + script.name, result.stdout)
                self.assertGreaterEqual(len(result.stdout.splitlines()), 2)

    def test_each_script_that_takes_options_refuses_an_unknown_one(self):
        for name in ("bench", "check_layers.py", "format", "fuzz", "packages", "setup", "test", "tidy", "tsan"):
            with self.subTest(script=name):
                result = run(SCRIPTS / name, "--nonsense", cwd="/")
                self.assertEqual(result.returncode, 2, result.stdout + result.stderr)
                self.assertIn("--nonsense", result.stderr)

    def test_each_shell_script_parses_and_stops_at_the_first_error(self):
        for script in sorted(filter(is_command, SCRIPTS.iterdir())):
            if script.read_text().startswith("#!/usr/bin/env bash"):
                with self.subTest(script=script.name):
                    self.assertEqual(run("bash", "-n", script).returncode, 0)
                    self.assertIn("\nset -euo pipefail\n", script.read_text())


class Summary(unittest.TestCase):
    def sum_up(self, steps, **junit):
        with tempfile.TemporaryDirectory() as folder:
            pathlib.Path(folder, "steps").write_text(steps)
            for preset, text in junit.items():
                pathlib.Path(folder, preset + ".xml").write_text(text)
            return run(sys.executable, SCRIPTS / "test_summary.py", folder)

    def test_counts_what_passed_failed_and_was_skipped_and_gives_the_reasons(self):
        result = self.sum_up("passed format\nfailed layers\n", release=JUNIT)
        lines = result.stdout.splitlines()
        # passed: format, good; failed: layers, bad, gone, fails_and_skips; skipped: the other three
        self.assertEqual(lines[-1], "2 passed, 4 failed, 3 skipped")
        self.assertEqual(result.returncode, 1)
        self.assertIn("skipped, because no multicast route here:", lines)
        self.assertIn("skipped, because not root:", lines)
        self.assertIn("  step layers", lines)
        self.assertIn("  fails_and_skips (release): SKIP_REGULAR_EXPRESSION_MATCHED", lines)
        at = lines.index("bad (release) printed:")
        self.assertEqual(lines[at + 1:at + 3], ["  | seed 7", "  | a.cpp:3: Failure"])
        self.assertNotIn("  | fine ?[0m", lines)

    def test_is_green_only_if_something_ran_and_nothing_failed(self):
        good = '<testsuite><testcase name="good" time="0.1" status="run"/></testsuite>'
        result = self.sum_up("passed format\n", release=good, asan=good)
        self.assertEqual((result.returncode, result.stdout.splitlines()[-1]), (0, "3 passed, 0 failed, 0 skipped"))
        self.assertEqual(self.sum_up("passed format\n").returncode, 1)


if __name__ == "__main__":
    unittest.main()
