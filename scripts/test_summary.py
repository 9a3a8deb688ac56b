#!/usr/bin/env python3
"""Sums up what scripts/test left in a folder: failures, skipped tests with their reasons, counts.

  scripts/test_summary.py FOLDER   FOLDER holds `steps` (lines "passed name" or "failed name") and one
                                   JUnit file of ctest a preset (release.xml, asan.xml)
The ends of what failed tests printed stand before the list of their names, so that a seed or a bound is not lost. The last line
is "N passed, N failed, N skipped". Exit code 1 if anything failed or nothing ran.
"""

import pathlib
import re
import sys
import xml.etree.ElementTree

LINES_OF_A_FAILURE = 30
SKIPPED_BY = ("SKIP_REGULAR_EXPRESSION_MATCHED", "SKIP_RETURN_CODE")


def reason(output):
    """Why a test was skipped, in its own words."""
    match = re.search(r": Skipped\n(.*?)\n*\[  SKIPPED \]", output, re.S)
    if match and match.group(1).strip():
        return " ".join(match.group(1).split())
    match = re.search(r"^skipped: (.*)$", output, re.M | re.I)
    return match.group(1).strip() if match else "the test gives no reason"


def cases(path):
    """(name, 'passed' | 'failed' | 'skipped', reason, seconds, output) for each test case of a JUnit file."""
    text = path.read_bytes().decode("utf-8", "replace")
    # ctest writes control characters of a test's output as they are; XML does not allow them
    text = re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]", "?", text)
    for case in xml.etree.ElementTree.fromstring(text).iter("testcase"):
        status = case.get("status")
        seconds = float(case.get("time") or 0.0)
        output = case.findtext("system-out") or ""
        skipped = case.find("skipped")
        message = (skipped.get("message") or "") if skipped is not None else ""
        if status == "run":
            yield case.get("name"), "passed", "", seconds, output
        elif status == "disabled":
            yield case.get("name"), "skipped", "disabled in the source", seconds, output
        elif message.startswith(SKIPPED_BY) and "[  FAILED  ]" not in output:
            yield case.get("name"), "skipped", reason(output), seconds, output
        else:
            yield case.get("name"), "failed", message, seconds, output


def main():
    if len(sys.argv) != 2 or sys.argv[1] in ("-h", "--help"):
        print(__doc__)
        return 0 if len(sys.argv) == 2 else 2
    folder = pathlib.Path(sys.argv[1])
    count = {"passed": 0, "failed": 0, "skipped": 0}
    failed, outputs, skipped, times = [], [], {}, []
    steps = folder / "steps"
    for line in steps.read_text().splitlines() if steps.exists() else []:
        result, name = line.split(maxsplit=1)
        count[result] += 1
        if result == "failed":
            failed.append(f"step {name}")
    for path in sorted(folder.glob("*.xml")):
        preset = path.stem
        own = {"passed": 0, "failed": 0, "skipped": 0}
        for name, result, why, seconds, output in cases(path):
            own[result] += 1
            times.append((seconds, f"{name} ({preset})"))
            if result == "failed":
                failed.append(f"{name} ({preset}){': ' + why if why else ''}")
                outputs.append((f"{name} ({preset})", output.splitlines()[-LINES_OF_A_FAILURE:]))
            elif result == "skipped":
                skipped.setdefault(why, []).append(f"{name} ({preset})")
        print(f"{preset}: " + ", ".join(f"{number} {word}" for word, number in own.items()))
        for word, number in own.items():
            count[word] += number
    if times:
        print("slowest:")
        for seconds, name in sorted(times, reverse=True)[:5]:
            print(f"  {seconds:6.1f} s  {name}")
    for why, names in sorted(skipped.items()):
        print(f"skipped, because {why}:")
        for name in sorted(names):
            print(f"  {name}")
    for name, lines in outputs:
        print(f"{name} printed:")
        for line in lines:
            print(f"  | {line}")
    if failed:
        print("failed:")
        for name in failed:
            print(f"  {name}")
    print(f"{count['passed']} passed, {count['failed']} failed, {count['skipped']} skipped")
    return 1 if count["failed"] or not times else 0


if __name__ == "__main__":
    sys.exit(main())
