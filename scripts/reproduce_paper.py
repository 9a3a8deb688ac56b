#!/usr/bin/env python3
"""Measures the paper's tables and what goes beyond them, and writes a page with figures about it.

Every measurement is one run of `hedgehop evaluate`, whose JSON result is kept; a second run of this
script repeats nothing whose command and map are the same. Long ones keep their finished problems too,
so that an interrupted run goes on where it was.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time

import regions as regions_of_maps
import results_page
from regions import ROOT

SEED = "1"


class Measurement:
    """One run of `hedgehop evaluate`: a kind, a map (or none), and arguments."""

    def __init__(self, kind, region=None, arguments=(), keep=None):
        self.kind, self.region, self.arguments, self.keep = kind, region, list(arguments), keep
        self.name = kind if region is None else f"{kind}_{region}"


def measurements(regions, is_small, table3_runs):
    """What is measured, in the order of its running: the long comparisons of table 3 at the end."""
    def runs(full, small):
        return str(small if is_small else full)

    first = regions[0]
    listed = [Measurement("local-speed", None,
                          ["--repeats", runs(15, 1), "--reference-repeats", runs(3, 1),
                           "--length", runs(12000, 2000)])]
    for region in regions:
        varied = ["--parameters", "local.weights.visibility,local.window_m,weights.visibility"] if is_small else []
        listed += [
            Measurement("protection", region, ["--cells", runs(200, 10), "--seed", SEED]),
            Measurement("random", region, ["--problems", runs(20, 3), "--seed", SEED]),
            Measurement("table2", region, ["--runs", runs(100, 6), "--seed", SEED], "--routes"),
            Measurement("local-safety", region, ["--flights", runs(200, 4), "--seed", SEED], "--routes"),
            Measurement("optimality", region,
                        ["--problems", runs(10, 2), "--budgets", "0.5,1" if not is_small else "0.3",
                         "--seed", SEED]),
            Measurement("verifier", region, ["--plans", runs(420, 4), "--seed", SEED]),
            Measurement("sensitivity", region, ["--runs", runs(20, 2), "--seed", SEED, *varied], "--keep"),
        ]
    budget = ["--budget-s", "1"] if is_small else []
    for region in regions:
        table3 = table3_runs if region == first else max(1, table3_runs // 8)
        listed.append(Measurement("table3", region, ["--runs", runs(table3, 3), *budget, "--seed", SEED], "--keep"))
    return listed


def measure(program, work, measurement, regions, version, may_run):
    """The result, kept or new, with the command that gave it; None if it is not kept and nothing may run."""
    shown = ["hedgehop", "evaluate", measurement.kind]
    real = [program, "evaluate", measurement.kind]
    map_hash = None
    if measurement.region:
        folder = regions[measurement.region]
        map_hash = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["map_hash"]
        shown += ["--map", folder.relative_to(work)]
        real += ["--map", folder]
    shown += measurement.arguments
    real += measurement.arguments
    if measurement.keep:
        shown += [measurement.keep, "keep"]
        real += [measurement.keep, work / "keep"]
    command = " ".join(map(str, shown)) + " --json"
    kept = work / "measured" / f"{measurement.name}.json"
    if kept.exists():
        record = json.loads(kept.read_text(encoding="utf-8"))
        if record["command"] == command and record["map_hash"] == map_hash:
            return record
    if not may_run:
        return None
    begun = time.monotonic()
    result = regions_of_maps.run_json([*real, "--json"], work / f"{measurement.name}.log")
    record = {"command": command, "map_hash": map_hash, "version": version,
              "load": os.getloadavg()[0], "seconds": round(time.monotonic() - begun, 1), "result": result}
    kept.parent.mkdir(parents=True, exist_ok=True)
    unfinished = kept.with_suffix(".part")
    unfinished.write_text(json.dumps(record, indent=1), encoding="utf-8")
    unfinished.rename(kept)
    return record


def main():
    parser = argparse.ArgumentParser(prog="scripts/reproduce_paper", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few problems, short budgets, the synthetic region")
    parser.add_argument("--regions", help="with commas between: synthetic,bayreuth,hsinchu (default: those whose "
                                          "files are in --data; --small: synthetic)")
    parser.add_argument("--data", type=pathlib.Path,
                        default=regions_of_maps.DATA,
                        help="folder with the elevation and vector files of the real regions")
    parser.add_argument("--table3-runs", type=int, default=100,
                        help="problems of table 3 on the first region, 81 processor seconds each; an eighth of "
                             "them on each other (default: 100)")
    parser.add_argument("--only", help="kinds to measure, with commas between, table3 for example; "
                                       "others are taken as they were kept")
    parser.add_argument("--page-only", action="store_true", help="measure nothing, write the page of what is kept")
    parser.add_argument("--work", type=pathlib.Path, help="what is kept (default: build/results or build/results_small)")
    parser.add_argument("--out", type=pathlib.Path, help="the page (default: docs/results.md; --small: results.md in --work)")
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "build/release/hedgehop", help=argparse.SUPPRESS)
    arguments = parser.parse_args()

    work = (arguments.work or ROOT / "build" / ("results_small" if arguments.small else "results")).resolve()
    work.mkdir(parents=True, exist_ok=True)
    page = (arguments.out or (work / "results.md" if arguments.small else ROOT / "docs/results.md")).resolve()
    asked = (arguments.regions or ("synthetic" if arguments.small else "synthetic,bayreuth,hsinchu")).split(",")
    for name in asked:
        if name not in regions_of_maps.NAMES:
            parser.error(f"no region is called '{name}'")
    program = arguments.program.resolve()
    version = subprocess.run(["git", "-C", ROOT, "describe", "--always", "--dirty"], capture_output=True, text=True,
                             check=False).stdout.strip() or "unknown"
    only = arguments.only.split(",") if arguments.only else None

    regions, commands, absent = regions_of_maps.prepare(program, work, arguments.data.resolve(), asked)
    for name, why in absent.items():
        print(f"reproduce_paper: without the region {name}: {why} (--data)", file=sys.stderr)
    todo = measurements(list(regions), arguments.small, arguments.table3_runs)
    records, begun = {}, time.monotonic()
    for at, measurement in enumerate(todo):
        may_run = not arguments.page_only and (not only or measurement.kind in only)
        done = 100 * at // len(todo)
        elapsed = (time.monotonic() - begun) / 60
        print(f"reproduce_paper: [{'#' * (done // 5):<20}] {at} of {len(todo)}, {elapsed:.0f} min: {measurement.name}",
              file=sys.stderr)
        if record := measure(program, work, measurement, regions, version, may_run):
            records[measurement.name] = record
    unmeasured = [measurement.name for measurement in todo if measurement.name not in records]
    results_page.write(page, records, commands, absent, unmeasured, is_small=arguments.small)
    print(f"reproduce_paper: {page}", file=sys.stderr)


if __name__ == "__main__":
    main()
