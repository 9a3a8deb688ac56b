#!/usr/bin/env python3
"""The command line from outside: what it says and leaves behind when its input is bad, the disk is full
or the user stops it; its help; its JSON.

  cli_test.py --hedgehop PROGRAM --inputs FOLDER [TEST...]   run these tests (all)
  cli_test.py --list                                         names of the tests
  cli_test.py --hedgehop PROGRAM --inputs FOLDER --make-inputs
                                                             write the inputs that the tests share
A single test that cannot run here exits with 77 and a line "skipped: reason".
"""

import argparse
import json
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import mcap_reader
import synthetic_inputs as inputs

ROOT = pathlib.Path(__file__).resolve().parents[2]
HEDGEHOP = None
INPUTS = None
BBOX = ",".join(str(number) for number in inputs.BBOX)
CELL_M = "60"
START = "%g,%g" % inputs.START
GOAL = "%g,%g" % inputs.GOAL
WORK = "60000"


def make_inputs(folder):
    """All that several tests read; made once for a run."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    hgt = folder / "N49E011.hgt"
    inputs.write_hgt(hgt)
    inputs.zip_of(folder / "N49E011.hgt.zip", hgt)
    inputs.write_osm(folder / "land_use.osm", inputs.land_use())
    run_checked(["prepare", "--dem", hgt, "--osm", folder / "land_use.osm", "--bbox", BBOX, "--cell-m", CELL_M,
                 "--out", folder / "map"])
    run_checked(["plan", "--map", folder / "map", "--start", START, "--goal", GOAL, "--work", WORK,
                 "--out", folder / "plan"], allowed=(0, 4))


def run_checked(arguments, allowed=(0,)):
    result = subprocess.run([HEDGEHOP, *map(str, arguments)], capture_output=True, text=True, timeout=100)
    if result.returncode not in allowed:
        sys.exit(f"hedgehop {' '.join(map(str, arguments))}: exit code {result.returncode}\n{result.stderr}")


def listing(folder):
    """Every path below a folder with its size, hidden ones too."""
    return sorted((str(path.relative_to(folder)), path.stat().st_size if path.is_file() else -1)
                  for path in folder.rglob("*"))


class CliTest(unittest.TestCase):
    def setUp(self):
        self.scratch = tempfile.TemporaryDirectory(prefix="hedgehop_cli_")
        self.addCleanup(self.scratch.cleanup)
        base = pathlib.Path(self.scratch.name)
        self.work = base / "work"  # where output goes
        self.temporary = base / "temporary"  # TMPDIR of the program
        self.work.mkdir()
        self.temporary.mkdir()
        self.hgt = INPUTS / "N49E011.hgt"
        self.osm = INPUTS / "land_use.osm"
        self.map = INPUTS / "map"
        self.plan = INPUTS / "plan"

    def environment(self):
        return {**os.environ, "TMPDIR": str(self.temporary)}

    def hedgehop(self, *arguments, timeout=100, **options):
        return subprocess.run([HEDGEHOP, *map(str, arguments)], capture_output=True, text=True, timeout=timeout,
                              env=self.environment(), cwd=self.work, **options)

    def assert_refused(self, arguments, code, mentions, advice=r"\w"):
        """Refused with the code; stderr says what and where (mentions), and what to do (advice).

        Nothing is left behind, neither where the output would be nor in the folder for temporary files.
        """
        before = listing(self.work)
        result = self.hedgehop(*arguments)
        told = result.stderr
        self.assertEqual(result.returncode, code, told + result.stdout)
        errors = [line for line in told.splitlines() if line.startswith("error: ")]
        self.assertEqual(len(errors), 1, told)
        for word in mentions:
            self.assertIn(str(word), told)
        rest = told[told.index(errors[0]):]
        self.assertRegex(rest, r"(?m)^hint: |; ", "no word about what to do")
        self.assertRegex(rest, advice)
        self.assert_nothing_left(before)
        return result

    def assert_nothing_left(self, before=()):
        self.assertEqual(listing(self.work), list(before))
        self.assertEqual(listing(self.temporary), [])

    def prepare(self, dem, *more, bbox=BBOX, out="map"):
        return ["prepare", "--dem", dem, "--bbox", bbox, "--cell-m", CELL_M, "--out", self.work / out, *more]

    def plan_arguments(self, *more, start=START, goal=GOAL):
        return ["plan", "--map", self.map, "--start", start, "--goal", goal, "--work", WORK,
                "--out", self.work / "plan", *more]


class BadInputOfPrepare(CliTest):
    def test_missing_elevation_file(self):
        self.assert_refused(self.prepare(self.work / "N49E011.hgt"), 5, ["N49E011.hgt"])

    def test_missing_land_use_file(self):
        self.assert_refused(self.prepare(self.hgt, "--osm", self.work / "none.osm.pbf"), 5, ["none.osm.pbf"])

    def test_folder_in_place_of_an_elevation_file(self):
        folder = self.work / "N49E011.hgt"
        folder.mkdir()
        self.assert_refused(self.prepare(folder), 5, ["N49E011.hgt"])

    def test_elevation_file_that_is_not_a_raster(self):
        text = self.work / "notes.tif"
        text.write_text("this is no raster\n" * 100)
        self.assert_refused(self.prepare(text), 5, ["notes.tif"])

    def test_empty_elevation_file(self):
        empty = self.work / "N49E011.hgt"
        empty.write_bytes(b"")
        self.assert_refused(self.prepare(empty), 5, ["N49E011.hgt"])

    def test_hgt_whose_name_is_no_place(self):
        wrong = self.work / "terrain.hgt"
        shutil.copy(self.hgt, wrong)
        self.assert_refused(self.prepare(wrong), 5, ["terrain.hgt"], advice=r"[NS]\d\d[EW]\d\d\d")

    def test_hgt_with_a_part_missing(self):
        short = self.work / "N49E011.hgt"
        short.write_bytes(self.hgt.read_bytes()[:-3000])
        self.assert_refused(self.prepare(short), 5, ["N49E011.hgt"])

    def test_truncated_zip(self):
        whole = (INPUTS / "N49E011.hgt.zip").read_bytes()
        cut = self.work / "N49E011.hgt.zip"
        cut.write_bytes(whole[:len(whole) // 2])
        self.assert_refused(self.prepare(cut), 5, ["N49E011.hgt.zip"])

    def test_zip_with_damaged_content(self):
        whole = bytearray((INPUTS / "N49E011.hgt.zip").read_bytes())
        middle = len(whole) // 2
        whole[middle:middle + 64] = bytes(64)
        damaged = self.work / "N49E011.hgt.zip"
        damaged.write_bytes(whole)
        self.assert_refused(self.prepare(damaged), 5, ["N49E011.hgt.zip"])

    def test_zip_without_an_elevation_file(self):
        text = self.work / "readme.txt"
        text.write_text("nothing here\n")
        archive = self.work / "N49E011.hgt.zip"
        inputs.zip_of(archive, text)
        self.assert_refused(self.prepare(archive), 5, ["N49E011.hgt.zip"])

    def test_elevation_of_voids_alone(self):
        void = self.work / "N49E011.hgt"
        inputs.write_all_void_hgt(void)
        self.assert_refused(self.prepare(void), 5, ["void", "11.4", "49.58"], advice="--dem")

    def test_land_use_without_nodes(self):
        bare = self.work / "bare.osm"
        inputs.write_osm(bare, '<?xml version="1.0"?>\n<osm version="0.6"></osm>\n')
        self.assert_refused(self.prepare(self.hgt, "--osm", bare), 5, ["bare.osm"], advice="node")

    def test_obstacle_file_with_a_line_that_cannot_be_read(self):
        table = self.work / "masts.csv"
        table.write_text("latitude,longitude,height_m\n49.54,11.45,80\n49.54,11.46,tall\n")
        self.assert_refused(self.prepare(self.hgt, "--obstacles", table), 5, ["masts.csv:3", "tall"], advice="correct")

    def test_airspace_with_a_line_that_cannot_be_read(self):
        airspace = self.work / "airspace.txt"
        airspace.write_text("AC R\nAN one\nAL as agreed\n")
        self.assert_refused(self.prepare(self.hgt, "--areas", airspace), 5, ["airspace.txt:3", "as agreed"], advice="correct")

    def test_land_use_that_ends_in_the_middle(self):
        text = inputs.land_use()
        cut = self.work / "cut.osm"
        cut.write_text(text[:len(text) // 2])
        self.assert_refused(self.prepare(self.hgt, "--osm", cut), 5, ["cut.osm"])

    def test_land_use_that_is_no_such_file(self):
        wrong = self.work / "wrong.osm.pbf"
        wrong.write_bytes(bytes(range(256)) * 40)
        self.assert_refused(self.prepare(self.hgt, "--osm", wrong), 5, ["wrong.osm.pbf"])

    def test_bounding_box_outside_the_elevation(self):
        self.assert_refused(self.prepare(self.hgt, bbox="20.1,60.1,20.2,60.2"), 5, ["20.1", "60.2", "10.99", "50.00"],
                            advice="bounding box")

    def test_bounding_box_half_outside_the_elevation_is_a_remark(self):
        result = self.hedgehop(*self.prepare(self.hgt, bbox="10.9,49.5,11.1,49.6"))
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertRegex(result.stderr, r"(?m)^note: (49|50|51)(\.\d+)? % of the map has no elevation")

    def test_bounding_box_inside_out(self):
        self.assert_refused(self.prepare(self.hgt, bbox="11.5,49.6,11.4,49.5"), 2, [], advice="bbox|extent|west")

    def test_bounding_box_larger_than_the_limit(self):
        self.assert_refused(["prepare", "--dem", self.hgt, "--bbox", "11.0,49.0,12.0,50.0", "--cell-m", "0.5",
                             "--out", self.work / "map"], 2, [], advice="cell")

    def test_unknown_configuration_key(self):
        mine = self.work / "mine.yaml"
        mine.write_text("# my settings\ncell_mm: 30\n")
        self.assert_refused(self.prepare(self.hgt, "--config", mine), 2, ["mine.yaml:2", "cell_mm"], advice="cell_m'")

    def test_ill_typed_configuration_value(self):
        mine = self.work / "mine.yaml"
        mine.write_text("# my settings\ncell_m: wide\n")
        result = self.hedgehop(*self.prepare(self.hgt, "--config", mine))
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertIn("mine.yaml:2: 'cell_m' must be a number", result.stderr)

    def test_missing_configuration_file(self):
        result = self.hedgehop(*self.prepare(self.hgt, "--config", self.work / "none.yaml"))
        self.assertIn(result.returncode, (2, 5))
        self.assertIn("none.yaml", result.stderr)

    def test_output_folder_that_exists(self):
        (self.work / "map").mkdir()
        (self.work / "map" / "letter.txt").write_text("keep me\n")
        self.assert_refused(self.prepare(self.hgt), 2, ["map"], advice="--out|--overwrite|another|remove")
        # not even when told to: it is no map
        self.assert_refused(self.prepare(self.hgt, "--overwrite"), 2, ["map"])

    def test_output_folder_whose_parent_is_missing(self):
        self.assert_refused(self.prepare(self.hgt, out="no/such/map"), 2, ["no/such"])


class BadInputOfPlan(CliTest):
    def test_map_that_is_missing(self):
        self.assert_refused(["plan", "--map", self.work / "none", "--start", START, "--goal", GOAL,
                             "--out", self.work / "plan"], 5, ["none"])

    def test_map_with_a_damaged_layer(self):
        damaged = self.work / "map"
        shutil.copytree(self.map, damaged)
        layer = damaged / "surface.tif"
        content = bytearray(layer.read_bytes())
        middle = len(content) // 2
        content[middle] ^= 0xFF
        layer.write_bytes(content)
        self.assert_refused(["plan", "--map", damaged, "--start", START, "--goal", GOAL,
                             "--out", self.work / "plan"], 5, [str(damaged)])

    def test_map_with_a_layer_missing(self):
        damaged = self.work / "map"
        shutil.copytree(self.map, damaged)
        (damaged / "visibility.tif").unlink()
        self.assert_refused(["plan", "--map", damaged, "--start", START, "--goal", GOAL,
                             "--out", self.work / "plan"], 5, ["visibility"])

    def test_start_outside_the_map(self):
        self.assert_refused(self.plan_arguments(start="48.0,11.45"), 2, ["start", "48.0", "outside the map"])

    def test_goal_outside_the_map(self):
        self.assert_refused(self.plan_arguments(goal="49.55,12.5"), 2, ["goal", "12.5", "outside the map"])

    def test_start_inside_the_terrain(self):
        self.assert_refused(self.plan_arguments(start=START + ",-25"), 2, ["start", "-25.0 m"], advice="raise")

    def test_start_closer_to_the_ground_than_the_clearance(self):
        self.assert_refused(self.plan_arguments(start=START + ",4"), 2, ["start", "4.0 m"], advice="raise")

    def test_start_above_the_envelope(self):
        self.assert_refused(self.plan_arguments(start=START + ",900"), 2, ["start", "900.0 m", "envelope"], advice="lower")

    def test_goal_equal_to_start(self):
        self.assert_refused(self.plan_arguments(goal=START), 2, ["goal"], advice="another")

    def test_start_that_is_no_place(self):
        for text in ("here", "49.5", "49.5,11.4,30,1", "99,11", "49.5;11.4", "nan,11.4"):
            with self.subTest(start=text):
                self.assert_refused(self.plan_arguments(start=text), 2, ["--start", text])

    def test_unknown_configuration_key(self):
        mine = self.work / "mine.yaml"
        mine.write_text("global:\n  # search\n  bach_size: 500\n")
        self.assert_refused(self.plan_arguments("--config", mine), 2, ["mine.yaml:3", "bach_size"], advice="batch_size")

    def test_unknown_setting(self):
        self.assert_refused(self.plan_arguments("--set", "global.bach_size=500"), 2, ["bach_size"], advice="batch_size")

    def test_ill_typed_configuration_value(self):
        mine = self.work / "mine.yaml"
        mine.write_text("local:\n  window_m: [far]\n")
        result = self.hedgehop(*self.plan_arguments("--config", mine))
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertIn("mine.yaml:2: ", result.stderr)

    def test_duplicate_configuration_key(self):
        mine = self.work / "mine.yaml"
        mine.write_text("speed_mps: 30\nspeed_mps: 40\n")
        result = self.hedgehop(*self.plan_arguments("--config", mine))
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertIn("mine.yaml:2: duplicate key 'speed_mps'", result.stderr)

    def test_output_folder_that_exists(self):
        (self.work / "plan").mkdir()
        (self.work / "plan" / "letter.txt").write_text("keep me\n")
        self.assert_refused(self.plan_arguments(), 2, ["plan"], advice="--out|--overwrite|another|remove")

    def mission(self, name, text):
        path = self.work / name
        path.write_text(text)
        return path

    def test_neither_mission_nor_start(self):
        self.assert_refused(["plan", "--map", self.map, "--goal", GOAL, "--out", self.work / "plan"], 2, ["--start"],
                            advice="--mission")

    def test_mission_beside_start(self):
        result = self.hedgehop(*self.plan_arguments("--mission", "m.yaml"))
        self.assertEqual(result.returncode, 2)
        self.assertIn("--mission", result.stderr)

    def test_mission_that_cannot_be_kept(self):
        for name, text, code, mentions in (
                ("m.yaml", "start: {latitude_deg: 49.51, longitude_deg: 11.42}\n"
                           "goal: {latitude_deg: 49.57, longitude_deg: 11.50, hold_s: 4}\n", 2, "m.yaml:2"),
                ("m.yaml", "start: {latitude_deg: 49.51, longitude: 11.42}\n", 2, "m.yaml:1"),
                ("m.gpx", "no xml", 5, "m.gpx"),
                ("m.xyz", "?", 5, ".waypoints")):
            with self.subTest(name=name, text=text):
                path = self.mission(name, text)
                before = listing(self.work)
                result = self.hedgehop("plan", "--map", self.map, "--mission", path, "--out", self.work / "plan")
                self.assertEqual(result.returncode, code, result.stderr)
                self.assertIn(mentions, result.stderr)
                self.assertEqual(listing(self.work), before)

    def test_mission_over_the_bus_with_heights_that_need_the_map(self):
        path = self.mission("m.yaml", "start: {latitude_deg: 49.51, longitude_deg: 11.42, altitude_m: 500}\n"
                                      "goal: {latitude_deg: 49.57, longitude_deg: 11.50}\n")
        result = self.hedgehop("request", "--mission", path, "--out", self.work / "plan")
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertIn("m.yaml:1", result.stderr)
        self.assertIn("--ignore-heights", result.stderr)

    def test_no_verb_and_unknown_option(self):
        for arguments in ([], ["plan"], ["--nonsense"], ["plan", "--nonsense"], ["fly"]):
            with self.subTest(arguments=arguments):
                result = self.hedgehop(*arguments)
                self.assertEqual(result.returncode, 2, result.stderr)
                self.assertTrue(result.stderr.strip())
                self.assertEqual(result.stdout, "")
        self.assert_nothing_left()

    def test_error_as_json(self):
        result = self.hedgehop(*self.plan_arguments("--json", start="here"))
        self.assertEqual(result.returncode, 2)
        error = json.loads(result.stdout)["error"]
        self.assertEqual(error["exit_code"], 2)
        self.assertIn("here", error["what"])


class BadInputOfOtherVerbs(CliTest):
    def test_verify_refuses_what_is_no_plan(self):
        self.assert_refused(["verify", self.work / "none", "--map", self.map], 5, ["none"])

    def test_verify_refuses_a_plan_of_another_map(self):
        other = self.work / "other"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", BBOX, "--cell-m", "90", "--out", other)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assert_refused(["verify", self.plan, "--map", other], 2, ["other"])

    def test_verify_finds_a_trajectory_that_was_lowered_into_the_ground(self):
        plan = self.work / "plan"
        shutil.copytree(self.plan, plan)
        table = plan / "trajectory.csv"
        lines = table.read_text().splitlines()
        header = next(i for i, line in enumerate(lines) if "altitude_m" in line)
        column = lines[header].split(",").index("altitude_m")
        for i in range(header + 1, len(lines)):
            cells = lines[i].split(",")
            cells[column] = str(float(cells[column]) - 60.0)
            lines[i] = ",".join(cells)
        table.write_text("\n".join(lines) + "\n")
        result = self.hedgehop("verify", plan, "--map", self.map, "--json")
        self.assertEqual(result.returncode, 4, result.stderr)
        found = {entry["rule"]: entry for entry in reversed(json.loads(result.stdout)["violations"])}
        self.assertIn("height_column", found)  # falsified with it
        worst = found["clearance"]
        self.assertEqual(worst["unit"], "m")
        self.assertLess(worst["value"], worst["limit"])
        west, south, east, north = inputs.BBOX
        self.assertTrue(south < worst["latitude_deg"] < north and west < worst["longitude_deg"] < east, worst)
        self.assertIn("violation: clearance: ", result.stderr)


    def export_arguments(self, *more, formats="kml", out="out"):
        return ["export", self.plan, "--format", formats, "--out", self.work / out, *more]

    def test_export_of_an_unknown_format(self):
        self.assert_refused(self.export_arguments(formats="kml,geojsn"), 2, ["geojsn"], advice="geojson")

    def test_export_of_straight_legs_needs_the_map(self):
        self.assert_refused(self.export_arguments(formats="qgc"), 2, ["qgc"], advice="--map")

    def test_export_at_a_time_without_a_zone(self):
        self.assert_refused(self.export_arguments("--start-time", "2026-05-01T06:30"), 2, ["2026-05-01T06:30"], advice="Z")

    def test_export_of_what_is_no_plan(self):
        self.assert_refused(["export", self.work / "none", "--format", "kml", "--out", self.work / "out"], 5, ["none"])

    def test_export_below_a_missing_folder(self):
        self.assert_refused(self.export_arguments(out="no/such"), 2, ["no"])

    def test_export_with_a_clearance_that_the_flight_does_not_hold(self):
        self.assert_refused(self.export_arguments("--map", self.map, "--clearance-m", "500", formats="waypoints"), 4,
                            ["500.00 m"], advice="--clearance-m")

    def test_export_replaces_nothing_unless_told_to(self):
        (self.work / "out").mkdir()
        kept = self.work / "out" / "flight.gpx"
        kept.write_text("keep me\n")
        before = listing(self.work)
        result = self.hedgehop(*self.export_arguments(formats="kml,gpx"))
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertIn("--overwrite", result.stderr)
        self.assertEqual(listing(self.work), before)
        result = self.hedgehop(*self.export_arguments("--overwrite", formats="kml,gpx"))
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("<gpx", kept.read_text())


class FullDisk(CliTest):
    """A tiny file system, visible to the tested program alone."""

    def run_on_tmpfs(self, size_kib, *arguments):
        disk = self.work / "disk"
        disk.mkdir(exist_ok=True)
        script = ('mount -t tmpfs -o size="$1k" none "$2" || exit 99; list="$3"; disk="$2"; shift 3; '
                  '"$@"; code=$?; find "$disk" -mindepth 1 > "$list"; exit "$code"')
        left = self.work / "left.txt"
        namespace = ["unshare", "--mount"] if os.geteuid() == 0 else ["unshare", "--user", "--map-root-user", "--mount"]
        result = subprocess.run([*namespace, "sh", "-c", script, "sh", str(size_kib), disk, left, HEDGEHOP,
                                 *map(str, arguments)], capture_output=True, text=True, timeout=100,
                                env=self.environment())
        if not left.exists():
            self.skipTest("no small file system can be mounted here (needs root or user namespaces): "
                          + result.stderr.strip().splitlines()[-1])
        return result, left.read_text().split()

    def check(self, whole, arguments):
        """At several sizes of the disk, so that it fills up in different files."""
        kib = sum(path.stat().st_size for path in whole.rglob("*") if path.is_file()) // 1024
        for size in (4, kib // 4, kib // 2, kib * 8 // 10):
            with self.subTest(kib=size):
                result, left = self.run_on_tmpfs(max(size, 4), *arguments)
                self.assertEqual(result.returncode, 1, result.stderr)
                self.assertRegex(result.stderr, r"(?m)^error: .*(space|disk|full|write)")
                self.assertRegex(result.stderr, r"(?m)^hint: ")
                self.assertEqual(left, [])
                self.assertEqual(listing(self.temporary), [])

    def test_prepare_leaves_nothing(self):
        self.check(self.map, ["prepare", "--dem", self.hgt, "--osm", self.osm, "--bbox", BBOX, "--cell-m", CELL_M,
                              "--out", self.work / "disk" / "map"])

    def test_export_leaves_nothing(self):
        arguments = ["export", self.plan, "--map", self.map, "--format", "kml,csv,gpkg"]
        whole = self.work / "whole"
        result = self.hedgehop(*arguments, "--out", whole)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.check(whole, [*arguments, "--out", self.work / "disk" / "out"])

    def test_plan_leaves_nothing(self):
        self.check(self.plan, ["plan", "--map", self.map, "--start", START, "--goal", GOAL, "--work", WORK,
                               "--out", self.work / "disk" / "plan"])


class Interrupted(CliTest):
    """Ctrl-C in each phase; phases are learnt from what an undisturbed run says on stderr."""

    def stages(self, arguments, allowed=(0,)):
        result = self.hedgehop(*arguments)
        self.assertIn(result.returncode, allowed, result.stderr)
        found = []
        for line in result.stderr.splitlines():
            match = re.fullmatch(r"(.+): \d+ %", line)
            if match and match.group(1) not in found:
                found.append(match.group(1))
        self.assertGreaterEqual(len(found), 2, result.stderr)
        return found

    def interrupt(self, arguments, stage, number=signal.SIGINT):
        """Exit code and stderr of a run that gets the signal as soon as it enters the stage."""
        process = subprocess.Popen([HEDGEHOP, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   text=True, env=self.environment(), cwd=self.work)
        told, sent = [], False
        for line in process.stderr:
            told.append(line)
            if not sent and (stage is None or line.startswith(stage + ": ")):
                process.send_signal(number)
                sent = True
        process.wait(timeout=60)
        process.stdout.close()
        process.stderr.close()
        self.assertTrue(sent, f"the stage '{stage}' did not show")
        return process.returncode, "".join(told)

    def check(self, arguments, whole, allowed=(0,)):
        stages = self.stages([*arguments, "--out", self.work / "whole"], allowed)
        shutil.rmtree(self.work / "whole")
        for stage in stages:
            for attempt in range(3):
                with self.subTest(stage=stage, attempt=attempt):
                    code, told = self.interrupt([*arguments, "--out", self.work / "out"], stage)
                    if code in allowed and stage == stages[-1] and attempt < 2:
                        shutil.rmtree(self.work / "out")  # it was faster than the signal
                        continue
                    self.assertEqual(code, 130, told)
                    self.assertRegex(told, "(?m)^error: interrupted")
                    self.assert_nothing_left()
                break

    def test_prepare_stops_in_each_phase_and_leaves_nothing(self):
        self.check(["prepare", "--dem", self.hgt, "--osm", self.osm, "--bbox", "11.30,49.40,11.70,49.70",
                    "--cell-m", "40"], self.map)

    def test_plan_that_is_stopped_once_in_any_phase_is_whole_or_nothing(self):
        arguments = ["plan", "--map", self.map, "--start", START, "--goal", GOAL, "--work", "60000"]
        stages = self.stages([*arguments, "--out", self.work / "whole"], (0, 4))
        shutil.rmtree(self.work / "whole")
        for stage in stages:
            with self.subTest(stage=stage):
                code, told = self.interrupt([*arguments, "--out", self.work / "out"], stage)
                if code == 130:
                    self.assertRegex(told, "(?m)^error: interrupted")
                    self.assert_nothing_left()
                    continue
                self.assertIn(code, (0, 4), told)
                self.assertEqual("the best route until then" in told, "stopped: flying the best route so far" in told, told)
                self.assertEqual(self.hedgehop("verify", self.work / "out", "--map", self.map).returncode, 0)
                shutil.rmtree(self.work / "out")

    def anytime(self, *more):
        """A search that would go on for minutes, seen until it has begun."""
        process = subprocess.Popen([HEDGEHOP, "plan", "--map", self.map, "--start", START, "--goal", GOAL, "--out", self.work / "out", "--json",
                                    "--set", "global.planner=bit_star", "--work", "2000000000", *more], stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True, env=self.environment(), cwd=self.work)
        self.assertIn("planning the route", process.stderr.readline())
        return process

    def test_plan_that_is_stopped_once_gives_the_best_so_far(self):
        for wait_s in (3, 10, 30):  # until there is a first route, on a slow machine too
            process = self.anytime()
            try:
                process.wait(timeout=wait_s)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGINT)
            out, told = process.communicate(timeout=100)
            if process.returncode != 130:
                break
        self.assertEqual(process.returncode, 4, told)
        found = json.loads(out)
        self.assertTrue(found["is_stopped"])
        self.assertRegex(found["warnings"][-1], r"^stopped after \d+ work units")
        self.assertEqual(self.hedgehop("verify", self.work / "out", "--map", self.map).returncode, 0)

    def test_plan_that_is_stopped_twice_leaves_nothing(self):
        process = self.anytime()
        process.send_signal(signal.SIGINT)
        for line in process.stderr:  # two signals that have not been seen yet count as one
            if "Ctrl-C again" in line:
                process.send_signal(signal.SIGINT)
                break
        out, told = process.communicate(timeout=100)
        self.assertEqual(process.returncode, 130, told)
        self.assertEqual(json.loads(out)["error"]["exit_code"], 130)
        self.assert_nothing_left()

    def stopped_at(self, pattern, process):
        """What a process prints that gets Ctrl-C at the first line of progress that begins like this."""
        told = []
        for line in process.stderr:
            told.append(line)
            if re.match(pattern, line):
                process.send_signal(signal.SIGINT)
                break
        out, rest = process.communicate(timeout=100)
        self.assertEqual(process.returncode, 4, "".join(told) + rest)
        self.assertIn("stopped early", rest)
        found = json.loads(out)
        self.assertTrue(found["is_stopped"])
        return found

    def test_evaluation_tells_the_time_to_go_and_when_it_is_stopped_what_it_has(self):
        area = self.work / "area"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.2,49.4,11.5,49.6", "--cell-m", "90", "--out", area)
        self.assertEqual(result.returncode, 0, result.stderr)
        process = subprocess.Popen([HEDGEHOP, "evaluate", "random", "--map", area, "--problems", "120", "--set", "global.work_budget=60000", "--json"],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment(), cwd=self.work)
        found = self.stopped_at(r"planning drawn problems: \d+ %, (\d+:)?\d+:\d\d to go$", process)
        self.assertTrue(1 <= found["drawn"] < 120, found["drawn"])
        self.assertEqual(len(found["problems"]), found["drawn"])

    def test_every_evaluation_that_is_stopped_tells_what_it_has(self):
        area = self.work / "area"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.2,49.4,11.5,49.6", "--cell-m", "90", "--out", area)
        self.assertEqual(result.returncode, 0, result.stderr)
        on_area = ["--map", area, "--seed", "1"]
        for verb, arguments, stage, least, found_of, whole in (
                ("local-speed", ["--length", "2000", "--repeats", "1", "--reference-repeats", "1"], "local speed", 10,
                 lambda json: len(json["rows"]), 31),
                ("protection", [*on_area, "--cells", "2000"], "brute force", 10, lambda json: json["error"]["cells"], 2000),
                ("sensitivity", [*on_area, "--runs", "2", "--parameters", "local.window_m"], "values", 10, lambda json: len(json["rows"]), 6),
                ("table3", [*on_area, "--runs", "6", "--budget-s", "0.5"], "the paper's framework and its baseline", 10,
                 lambda json: json["solved"], 6)):
            with self.subTest(verb=verb):
                process = subprocess.Popen([HEDGEHOP, "evaluate", verb, *map(str, arguments), "--json"], stdout=subprocess.PIPE,
                                           stderr=subprocess.PIPE, text=True, env=self.environment(), cwd=self.work)
                told = []
                for line in process.stderr:
                    told.append(line)
                    match = re.match(re.escape(stage) + r": (\d+) %", line)
                    if match and int(match.group(1)) >= least:
                        process.send_signal(signal.SIGINT)
                        break
                out, rest = process.communicate(timeout=100)
                self.assertEqual(process.returncode, 4, "".join(told) + rest)
                self.assertIn("stopped early", rest)
                found = json.loads(out)
                self.assertTrue(found["is_stopped"])
                self.assertTrue(1 <= found_of(found) < whole, found_of(found))

    def test_tuning_that_is_stopped_checks_and_writes_the_best_so_far(self):
        area = self.work / "area"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.2,49.4,11.5,49.6", "--cell-m", "90", "--out", area)
        self.assertEqual(result.returncode, 0, result.stderr)
        tuned = self.work / "tuned.yaml"
        process = subprocess.Popen([HEDGEHOP, "tune", "--map", area, "--seed", "5", "--flights", "1", "--held-out", "1",
                                    "--evaluations", "1000", "--set", "global.work_budget=60000", "--out", tuned, "--json"],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment(), cwd=self.work)
        found = self.stopped_at(r"sets of parameters: \d+ %", process)
        self.assertTrue(1 <= found["evaluations"] < 1000, found["evaluations"])
        self.assertEqual(found["held_out"]["tuned"]["flights"], 1)
        self.assertIn(found["verdict"], tuned.read_text())

    def test_sigterm_stops_as_ctrl_c_does(self):
        stage = self.stages(self.prepare(self.hgt))[0]
        shutil.rmtree(self.work / "map")
        code, told = self.interrupt(["prepare", "--dem", self.hgt, "--bbox", "11.30,49.40,11.70,49.70", "--cell-m", "40",
                                     "--out", self.work / "out"], stage, signal.SIGTERM)
        self.assertEqual(code, 130, told)
        self.assert_nothing_left()


class Talk(CliTest):
    """What is said while work goes on, to a terminal and to a file."""

    def on_terminal(self, *arguments, **environment):
        """Everything that a run writes to a terminal of its own."""
        import pty
        master, slave = pty.openpty()
        process = subprocess.Popen([HEDGEHOP, *map(str, arguments)], stdout=subprocess.PIPE, stderr=slave, cwd=self.work,
                                   env={**self.environment(), "TERM": "xterm", **environment})
        os.close(slave)
        told = b""
        while True:
            try:
                piece = os.read(master, 4096)
            except OSError:  # the other end is closed
                break
            if not piece:
                break
            told += piece
        process.stdout.close()
        process.wait(timeout=100)
        os.close(master)
        return told.decode()

    def test_progress_is_one_line_per_ten_percent_and_quiet_is_quiet(self):
        arguments = self.prepare(self.hgt)
        told = self.hedgehop(*arguments).stderr
        percents = [int(number) for number in re.findall(r"(?m)^visibility: (\d+) %", told)]
        self.assertEqual(percents, sorted(set(percents)))
        self.assertTrue(all(number % 10 == 0 for number in percents), percents)
        self.assertIn(100, percents, told)
        self.assertEqual(self.hedgehop(*arguments, "--overwrite", "--quiet").stderr, "")
        self.assertRegex(self.hedgehop(*arguments, "--overwrite", "--verbose").stderr, r"(?m)^visibility: took \d+\.\d\d s$")

    def test_a_terminal_gets_a_bar_and_colours_unless_it_wants_none(self):
        bar = self.on_terminal(*self.prepare(self.hgt))
        self.assertRegex(bar, r"\rvisibility +\[#+\.*\] +\d+ %")
        self.assertIn("\033[1;31merror\033[0m: ", self.on_terminal("info", "none"))
        for quiet in ({"NO_COLOR": "1"}, {"TERM": "dumb"}):
            self.assertRegex(self.on_terminal("info", "none", **quiet), "(?m)^error: ")
        self.assertIn("\033[", self.on_terminal("info", "none", NO_COLOR=""))  # empty counts as not there

    def test_dry_run_is_right_within_its_factor_and_writes_nothing(self):
        arguments = ["prepare", "--dem", self.hgt, "--osm", self.osm, "--bbox", "11.30,49.40,11.70,49.70", "--cell-m", "30", "--out",
                     self.work / "map", "--json"]
        before = listing(self.work)
        told = json.loads(self.hedgehop(*arguments, "--dry-run").stdout)
        self.assertEqual(listing(self.work), before)
        import resource
        began = time.monotonic()
        result = self.hedgehop(*arguments)
        took_s = time.monotonic() - began
        self.assertEqual(result.returncode, 0, result.stderr)
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024  # of the largest child, which this one is
        made = json.loads(result.stdout)
        self.assertEqual((told["columns"], told["rows"], told["cell_m"]), (made["columns"], made["rows"], made["cell_m"]))
        disk = sum(path.stat().st_size for path in (self.work / "map").iterdir())
        for name, found in (("disk_bytes", disk), ("memory_bytes", peak)):
            self.assertTrue(told[name] / told["factor"] <= found <= told[name] * told["factor"], f"{name}: {told[name]:.0f}, was {found}")
        # Other tests run beside this one and take their share of the processor.
        self.assertTrue(told["duration_s"] / told["factor"] <= took_s <= 3.0 * told["duration_s"] * told["factor"],
                        f"duration_s: {told['duration_s']:.2f}, was {took_s:.2f}")

    def test_origin_of_each_value_is_told(self):
        mine = self.work / "mine.yaml"
        mine.write_text("# mine\nweights:\n  semantics: 3.0\nspeed_mps: 35.0\n")
        result = self.hedgehop("config", "show", "--origin", "--config", mine, "--set", "weights.visibility=7", "--json")
        self.assertEqual(result.returncode, 0, result.stderr)
        values = {entry["key"]: entry for entry in json.loads(result.stdout)["values"]}
        self.assertEqual((values["weights.semantics"]["source"], values["weights.semantics"]["line"]), (str(mine), 3))
        self.assertEqual((values["speed_mps"]["value"], values["speed_mps"]["line"]), ("35.0", 4))
        self.assertEqual((values["weights.visibility"]["value"], values["weights.visibility"]["source"]),
                         ("7", "--set weights.visibility=7"))
        vehicle = (ROOT / "config" / "vehicles" / "ec135.yaml").read_text().splitlines()
        place = values["vehicle.name"]
        self.assertEqual(place["source"], "config/vehicles/ec135.yaml")
        self.assertTrue(vehicle[place["line"] - 1].startswith("name:"))
        shipped = (ROOT / "config" / "planning.yaml").read_text().splitlines()
        for key, entry in values.items():
            self.assertTrue(entry["source"], key)
            if entry["source"] == "config/planning.yaml":
                self.assertIn(key.split(".")[-1] + ":", shipped[entry["line"] - 1])
        text = self.hedgehop("config", "show", "--origin", "--config", mine).stdout
        self.assertRegex(text, rf"(?m)^weights.semantics +3.0 +{re.escape(str(mine))}:3$")


class ExitCodes(CliTest):
    """What cannot be done, verb by verb: the exit code, and the same in JSON."""

    TABLE = {
        "prepare": (["--dem", "none.tif", "--out", "x"], 5),
        "fetch": (["--bbox", "1,2,3,4"], 2),
        "info": (["none"], 5),
        "roadmap": (["none"], 5),
        "plan": (["--map", "none", "--start", "49.5,11.4", "--goal", "49.6,11.5", "--out", "x"], 5),
        "verify": (["none", "--map", "none"], 5),
        "export": (["none", "--format", "kml", "--out", "x"], 5),
        "report": (["none", "--map", "none"], 5),
        "evaluate protection": (["--map", "none"], 5),
        "evaluate table2": (["--map", "none"], 5),
        "evaluate local-safety": (["--map", "none"], 5),
        "evaluate optimality": (["--map", "none"], 5),
        "evaluate reaction": (["--map", "none"], 5),
        "evaluate replanning": (["--map", "none"], 5),
        "evaluate local-speed": (["--threads", "0"], 2),
        "evaluate verifier": (["--map", "none"], 5),
        "evaluate random": (["--map", "none"], 5),
        "serve": (["--map", "none"], 5),
        "request": (["--start", "49.5,11.4", "--goal", "49.6,11.5", "--timeout-s", "1", "--out", "x"], 6),
        "watch": (["--lcm-url", "nonsense://here"], 2),
        "log info": (["none"], 5),
        "log check": (["none"], 5),
        "log repair": (["none", "--out", "x"], 5),
        "log cut": (["none", "--out", "x"], 5),
        "replay": (["none", "--stage", "local"], 5),
        "evaluate table3": (["--map", "none"], 5),
        "evaluate flight": (["--map", "none"], 5),
        "evaluate bus": (["--threads", "0"], 2),
        "evaluate sensitivity": (["--map", "none"], 5),
        "tune": (["--map", "none", "--out", "x.yaml"], 5),
        "patch add obstacle": (["--at", "49.5,11.4", "--radius-m", "-1", "--height-m", "5"], 2),
        "patch add threat": (["--at", "49.5,11.4", "--range-m", "-1", "--mast-height-m", "5"], 2),
        "patch add area": (["--corner", "49.5,11.4", "--timeout-s", "-1"], 2),
        "patch remove": (["nonsense"], 2),
        "patch list": (["--timeout-s", "-1"], 2),
        "patch map": (["--timeout-s", "-1", "--out", "x"], 2),
        "config list": (["--threads", "0"], 2),
        "config show": (["--set", "nothing=1"], 2),
        "doctor": (["--threads", "0"], 2),
        "demo": (["--out", "none/x"], 2),
        "completion": (["tcsh"], 2),
        "man": (["nothing"], 2),
    }

    def test_every_verb_of_the_command_tree(self):
        leaves = [" ".join(verb) for verb, _ in Help.leaves(self)]
        self.assertEqual(set(leaves), set(self.TABLE), "add new verbs to the table")
        for verb, (arguments, code) in self.TABLE.items():
            with self.subTest(verb=verb):
                result = self.hedgehop(*verb.split(), *arguments, "--json")
                self.assertEqual(result.returncode, code, result.stderr)
                self.assertRegex(result.stderr, "(?m)^error: .")
                found = json.loads(result.stdout)
                self.assertEqual((found["schema"], found["schema_version"]), ("hedgehop error", 1))
                self.assertEqual(found["error"]["exit_code"], code)
                self.assertTrue(found["error"]["what"])
        self.assert_nothing_left()

    def verbs(self):
        return Help.verbs(self)


class Help(CliTest):
    def verbs(self):
        result = self.hedgehop("--help")
        self.assertEqual(result.returncode, 0)
        block = result.stdout.split("Subcommands:")[1]
        found = re.findall(r"(?m)^  (\w+)  +\S", block.split("\n\n")[0])
        self.assertGreaterEqual(len(found), 5, result.stdout)
        return found

    def test_teaches_the_whole(self):
        text = self.hedgehop("--help").stdout
        for word in ("helicopter", "terrain", "prepare", "plan", "Exit codes", "130"):
            self.assertIn(word, text)

    def test_of_each_verb_says_its_purpose_its_options_and_an_example(self):
        verbs = [[verb] for verb in self.verbs()]
        while verbs:
            verb = verbs.pop()
            with self.subTest(verb=verb):
                result = self.hedgehop(*verb, "--help")
                self.assertEqual(result.returncode, 0, result.stderr)
                text = result.stdout
                self.assertGreaterEqual(len(text.splitlines()[0].split()), 3, "purpose")
                self.assertRegex(text, r"Examples?:\n")
                self.assertLessEqual(len(text.splitlines()), 50, "a screen")
                self.assertLessEqual(max(map(len, text.splitlines())), 100, "a screen")
                self.assertIn("hedgehop " + " ".join(verb), text.split("Example")[1])
                self.check_options(text)
                if "Subcommands:" in text:
                    below = re.findall(r"(?m)^  ([\w-]+)  +\S", text.split("Subcommands:")[1].split("\n\n")[0])
                    self.assertTrue(below)
                    verbs.extend([*verb, name] for name in below)

    def leaves(self):
        """Every verb that does something, verbs below verbs included."""
        verbs, leaves = [[verb] for verb in self.verbs()], []
        while verbs:
            verb = verbs.pop()
            text = self.hedgehop(*verb, "--help").stdout
            if "Subcommands:" in text:
                verbs.extend([*verb, name] for name in re.findall(r"(?m)^  ([\w-]+)  +\S", text.split("Subcommands:")[1].split("\n\n")[0]))
            else:
                leaves.append((verb, text))
        self.assertGreaterEqual(len(leaves), 20)
        return leaves

    def test_each_verb_takes_json_and_suggests_the_nearest_option_in_json_too(self):
        for verb, text in self.leaves():
            with self.subTest(verb=verb):
                self.assertRegex(text, r"(?m)^  --json ")
                result = self.hedgehop(*verb, "--jsn", "--json")
                self.assertEqual(result.returncode, 2, result.stderr)
                self.assertRegex(result.stderr, r"(?m)^error: unknown option '--jsn'$")
                self.assertRegex(result.stderr, r"(?m)^hint: did you mean '--json'\? hedgehop %s --help" % " ".join(verb))
                found = json.loads(result.stdout)
                self.assertEqual(found["schema_version"], 1)
                self.assertEqual(found["error"]["exit_code"], 2)
                self.assertIn("--jsn", found["error"]["what"])
                self.assertIn("--json", found["error"]["hint"])

    def test_misspelt_verb_suggests_the_nearest(self):
        for words, wrong, right in ((["pln"], "pln", "plan"), (["exprt", "--json"], "exprt", "export"),
                                    (["evaluate", "tabel2"], "tabel2", "table2"), (["config", "sho"], "sho", "show")):
            with self.subTest(words=words):
                result = self.hedgehop(*words)
                self.assertEqual(result.returncode, 2)
                self.assertRegex(result.stderr, f"(?m)^error: unknown verb '{wrong}'$")
                self.assertRegex(result.stderr, rf"(?m)^hint: did you mean '{right}'\?")
        for words in ([], ["evaluate"]):
            self.assertRegex(self.hedgehop(*words).stderr, "(?m)^error: a verb is missing after 'hedgehop")

    def test_each_verb_has_a_test_of_its_json(self):
        tested = {"prepare", "plan", "verify", "report", "export", "config", "evaluate", "info", "serve", "request", "replay", "log",
                  "watch", "doctor", "demo", "completion", "man", "roadmap", "tune", "fetch",  # fetch in tests/fetch/fetch_test.py
                  "patch"}  # the last one in tests/services/chain_test.py
        self.assertEqual(set(self.verbs()) - tested, set(), "add a test to the class Json, then the verb to this list")

    def check_options(self, text):
        block = re.search(r"(?ms)^Options:\n(.*?)\n\n", text + "\n\n")
        self.assertIsNotNone(block)
        options = re.split(r"(?m)^  (?=-)", block.group(1))[1:]
        self.assertGreaterEqual(len(options), 1)
        for option in options:
            # name, kind of value, then words for a person
            words = re.sub(r"^(-[-\w,]+)( [A-Z:\[\]{},.\w-]+)*?(?= {2,}|\n)", "", option, count=1).strip()
            self.assertGreaterEqual(len(words.split()), 2, option)

    def test_version_is_on_stdout(self):
        result = self.hedgehop("--version")
        self.assertEqual(result.returncode, 0)
        self.assertRegex(result.stdout, r"^hedgehop \d+\.\d+\.\d+")


class Shells(CliTest):
    """Completion as the shells themselves do it, and manual pages as groff reads them, against --help."""

    def script(self, shell):
        result = self.hedgehop("completion", shell)
        self.assertEqual(result.returncode, 0, result.stderr)
        path = self.work / ("script." + shell)
        path.write_text(result.stdout)
        return path

    def run_shell(self, program, *arguments):
        if shutil.which(program) is None:
            self.skipTest(f"{program} is not installed")
        result = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=60, cwd=self.work,
                                env={**self.environment(), "HOME": str(self.work)})
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(result.stderr, "")
        return result.stdout

    def wanted(self):
        """What may follow some lines: verbs of two kinds, and the options of three verbs as --help lists them."""
        found = {}
        for verb in ("plan", "export", "log info"):
            text = self.hedgehop(*verb.split(), "--help").stdout
            found[f"{verb} --"] = set(re.findall(r"(?m)^  (?:-\w,)?(--[\w-]+)", text))
            self.assertGreater(len(found[f"{verb} --"]), 4)
        found["log "] = {"info", "check", "repair", "cut"}
        found["pl"] = {"plan"}
        found["replay x --stage l"] = {"local"}
        found["completion "] = {"bash", "zsh", "fish"}
        return found

    def test_bash_completes_verbs_options_and_choices(self):
        script = self.script("bash")
        for line, wanted in self.wanted().items():
            with self.subTest(line=line):
                words = ["hedgehop", *line.split(" ")]
                told = self.run_shell("bash", "-c", 'source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _hedgehop; '
                                      'printf "%s\\n" "${COMPREPLY[@]}"', "bash", script, *words)
                found = set(told.split())
                self.assertEqual({word for word in found if not word.startswith("-") or line.endswith("--")}, wanted)

    def test_zsh_completes_verbs_options_and_choices(self):
        script = self.script("zsh")
        stubs = ('compdef() { }; compadd() { shift; print -l -- "$@" }; _files() { }; '
                 '_describe() { for each in "${(@P)@[-1]}"; do print -r -- "${each%%:*}"; done }; ')
        for line, wanted in self.wanted().items():
            with self.subTest(line=line):
                words = ["hedgehop", *line.split(" ")]
                told = self.run_shell("zsh", "-f", "-c", stubs + 'source "$1"; shift; words=("$@"); CURRENT=$#; _hedgehop', "zsh",
                                      script, *words)
                # zsh itself keeps those that begin with what was typed
                self.assertEqual({word for word in told.split() if word.startswith(words[-1])}, wanted)

    def test_fish_completes_verbs_options_and_choices(self):
        script = self.script("fish")
        for line, wanted in self.wanted().items():
            with self.subTest(line=line):
                told = self.run_shell("fish", "--no-config", "-c", f'source {script}; complete -C "hedgehop {line}"')
                self.assertEqual({word.split("\t")[0] for word in told.splitlines()}, wanted)

    def test_manual_pages_of_all_verbs_are_read_without_a_warning_and_hold_every_option(self):
        found = json.loads(self.hedgehop("man", "--out", self.work / "man1", "--json").stdout)
        self.assertEqual(found["schema_version"], 1)
        pages = sorted((self.work / "man1").iterdir())
        self.assertEqual([str(page) for page in pages], sorted(found["pages"]))
        self.assertGreater(len(pages), 25)
        for page in pages:
            with self.subTest(page=page.name):
                if shutil.which("groff") is None:
                    self.skipTest("groff is not installed")
                result = subprocess.run(["groff", "-man", "-ww", "-Tascii", "-P-c", page], capture_output=True, text=True)
                self.assertEqual((result.returncode, result.stderr), (0, ""))
                text = re.sub(".\x08", "", result.stdout)  # bold is struck over
                self.assertRegex(text, r"(?m)^NAME$")
        plan = (self.work / "man1" / "hedgehop-plan.1").read_text().replace("\\-", "-")
        for option in self.wanted()["plan --"]:
            self.assertIn(option, plan)
        self.assertIn(".SH EXAMPLES", plan)
        self.assertEqual(self.hedgehop("man", "plan").stdout, (self.work / "man1" / "hedgehop-plan.1").read_text())
        again = self.hedgehop("man", "--out", self.work / "man1")
        self.assertEqual(again.returncode, 2)
        self.assertIn("--overwrite", again.stderr)
        wrong = self.hedgehop("man", "log", "inf")
        self.assertEqual(wrong.returncode, 2)
        self.assertIn("did you mean 'info'", wrong.stderr)

    def test_completion_as_json(self):
        found = json.loads(self.hedgehop("completion", "bash", "--json").stdout)
        self.assertEqual((found["schema_version"], found["shell"]), (1, "bash"))
        self.assertEqual(found["script"], self.hedgehop("completion", "bash").stdout)


class Json(CliTest):
    def one_object(self, *arguments, allowed=(0,), schema_version=1):
        result = self.hedgehop(*arguments, "--json")
        self.assertIn(result.returncode, allowed, result.stderr)
        found = json.loads(result.stdout)
        self.assertIsInstance(found, dict)
        self.assertEqual((found["schema"], found["schema_version"]), (self.schema_of(arguments), schema_version))
        return found

    @staticmethod
    def schema_of(arguments):
        """Name of what a verb says with --json, by the words of the command line."""
        words = [str(argument) for argument in arguments]
        name = " ".join(words[:2]) if words[0] in ("evaluate", "log", "config") else words[0]
        special = {"plan": "plan result", "request": "plan result", "info": "place" if "--at" in words else "map",
                   "log repair": "log written", "log cut": "log written", "man": "man page" if len(words) > 1 and words[1] != "--out" else "man pages"}
        if name == "config show" and "--origin" in words:
            return "hedgehop config origin"
        if name == "prepare" and "--dry-run" in words:
            return "hedgehop prepare estimate"
        if name == "verify" and words[1].endswith((".plan", ".waypoints")):
            return "hedgehop verify legs"
        return "hedgehop " + special.get(name, name)

    def test_prepare(self):
        found = self.one_object(*self.prepare(INPUTS / "N49E011.hgt.zip", "--osm", self.osm))
        self.assertRegex(found["map_hash"], "^[0-9a-f]{32}$")
        # 0.12 degrees of longitude at 49.54 N are 8.67 km, 0.08 of latitude 8.90 km, in cells of 60 m;
        # the frame of a UTM zone is turned a little against north
        self.assertTrue(140 <= found["columns"] <= 155, found["columns"])
        self.assertTrue(144 <= found["rows"] <= 159, found["rows"])

    def test_obstacles_and_areas_reach_info_and_plan(self):
        table, airspace = self.work / "masts.csv", self.work / "airspace.txt"
        table.write_text("latitude,longitude,height_m,accuracy\n49.54,11.45,80,1A\n40.0,11.45,80,1A\n")
        airspace.write_text("AC R\nAN ED-R 5\nAL GND\nAH FL 65\nV X=49:30:36 N 011:25:12 E\nDC 0.5\n"
                            "AC Q\nAN ED-D 6\nV X=49:33:00 N 011:28:00 E\nDC 0.5\n")
        self.one_object(*self.prepare(self.hgt, "--obstacles", table, "--areas", airspace))
        found = self.one_object("info", self.work / "map", schema_version=2)
        features = found["statistics"]["features"]
        self.assertEqual((features["obstacles"], features["no_fly_areas"], features["avoid_areas"]), (1, 1, 1))
        text = self.hedgehop("info", self.work / "map").stdout
        self.assertRegex(text, r"(?m)^obstacles +1$")
        self.assertRegex(text, r"(?m)^no-fly areas +1$")
        refused = self.hedgehop("plan", "--map", self.work / "map", "--start", START, "--goal", GOAL, "--out", self.work / "plan")
        self.assertEqual(refused.returncode, 3, refused.stderr)
        self.assertIn("ED-R 5", refused.stderr)

    def test_plan_verify_and_report(self):
        plan = self.one_object(*self.plan_arguments(), allowed=(0, 4))
        verified = self.one_object("verify", self.work / "plan", "--map", self.map, allowed=(0, 4))
        self.assertEqual(plan["is_verified"], verified["is_verified"])
        self.assertEqual(plan["length_m"], verified["length_m"])
        self.assertEqual(verified["schema_version"], 1)
        self.assertEqual(verified["violations"] == [], verified["is_verified"])
        margins = verified["margins"]
        self.assertEqual(margins["clearance_m"]["min"], verified["clearance_min_m"])
        self.assertLessEqual(margins["clearance_m"]["p05"], margins["clearance_m"]["median"])
        self.assertIn(margins["nearest_miss"]["hazard"], ("ground", "wire", "obstacle", "area"))
        self.assertNotIn("uncertainty", verified)
        risk = self.one_object("verify", self.work / "plan", "--map", self.map, "--dem-error-m", "4", "--navigation-error-m", "2",
                               "--draws", "200", allowed=(0, 4))["uncertainty"]
        self.assertEqual(risk["draws"], 200)
        self.assertEqual(risk["clearance_m"], 10.0)
        self.assertLessEqual(risk["probability_low"], risk["probability"])
        self.assertLessEqual(risk["probability"], risk["probability_high"])
        self.assertLess(risk["least_clearance_m"]["p05"], margins["clearance_m"]["min"])
        # start and goal lie 8.82 km apart; a route is never shorter than that, less the goal's radius
        self.assertGreater(plan["length_m"], 8700.0)
        found = self.one_object("report", self.work / "plan", "--map", self.map)
        self.assertEqual(found["report"], str(self.work / "plan" / "report.html"))
        self.assertEqual(found["figures"], str(self.work / "plan" / "figures"))
        self.assertEqual(sorted(path.name for path in (self.work / "plan" / "figures").iterdir() if path.suffix in (".gp", ".pdf", ".svg", ".png")),
                         sorted(f"{name}.{suffix}" for name in ("map", "plan", "profile") for suffix in ("gp", "pdf", "png", "svg")))

    def test_routes_to_choose_from(self):
        more = self.work / "alternatives.yaml"
        more.write_text("routes_max: 3\nshared_share_max: 0.9\ngain_min: 0.0\n")
        found = self.one_object(*self.plan_arguments("--fly-alternatives", "--alternatives-config", more, "--figures"),
                                allowed=(0, 4))
        choices = json.loads((self.work / "plan" / "alternatives.json").read_text())
        self.assertEqual((choices["schema"], choices["request_id"]), ("hedgehop alternatives", found["request_id"]))
        self.assertEqual([route["name"] for route in choices["routes"]],
                         [route["name"] for route in found["alternatives"]["routes"]])
        self.assertEqual(choices["routes"][0]["name"], "main")
        self.assertLessEqual(len(choices["routes"]), 3)
        if len(choices["routes"]) < 3:
            self.assertTrue(choices["why_no_more"])
        lines = json.loads((self.work / "plan" / "alternatives.geojson").read_text())["features"]
        self.assertEqual(len(lines), len(choices["routes"]))
        self.assertTrue((self.work / "plan" / "figures" / "alternatives" / "alternatives.svg").exists())
        for route in choices["routes"][1:]:
            self.assertLessEqual(max(route["shared"].values()), 0.9)
            folder = self.work / "plan" / route["flown"]["plan"]
            verified = self.one_object("verify", folder, "--map", self.map, allowed=(0, 4))
            self.assertEqual(verified["is_verified"], route["flown"]["is_verified"])
        self.one_object("report", self.work / "plan", "--map", self.map, "--no-figures")
        page = (self.work / "plan" / "report.html").read_text()
        for route in choices["routes"]:
            self.assertIn(f">{route['name']}", page[page.index('id="choice-table"'):])
        # the plan itself is the one without alternatives
        self.one_object(*self.plan_arguments()[:-1], self.work / "alone", allowed=(0, 4))
        for name in ("plan.json", "trajectory.csv", "route.geojson"):
            self.assertEqual((self.work / "alone" / name).read_bytes(), (self.work / "plan" / name).read_bytes())
        text = self.hedgehop(*self.plan_arguments("--alternatives", "--overwrite")).stdout
        self.assertRegex(text, r"(?m)^main +[\d.]+ km .* (NOT )?verified$")
        self.assert_refused(self.plan_arguments("--alternatives", "--dem-error-m", "2", "--violation-probability", "0.1",
                                                "--overwrite"), 2, ["--violation-probability"])
        self.assert_refused(self.plan_arguments("--alternatives-config", more, "--overwrite"), 2, ["--alternatives"])

    def test_report_replaces_nothing_unasked_and_keeps_figures(self):
        shutil.copytree(self.plan, self.work / "plan")
        report, figures = self.work / "plan" / "report.html", self.work / "plan" / "figures"
        figures.mkdir()
        (figures / "plan.gp").write_text("mine")
        result = self.hedgehop("report", self.work / "plan", "--map", self.map)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("left as they are", result.stderr)
        self.assertEqual((figures / "plan.gp").read_text(), "mine")
        first = report.read_bytes()
        result = self.hedgehop("report", self.work / "plan", "--map", self.map)
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertRegex(result.stderr, "(?m)^error: output file .*report.html exists already$")
        self.assertEqual(report.read_bytes(), first)
        result = self.hedgehop("report", self.work / "plan", "--map", self.map, "--overwrite")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(report.read_bytes(), first)  # same plan, same bytes
        self.assertNotEqual((figures / "plan.gp").read_text(), "mine")

    def test_report_of_observers_and_another_plan(self):
        observers = self.work / "observers.yaml"
        observers.write_text("observers:\n  - {name: tower <x>, latitude_deg: 49.54, longitude_deg: 11.45, mast_height_m: 200, range_m: 9000}\n")
        self.one_object("prepare", "--dem", self.hgt, "--bbox", BBOX, "--cell-m", CELL_M, "--observers", observers, "--out", self.work / "map")
        arguments = ["plan", "--map", self.work / "map", "--start", START, "--goal", GOAL, "--work", WORK]
        self.one_object(*arguments, "--out", self.work / "plan", allowed=(0, 4))
        self.one_object(*arguments, "--set", "weights.visibility=0", "--out", self.work / "other", allowed=(0, 4))
        self.one_object("report", self.work / "plan", "--map", self.work / "map", "--compare", self.work / "other", "--no-figures",
                        "--out", self.work / "page.html", "--set", "legs.tolerance_m=30")
        page = (self.work / "page.html").read_text()
        self.assertRegex(page, r'<table id="exposure-table">[\s\S]*tower &lt;x&gt;</td><td>[0-9.]+ s</td>')
        self.assertRegex(page, r'<table id="alternative-table">[\s\S]*/other</td>')
        self.assertFalse((self.work / "plan" / "figures").exists())
        result = self.hedgehop("report", self.plan, "--map", self.work / "map", "--out", self.work / "none.html")
        self.assertEqual(result.returncode, 2)
        self.assertIn("was made on map", result.stderr)
        self.assertFalse((self.work / "none.html").exists())
        for wrong, code in ((["--start-time", "noon"], 2), (["--set", "legs.tolerance_m=0"], 2), (["--declination-deg", "200"], 2)):
            self.assertEqual(self.hedgehop("report", self.work / "plan", "--map", self.work / "map", "--no-figures", "--out",
                                           self.work / "none.html", *wrong).returncode, code, wrong)

    def test_export(self):
        found = self.one_object("export", self.plan, "--map", self.map, "--format", "kml,kmz,geojson,gpkg,gpx,csv,qgc",
                                "--format", "waypoints,czml,mcap", "--start-time", "2026-05-01T06:30Z", "--out", self.work / "out")
        self.assertEqual([(file["format"], pathlib.Path(file["file"]).name) for file in found["files"]],
                         [(name, "flight." + suffix) for name, suffix in
                          (("kml", "kml"), ("kmz", "kmz"), ("geojson", "geojson"), ("gpkg", "gpkg"), ("gpx", "gpx"), ("csv", "csv"),
                           ("qgc", "plan"), ("waypoints", "waypoints"), ("czml", "czml"), ("mcap", "mcap"))])
        for file in found["files"]:
            self.assertEqual(pathlib.Path(file["file"]).stat().st_size, file["bytes"])
            self.assertEqual("legs" in file, file["format"] in ("qgc", "waypoints"))
        legs = found["files"][6]["legs"]
        self.assertGreaterEqual(legs["clearance_min_m"], legs["clearance_demanded_m"])
        self.assertEqual(legs["clearance_demanded_m"], 10.0)  # required_clearance_m of the config
        mission = json.loads((self.work / "out" / "flight.plan").read_text())["mission"]
        self.assertEqual(sum(item["command"] == 16 for item in mission["items"]), legs["waypoints"])
        self.assertEqual(sorted(path.name for path in self.work.iterdir()), ["out"])
        # the file of a single format may be named itself, and says what was written
        result = self.hedgehop("export", self.plan, "--format", "gpx", "--out", self.work / "mine.gpx")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("EGM96", result.stdout)
        self.assertTrue((self.work / "mine.gpx").read_text().startswith("<?xml"))

    def test_verify_of_exported_legs(self):
        # so near to what was flown that simplification alone does not hold it
        wanted_m = json.loads((self.plan / "plan.json").read_text())["verification"]["clearance_min_m"] - 0.3
        exported = self.one_object("export", self.plan, "--map", self.map, "--format", "qgc,waypoints", "--clearance-m", wanted_m,
                                   "--set", "legs.vertical_tolerance_m=8", "--out", self.work / "out")
        for file in exported["files"]:
            self.assertGreater(file["legs"]["added_waypoints"], 0)
            self.assertGreaterEqual(file["legs"]["clearance_min_m"], wanted_m)
            found = self.one_object("verify", file["file"], "--map", self.map)
            self.assertTrue(found["is_verified"])
            self.assertEqual(found["waypoints"], file["legs"]["waypoints"])
            # two programs for the same lines; files hold places to 1e-9 degrees and heights to 1 mm
            self.assertAlmostEqual(found["clearance_min_m"], file["legs"]["clearance_min_m"], delta=0.01)
            tight = self.one_object("verify", file["file"], "--map", self.map, "--clearance-m",
                                    str(file["legs"]["clearance_min_m"] + 0.1), allowed=(4,))
            self.assertEqual({entry["rule"] for entry in tight["violations"]} & {"clearance"}, {"clearance"})
        text = (self.work / "out" / "flight.waypoints").read_text().splitlines()
        lowered = text[:]
        cells = lowered[len(text) // 2].split("\t")
        self.assertEqual(cells[3], "16")
        cells[10] = str(float(cells[10]) - 200.0)
        lowered[len(text) // 2] = "\t".join(cells)
        (self.work / "lowered.waypoints").write_text("\n".join(lowered) + "\n")
        found = self.one_object("verify", self.work / "lowered.waypoints", "--map", self.map, allowed=(4,))
        self.assertIn("clearance", {entry["rule"] for entry in found["violations"]})
        relative = [line.replace("\t0\t16\t", "\t3\t16\t") for line in text]
        (self.work / "relative.waypoints").write_text("\n".join(relative) + "\n")
        for name, words in (("relative.waypoints", "frame 3"), ("cut.waypoints", "12 numbers"), ("cut.plan", "QGroundControl")):
            if name == "cut.waypoints":
                (self.work / name).write_text("\n".join(text)[:-20])
            if name == "cut.plan":
                (self.work / name).write_text((self.work / "out" / "flight.plan").read_text()[:-40])
            result = self.hedgehop("verify", self.work / name, "--map", self.map)
            self.assertEqual(result.returncode, 5, result.stderr)
            self.assertIn(words, result.stderr)

    def test_export_of_a_recording_that_another_reader_accepts(self):
        self.one_object("export", self.plan, "--format", "mcap", "--start-time", "2026-05-01T06:30Z", "--out", self.work / "f.mcap")
        data = (self.work / "f.mcap").read_bytes()
        found = mcap_reader.read(data)
        self.assertGreaterEqual(found["chunks"], 2)
        topics = {channel["topic"]: number for number, channel in found["channels"].items()}
        self.assertEqual(sorted(topics), ["/flight/location", "/flight/route", "/flight/state"])
        names = {topic: found["schemas"][found["channels"][number]["schema"]] for topic, number in topics.items()}
        self.assertEqual(names["/flight/location"]["name"], "foxglove.LocationFix")
        self.assertEqual(names["/flight/route"]["name"], "foxglove.GeoJSON")
        by_topic = {topic: [message for message in found["messages"] if message["channel"] == number]
                    for topic, number in topics.items()}
        lines = (self.plan / "trajectory.csv").read_text().splitlines()
        columns = lines[0].split(",")
        states = by_topic["/flight/state"]
        self.assertEqual(len(states), len(lines) - 1)
        start_ns = 1777617000 * 10**9  # 2026-05-01T06:30Z
        properties = json.loads(names["/flight/state"]["data"])["properties"]
        self.assertEqual(list(properties), columns)
        for i in (0, 1, len(states) // 2, len(states) - 1):
            values, wanted = json.loads(states[i]["data"]), dict(zip(columns, map(float, lines[i + 1].split(","))))
            self.assertEqual(states[i]["sequence"], i)
            self.assertEqual(states[i]["log_time"], start_ns + round(wanted["time_s"] * 1e9))
            for name in columns:
                self.assertAlmostEqual(values[name], wanted[name], delta=5.1e-9, msg=name)  # half of the last of eight places
        location = json.loads(by_topic["/flight/location"][61]["data"])
        self.assertEqual(location["timestamp"], {"sec": 1777617061, "nsec": 0})
        state = json.loads(states[20 * 61]["data"])
        self.assertEqual((location["latitude"], location["longitude"]), (state["latitude_deg"], state["longitude_deg"]))
        # the geoid lies 46 to 48 m above the ellipsoid there
        self.assertAlmostEqual(location["altitude"] - state["altitude_m"], 47.0, delta=1.5)
        route = json.loads(json.loads(by_topic["/flight/route"][0]["data"])["geojson"])
        self.assertEqual(len(route["geometry"]["coordinates"]),
                         len(json.loads((self.plan / "plan.json").read_text())["route"]["waypoints"]))
        self.assertIn(found["metadata"]["hedgehop"]["is_verified"], ("true", "false"))
        # and the reader does find faults
        for at in (100, len(data) // 2, len(data) - 60):
            damaged = bytearray(data)
            damaged[at] ^= 1
            with self.assertRaises((ValueError, KeyError, OverflowError)):
                mcap_reader.read(bytes(damaged))

    def test_config(self):
        shipped = self.one_object("config", "list")["shipped"]
        self.assertIn("planning.yaml", shipped)
        self.assertIn("speed_mps: 33", self.one_object("config", "show", "--set", "speed_mps=33")["config"])

    def test_evaluate_random(self):
        area = self.work / "area"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.2,49.4,11.5,49.6", "--cell-m", "90", "--out", area)
        self.assertEqual(result.returncode, 0, result.stderr)
        found = self.one_object("evaluate", "random", "--map", area, "--problems", "1", "--seed", "5",
                                "--set", "global.work_budget=60000")
        self.assertEqual(found["drawn"], 1)
        self.assertEqual(sum(found[kind] for kind in ("verified", "not_verified", "named_cause", "not_found", "errors")), 1)
        self.assertEqual(found["seed"], 5)
        self.assertGreaterEqual(found["problems"][0]["distance_m"], 8000.0)

    def test_evaluate_table2_local_safety_and_reaction(self):
        area = self.work / "area"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.2,49.4,11.5,49.6", "--cell-m", "90", "--out", area)
        self.assertEqual(result.returncode, 0, result.stderr)
        common = ["--map", area, "--seed", "5", "--routes", self.work / "routes", "--set", "global.work_budget=60000"]
        table = self.one_object("evaluate", "table2", "--runs", "1", *common)
        self.assertEqual([c["name"] for c in table["comparisons"]], ["optimised", "lateral"])
        for comparison in table["comparisons"]:
            self.assertEqual(comparison["pairs"], 1)
            self.assertEqual(comparison["regressions"], 0)
            self.assertGreater(comparison["length"]["baseline_sum"], 9900.0)  # drawn at least 10 km apart
        kept = sorted((self.work / "routes").rglob("*.json"))
        self.assertGreaterEqual(len(kept), 1)
        times = [file.stat().st_mtime_ns for file in kept]
        safety = self.one_object("evaluate", "local-safety", "--flights", "1", *common)
        self.assertEqual([file.stat().st_mtime_ns for file in kept], times, "the same routes, not planned again")
        self.assertEqual([(row["planner"], row["towers"]) for row in safety["rows"]],
                         [(planner, towers) for towers in (False, True)
                          for planner in ("tvfh", "rollout", "vfh_3d", "shipped")])
        for row in safety["rows"]:
            self.assertEqual((row["flights"], row["seed"]), (1, 5))
            self.assertLessEqual(row["collisions"], row["reached"])
        self.assertLess(safety["rows"][3]["mean_height_m"], safety["rows"][0]["mean_height_m"])
        alone = self.one_object("evaluate", "local-safety", "--flights", "1", "--planner", "rollout", *common)
        self.assertEqual(alone["rows"], [row for row in safety["rows"] if row["planner"] == "rollout"])
        refused = self.hedgehop("evaluate", "local-safety", "--flights", "1", "--planner", "nobody", *common)
        self.assertEqual(refused.returncode, 2)
        self.assertIn("'nobody'", refused.stderr)
        reaction = self.one_object("evaluate", "reaction", "--events", "6", *common)
        self.assertEqual([kind["kind"] for kind in reaction["kinds"]], ["obstacle", "threat", "area"])
        self.assertEqual([kind["events"] for kind in reaction["kinds"]], [2, 2, 2])
        for kind in reaction["kinds"]:
            self.assertEqual(sum(kind["reactions"].values()), 2)
            self.assertLessEqual(kind["heading_step_max_deg"], reaction["heading_step_limit_deg"] + 1e-6)
            self.assertEqual(kind["unsafe"], sum(not row["safe"] for row in reaction["rows"] if row["kind"] == kind["kind"]))

    def test_tune(self):
        area = self.work / "area"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.2,49.4,11.5,49.6", "--cell-m", "90", "--out", area)
        self.assertEqual(result.returncode, 0, result.stderr)
        tuned = self.work / "tuned.yaml"
        mine = self.work / "mine.yaml"
        mine.write_text("parameters:\n  - {key: local.weights.visibility, mode: any, low: 0.1, high: 6.4, logarithmic: true}\n")
        arguments = ["tune", "--map", area, "--seed", "5", "--flights", "2", "--held-out", "1", "--evaluations", "4",
                     "--parameter", "local.look_ahead_m=150:900:log", "--parameters", mine,
                     "--routes", self.work / "routes", "--set", "global.work_budget=60000", "--out", tuned]
        found = self.one_object(*arguments)
        self.assertEqual(found["evaluations"], 4)
        self.assertEqual([p["key"] for p in found["parameters"]], ["local.weights.visibility", "local.look_ahead_m"])
        self.assertEqual([p["given"] for p in found["parameters"]], [0.8, 300.0])
        for name, flights in (("training", 2), ("held_out", 1)):
            self.assertEqual(found[name]["given"]["flights"], flights)
            self.assertEqual(found[name]["tuned"]["flights"], flights)
            self.assertEqual(len(found[name]["flight_cost_by_map"]), 1)
        self.assertLessEqual(found["training"]["flight_cost"]["change"], 0.0)
        self.assertIs(found["is_better"], found["verdict"].startswith("take"))
        text = tuned.read_text()
        self.assertIn("# " + found["verdict"], text)
        # What was found is a configuration as it stands.
        origin = self.hedgehop("config", "show", "--origin", "--config", tuned).stdout
        for parameter in found["parameters"]:
            value = re.escape(format(parameter["tuned"], ".10g"))
            self.assertRegex(origin, rf"(?m)^{re.escape(parameter['key'])} +{value} .*tuned.yaml:\d+$")
        plan = self.one_object(*self.plan_arguments("--config", tuned), allowed=(0, 4))
        self.assertEqual(plan["schema"], "hedgehop plan result")
        # Other threads, and routes that are kept, change nothing.
        again = self.one_object(*arguments, "--threads", "1")
        self.assertEqual(again, found)
        self.assertEqual(tuned.read_text(), text)
        shown = self.hedgehop(*arguments[:-2], "--out", self.work / "other.yaml").stdout
        self.assertIn(found["verdict"], shown)

        def refused(message, *more):
            result = self.hedgehop("tune", "--map", area, "--seed", "5", "--flights", "1", "--held-out", "1", *more, "--out", self.work / "no.yaml")
            self.assertEqual(result.returncode, 2, result.stderr)
            self.assertRegex(result.stderr, message)
            self.assertFalse((self.work / "no.yaml").exists())
        refused("'local.look_ahead_m=9' is no parameter to tune", "--parameter", "local.look_ahead_m=9")
        refused("'local.window_m' is to be tuned twice", "--parameter", "local.window_m=300:600", "--parameter", "local.window_m=300:500")
        refused(r"mine.yaml:2: missing key 'parameters\[0\].low'", "--parameters", self.misspelt(mine))

    def misspelt(self, file):
        file.write_text(file.read_text().replace("low:", "middle:"))
        return file

    def test_plan_within_a_risk(self):
        errors = ("--dem-error-m", "3", "--error-seed", "7")
        plan = self.one_object(*self.plan_arguments("--violation-probability", "0.1", *errors), allowed=(0, 4))
        self.assertRegex(plan["warnings"][-1], "heights raised by .* probability")
        risk = self.one_object("verify", self.work / "plan", "--map", self.map, "--dem-error-m", "3", "--error-seed", "99",
                               allowed=(0, 4))["uncertainty"]
        if "at most the wanted" in plan["warnings"][-1]:
            self.assertLess(risk["probability"], 0.15)  # 0.1 and five standard deviations of 1000 draws
        refused = self.hedgehop(*self.plan_arguments(*errors, "--overwrite"))
        self.assertEqual(refused.returncode, 2)
        self.assertIn("--violation-probability", refused.stderr)

    def test_evaluate_flight(self):
        found = self.one_object("evaluate", "flight", "--map", self.map, "--plans", "1", "--seed", "5")
        self.assertEqual(found["plans"], 1)
        rows = {(row["plant"], row["feed_forward"], row["wind"]): row for row in found["rows"]}
        self.assertEqual(len(rows), 8)
        for plant in ("closed_loop", "rotor"):
            for feed_forward in (True, False):
                self.assertEqual(rows[plant, feed_forward, False]["within_margins"], 1, rows)
        self.assertIsNone(rows["closed_loop", True, True]["torque_margin_min"])
        self.assertLess(rows["rotor", True, True]["power_share_max"], 1.06)
        self.assertFalse(any(row["turbulence"] for row in found["rows"]))

    def test_evaluate_verifier(self):
        found = self.one_object("evaluate", "verifier", "--map", self.map, "--plans", "2", "--seed", "5")
        self.assertEqual(found["seed"], 5)
        self.assertEqual(found["plans"] + found["no_plan"], 2)
        self.assertEqual(found["judgements"], 2 * found["plans"])
        self.assertEqual(found["false_alarms"], found["false_alarms_between_samples"])
        self.assertEqual(found["accepted_wrongly"], 0)

    def test_evaluate_optimality(self):
        area = self.work / "area"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.2,49.4,11.5,49.6", "--cell-m", "90", "--out", area)
        self.assertEqual(result.returncode, 0, result.stderr)
        arguments = ("evaluate", "optimality", "--map", area, "--problems", "2", "--budgets", "0.2,0.1", "--distance", "8000",
                     "--polish-s", "0.2", "--seed", "5")
        found = self.one_object(*arguments)
        self.assertEqual([(row["planner"], row["budget_s"]) for row in found["rows"]],
                         [(planner, budget) for planner in ("recommended", "bitstar", "ompl_bitstar") for budget in (0.1, 0.2)])
        self.assertEqual(found["seed"], 5)
        self.assertRegex(found["map_hash"], "^[0-9a-f]{32}$")
        for row in found["rows"]:
            self.assertTrue(0.0 <= row["success"] <= 1.0)
            if row["solved"]:
                # nothing is cheaper than the best known route, and that not than the bound
                self.assertGreaterEqual(row["cost_over_best_median"], 1.0)
                self.assertGreaterEqual(row["cost_over_bound_median"], row["cost_over_best_median"])
        for problem in found["problems"]:
            self.assertGreaterEqual(problem["distance_m"], 8000.0)
            if problem["best_known_m"] is not None:
                self.assertGreaterEqual(problem["best_known_m"], problem["lower_bound_m"])
        result = self.hedgehop(*arguments, "--planners", "recommended,best_ever")
        self.assertEqual(result.returncode, 2)
        self.assertIn("best_ever", result.stderr)
        self.assertIn("ompl_abitstar", result.stderr)

    def test_evaluate_replanning(self):
        found = self.one_object("evaluate", "replanning", "--map", self.map, "--events", "3", "--distance", "5000", "--seed", "5")
        self.assertEqual((found["seed"], found["events"], len(found["rows"])), (5, 3, 3))
        self.assertEqual(found["valid"], sum(row["is_valid"] for row in found["rows"]))
        for row in found["rows"]:
            self.assertTrue(row["is_valid"])
            self.assertEqual(row["claimed_cost_m"], row["cost_m"])
            self.assertLessEqual(row["polished_m"], row["cost_m"])
        self.assertLessEqual(found["warm_s"]["median"], found["warm_s"]["max"])
        self.assertGreater(found["prepare_s"]["median"], 0.0)

    def test_evaluate_local_speed(self):
        found = self.one_object("evaluate", "local-speed", "--repeats", "1", "--reference-repeats", "1", "--length", "2000")
        table = [row for row in found["rows"] if row["planner"] == "tvfh" and row["paper_ms_per_km"] is not None]
        self.assertEqual(len(table), 28)
        self.assertEqual([row["cell_m"] for row in found["rows"] if row["planner"] == "rollout"], [30.0, 10.0, 5.0])
        for row in found["rows"]:
            self.assertTrue(row["same_bytes"], row)
            self.assertLess(row["ms_per_km"], row["reference_ms_per_km"])

    def test_evaluate_protection(self):
        found = self.one_object("evaluate", "protection", "--map", self.map, "--cells", "4", "--seed", "7")
        self.assertGreater(found["cpu_s_per_million_cells"], 0.0)
        self.assertGreaterEqual(found["threads"], 1)
        self.assertEqual(found["error"]["cells"], 4)
        self.assertLess(found["error"]["mean_abs"], 0.01)
        self.assertGreater(found["gdal"]["cpu_s_per_million_cells"], found["cpu_s_per_million_cells"])
        self.assertTrue(found["update"]["same_bytes"])
        self.assertEqual([h["height_m"] for h in found["exposure"]["heights"]], [30.0, 60.0, 100.0, 150.0])
        result = self.hedgehop("evaluate", "protection", "--map", self.map, "--cells", "4", "--seed", "7", "--simd", "avx2", "--json")
        if result.returncode == 0:
            forced = json.loads(result.stdout)
            self.assertEqual(forced["simd"], "avx2")
            self.assertEqual(forced["error"], found["error"])  # same bytes
        else:
            self.assertIn("--simd", result.stderr)

    def test_info(self):
        found = self.one_object("info", self.map, schema_version=2)  # that of the map
        self.assertRegex(found["map_hash"], "^[0-9a-f]{32}$")
        self.one_object("info", self.map, "--at", START)

    def test_roadmap(self):
        shutil.copytree(self.map, self.work / "map")
        made = self.one_object("roadmap", self.work / "map")
        self.assertTrue(made["is_built"])
        self.assertEqual(made["file"], str(self.work / "map.roadmap"))
        self.assertEqual(made["bytes"], (self.work / "map.roadmap").stat().st_size)
        self.assertGreater(made["columns"] * made["rows"], 100)
        self.assertFalse(self.one_object("roadmap", self.work / "map")["is_built"])
        plan = ["plan", "--map", self.work / "map", "--start", START, "--goal", GOAL, "--work", WORK, "--set", "global.planner=roadmap"]
        results = []
        for out in ("read", "made"):
            result = self.hedgehop(*plan, "--out", self.work / out)
            self.assertIn(result.returncode, (0, 4), result.stderr)
            results.append(result.stderr)
            # damaged: made anew, with a word about it
            (self.work / "map.roadmap").write_bytes((self.work / "map.roadmap").read_bytes()[:-3] + b"abc")
        self.assertNotIn("roadmap made", results[0])
        self.assertRegex(results[1], "roadmap made: .*map.roadmap is not used: it is damaged")
        self.assertEqual((self.work / "read" / "route.geojson").read_bytes(), (self.work / "made" / "route.geojson").read_bytes())

    def test_doctor(self):
        found = self.one_object("doctor", allowed=(0, 1))
        self.assertIn("is_fit", found)

    def test_progress_and_remarks_stay_off_stdout(self):
        result = self.hedgehop(*self.prepare(self.hgt))
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertNotIn("%", result.stdout)
        self.assertIn("%", result.stderr)
        shutil.rmtree(self.work / "map")
        self.assertEqual(self.hedgehop(*self.prepare(self.hgt, "--quiet")).stderr, "")


class SameBytes(CliTest):
    def compare(self, one, other):
        names = sorted(path.name for path in one.iterdir())
        self.assertEqual(names, sorted(path.name for path in other.iterdir()))
        for name in names:
            if name != "timings.json":
                self.assertEqual((one / name).read_bytes(), (other / name).read_bytes(), name)

    def test_zipped_and_plain_elevation_and_any_thread_count_give_the_same_map_layers(self):
        for out, dem, threads in (("one", self.hgt, "1"), ("two", INPUTS / "N49E011.hgt.zip", "3")):
            result = self.hedgehop(*self.prepare(dem, "--osm", self.osm, "--threads", threads, out=out))
            self.assertEqual(result.returncode, 0, result.stderr)
        for name in ("terrain.tif", "surface.tif", "semantics.tif", "visibility.tif", "features.gpkg"):
            self.assertEqual((self.work / "one" / name).read_bytes(), (self.work / "two" / name).read_bytes(), name)

    def test_land_use_in_each_packing_gives_the_same_map_layers(self):
        packed = []
        for suffix in ("osm", "osm.gz", "osm.bz2"):
            path = self.work / ("land." + suffix)
            inputs.write_osm(path, inputs.land_use())
            packed.append((suffix.replace(".", "_"), path))
        for out, osm in packed:
            result = self.hedgehop(*self.prepare(self.hgt, "--osm", osm, out=out))
            self.assertEqual(result.returncode, 0, result.stderr)
        for out, _ in packed[1:]:
            for name in ("surface.tif", "semantics.tif", "features.gpkg"):
                self.assertEqual((self.work / out / name).read_bytes(), (self.work / "osm" / name).read_bytes(), name)

    def test_plan_with_any_thread_count(self):
        for out, threads in (("one", "1"), ("two", "3")):
            result = self.hedgehop("plan", "--map", self.map, "--start", START, "--goal", GOAL, "--work", WORK,
                                   "--threads", threads, "--out", self.work / out)
            self.assertIn(result.returncode, (0, 4), result.stderr)
        self.compare(self.work / "one", self.work / "two")


class Missions(CliTest):
    """A mission file asks for what the options ask for."""

    def planned(self, out, *arguments):
        result = self.hedgehop("plan", "--map", self.map, *arguments, "--work", WORK, "--out", self.work / out)
        self.assertIn(result.returncode, (0, 4), result.stderr)
        return self.work / out

    def write(self, name, text):
        (self.work / name).write_text(text)
        return self.work / name

    def test_shipped_example_is_planned(self):
        region = self.work / "region"
        result = self.hedgehop("prepare", "--dem", self.hgt, "--bbox", "11.40,49.90,11.60,50.00", "--cell-m", "90", "--out", region)
        self.assertEqual(result.returncode, 0, result.stderr)
        result = self.hedgehop("plan", "--map", region, "--mission", ROOT / "docs" / "examples" / "mission.yaml", "--work", WORK,
                               "--out", self.work / "plan")
        self.assertIn(result.returncode, (0, 4), result.stderr)
        request = json.loads((self.work / "plan" / "plan.json").read_text())["request"]
        self.assertEqual((request["start"]["height_m"], len(request["via"]), request["speed_mps"]), (20, 2, 35))
        self.assertAlmostEqual(request["start_heading_true_rad"], 1.3962634015954636)

    def test_yaml_gives_the_bytes_of_the_options(self):
        mission = self.write("m.yaml", "start: {latitude_deg: 49.51, longitude_deg: 11.42, height_m: 30}\n"
                                       "via:\n  - {latitude_deg: 49.55, longitude_deg: 11.45}\n"
                                       "goal: {latitude_deg: 49.57, longitude_deg: 11.50}\nspeed_mps: 35\n")
        one = self.planned("one", "--mission", mission)
        two = self.planned("two", "--start", START + ",30", "--via", "49.55,11.45", "--goal", GOAL, "--speed-mps", "35")
        for name in ("plan.json", "trajectory.csv"):
            self.assertEqual((one / name).read_bytes(), (two / name).read_bytes(), name)

    def start_altitude(self, out, mission):
        return json.loads((self.planned(out, "--mission", mission) / "plan.json").read_text())["route"]["start"]["altitude_m"]

    def test_heights_count_from_what_the_file_says(self):
        at = json.loads(self.hedgehop("info", self.map, "--at", START, "--json").stdout)
        wanted = at["surface_m"] + 45.0

        def kml(mode, height):
            return ('<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><Point><altitudeMode>%s</altitudeMode>'
                    "<coordinates>%g,%g,%r</coordinates></Point></Placemark><Placemark><Point><coordinates>%g,%g</coordinates>"
                    "</Point></Placemark></Document></kml>" % (mode, inputs.START[1], inputs.START[0], height, inputs.GOAL[1],
                                                               inputs.GOAL[0]))
        self.assertAlmostEqual(self.start_altitude("sea", self.write("sea.kml", kml("absolute", wanted))), wanted, places=3)
        ground = self.start_altitude("ground", self.write("ground.kml", kml("relativeToGround", 45.0)))
        states = (self.work / "ground" / "trajectory.csv").read_text().splitlines()
        terrain = float(dict(zip(states[0].split(","), states[1].split(",")))["terrain_m"])
        self.assertAlmostEqual(ground, terrain + 45.0, places=2)
        # the geoid lies 46 to 48 m above the ellipsoid there
        line = {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": [
            [inputs.START[1], inputs.START[0], wanted + 47.0], [inputs.GOAL[1], inputs.GOAL[0]]]}}
        above = self.start_altitude("ellipsoid", self.write("e.geojson", json.dumps(line)))
        self.assertAlmostEqual(above, wanted, delta=1.5)
        self.assertNotEqual(above, wanted)
        # or from nothing
        ignored = self.planned("ignored", "--mission", self.work / "sea.kml", "--ignore-heights")
        self.assertIsNone(json.loads((ignored / "plan.json").read_text())["request"]["start"]["height_m"])

    def test_gpx_and_plans_of_ground_stations_are_flown(self):
        gpx = self.write("m.gpx", '<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><rte>'
                                  '<rtept lat="%g" lon="%g"/><rtept lat="%g" lon="%g"/></rte></gpx>' % (*inputs.START, *inputs.GOAL))
        plain = self.planned("plain", "--start", START, "--goal", GOAL)
        self.assertEqual((self.planned("gpx", "--mission", gpx) / "trajectory.csv").read_bytes(),
                         (plain / "trajectory.csv").read_bytes())
        item = {"type": "SimpleItem", "autoContinue": True, "frame": 10}
        plan = self.write("m.plan", json.dumps({"fileType": "Plan", "version": 1, "mission": {"version": 2, "items": [
            {**item, "command": 22, "params": [0, 0, 0, None, *inputs.START, 40]},
            {**item, "command": 16, "params": [0, 0, 0, None, *inputs.GOAL, 40]}]}}))
        result = self.hedgehop("plan", "--map", self.map, "--mission", plan, "--work", WORK, "--out", self.work / "qgc")
        self.assertIn(result.returncode, (0, 4), result.stderr)
        self.assertIn("note: ", result.stderr)
        self.assertIn("take-off", result.stderr)


    def test_areas_of_a_mission_are_flown_around_and_stay_with_the_plan(self):
        free = self.planned("free", "--start", START, "--goal", GOAL)
        track = json.loads((free / "route.geojson").read_text())["features"][1]["geometry"]["coordinates"]
        east, north = track[len(track) // 2][:2]
        square = [[east + dx, north + dy] for dx, dy in ((-.006, -.004), (.006, -.004), (.006, .004), (-.006, .004), (-.006, -.004))]
        feature = {"type": "Feature", "properties": {"name": "fair"}, "geometry": {"type": "Polygon", "coordinates": [square]}}
        (self.work / "today.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        mission = self.write("m.yaml", "start: {latitude_deg: 49.51, longitude_deg: 11.42}\n"
                                       "goal: {latitude_deg: 49.57, longitude_deg: 11.50}\nareas: [today.geojson]\n")
        plan = self.planned("around", "--mission", mission)
        found = json.loads((plan / "plan.json").read_text())
        self.assertNotEqual(found["map"]["hash"], json.loads((free / "plan.json").read_text())["map"]["hash"])
        self.assertEqual([area["name"] for area in found["request"]["areas"]], ["fair"])
        for longitude, latitude, *_ in json.loads((plan / "route.geojson").read_text())["features"][1]["geometry"]["coordinates"]:
            self.assertFalse(abs(longitude - east) < .006 and abs(latitude - north) < .004, (longitude, latitude))
        verdict = self.hedgehop("verify", plan, "--map", self.map, "--json")
        self.assertIn(verdict.returncode, (0, 4), verdict.stderr)
        self.assertNotIn("no_fly_area", verdict.stdout.split('"margins"')[0])
        self.assertEqual(self.hedgehop("report", plan, "--map", self.map, "--no-figures").returncode, 0)
        self.assertEqual(self.hedgehop("export", plan, "--map", self.map, "--format", "qgc", "--out", self.work / "files").returncode, 0)
        # The same flight as one of a ground station that must not leave its fence.
        item = {"type": "SimpleItem", "autoContinue": True, "frame": 10, "command": 16}
        corners = [[49.45, 11.35], [49.45, 11.6], [49.65, 11.6], [49.65, 11.35]]
        qgc = {"fileType": "Plan", "version": 1, "mission": {"version": 2, "items": [
            {**item, "params": [0, 0, 0, None, *inputs.START, 40]}, {**item, "params": [0, 0, 0, None, *inputs.GOAL, 40]}]},
            "geoFence": {"version": 2, "circles": [], "polygons": [{"inclusion": True, "version": 1, "polygon": corners}]}}
        self.planned("fenced", "--mission", self.write("fenced.plan", json.dumps(qgc)))
        # An area around the goal is named; another file is not taken for the one that was planned with.
        corners[0] = corners[1] = [49.5, 11.45]
        qgc["geoFence"]["polygons"][0]["polygon"] = [[49.5, 11.4], [49.5, 11.45], [49.53, 11.45], [49.53, 11.4]]
        result = self.hedgehop("plan", "--map", self.map, "--mission", self.write("outside.plan", json.dumps(qgc)), "--out",
                               self.work / "outside")
        self.assertEqual(result.returncode, 3, result.stderr)
        self.assertIn("goal_inside_area", result.stderr)
        text = (plan / "plan.json").read_text()
        (plan / "plan.json").write_text(text.replace('"name": "fair"', '"name": "fare"'))
        result = self.hedgehop("verify", plan, "--map", self.map)
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertIn("with the areas of the plan", result.stderr)
        (plan / "plan.json").write_text(text)
        result = self.hedgehop("request", "--mission", mission, "--out", self.work / "bus")
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertIn("patch add area", result.stderr)

    def test_heading_at_the_goal_is_arrived_with_from_whatever_side(self):
        for wanted in (90, 270):  # the flight comes from the south-west
            mission = self.write(f"m{wanted}.yaml", "start: {latitude_deg: 49.51, longitude_deg: 11.42}\n"
                                 f"goal: {{latitude_deg: 49.57, longitude_deg: 11.50, heading_true_deg: {wanted}}}\n")
            lines = (self.planned(f"to{wanted}", "--mission", mission) / "trajectory.csv").read_text().splitlines()
            last = dict(zip(lines[0].split(","), lines[-1].split(",")))
            off = (math.degrees(float(last["heading_true_rad"])) - wanted + 180) % 360 - 180
            self.assertLess(abs(off), 25, last)

    def test_times_fix_departure_and_speed(self):
        ends = ("--start", START, "--goal", GOAL)
        result = self.hedgehop("plan", "--map", self.map, *ends, "--work", WORK, "--out", self.work / "one", "--arrival",
                               "2026-05-01T08:30:00+02:00", "--json")
        self.assertIn(result.returncode, (0, 4), result.stderr)
        one = json.loads(result.stdout)
        self.assertEqual(one["arrival"], "2026-05-01T06:30:00.000Z")
        self.assertIs(one["is_on_time"], True)
        took = one["duration_s"]
        minutes, seconds = divmod(1800 - took, 60)
        self.assertTrue(one["departure"].startswith("2026-05-01T06:%02d:%02d" % (minutes, seconds)), one["departure"])
        self.assertEqual(self.hedgehop("verify", self.work / "one", "--map", self.map).returncode, result.returncode)
        # 10 % less time: faster, within 5 s
        arrival = "2026-05-01T06:%02d:%02dZ" % divmod(round(.9 * took), 60)
        times = ("--departure", "2026-05-01T06:00Z", "--arrival", arrival)
        result = self.hedgehop("plan", "--map", self.map, *ends, "--work", WORK, "--out", self.work / "two", *times, "--json")
        self.assertIn(result.returncode, (0, 4), result.stderr)
        two = json.loads(result.stdout)
        self.assertIs(two["is_on_time"], True)
        self.assertAlmostEqual(two["duration_s"], .9 * took, delta=5.6)
        self.assertGreater(json.loads((self.work / "two" / "plan.json").read_text())["request"]["speed_mps"], 41)
        # exports and report count from the departure
        self.assertEqual(self.hedgehop("export", self.work / "two", "--format", "gpx", "--out", self.work / "files").returncode, 0)
        self.assertIn(two["departure"][:16], (self.work / "files" / "flight.gpx").read_text())
        self.assertEqual(self.hedgehop("report", self.work / "two", "--map", self.map, "--no-figures").returncode, 0)
        page = (self.work / "two" / "report.html").read_text()
        self.assertIn("<h3>Times</h3>", page)
        self.assertIn("Take-off at " + two["departure"][:19] + "Z", page)
        # no helicopter is that fast
        result = self.hedgehop("plan", "--map", self.map, *ends, "--work", WORK, "--out", self.work / "three", "--departure",
                               "2026-05-01T06:00Z", "--arrival", "2026-05-01T06:01Z", "--json")
        self.assertEqual(result.returncode, 4, result.stderr)
        self.assertIs(json.loads(result.stdout)["is_on_time"], False)
        self.assertIn("flies no faster", result.stderr)
        # what contradicts itself
        self.assert_refused(["plan", "--map", self.map, *ends, *times, "--speed-mps", "30", "--out", self.work / "four"], 2,
                            ["speed"], advice="leave out")
        self.assert_refused(["plan", "--map", self.map, *ends, "--arrival", "tomorrow", "--out", self.work / "four"], 2,
                            ["--arrival", "tomorrow"], advice="2026")


class OverTheBus(CliTest):
    """The services in a network of their own: the same plan as in one process, a log that replays."""

    def in_own_network(self, script, *arguments, timeout=150):
        result = subprocess.run([ROOT / "scripts" / "in-own-network", "sh", "-c", script, "sh", *map(str, arguments)],
                                capture_output=True, text=True, timeout=timeout, env=self.environment(), cwd=self.work)
        if result.returncode == 77:
            self.skipTest(result.stdout.strip().removeprefix("SKIPPED: "))
        return result

    def test_request_gives_the_bytes_of_plan_and_the_log_replays(self):
        request = ["--start", START, "--goal", GOAL, "--work", WORK]
        log = self.work / "flight.lcmlog"
        script = """
hedgehop=$1; map=$2; log=$3; shift 3
"$hedgehop" serve --map "$map" --log "$log" --json > serve.json 2> serve.txt & serve=$!
"$hedgehop" watch --json --duration-s 5 > watch.json 2> watch.txt & watch=$!
"$hedgehop" request "$@" --out over_the_bus --timeout-s 60 --json > request.json; request=$?
wait "$watch"; watch=$?
kill -TERM "$serve"; wait "$serve"; serve=$?
echo "$serve $request $watch"
"""
        result = self.in_own_network(script, HEDGEHOP, self.map, log, *request)
        told = result.stderr + (self.work / "serve.txt").read_text()
        serve, wanted, watch = map(int, result.stdout.split())
        self.assertEqual((serve, watch), (0, 0), told)
        self.assertIn(wanted, (0, 4), told)

        planned = self.hedgehop("plan", "--map", self.map, *request, "--out", self.work / "in_one_process", "--json")
        self.assertEqual(planned.returncode, wanted, planned.stderr)
        for name in ("plan.json", "route.geojson", "trajectory.csv"):
            self.assertEqual((self.work / "over_the_bus" / name).read_bytes(),
                             (self.work / "in_one_process" / name).read_bytes(), name)
        answer = json.loads((self.work / "request.json").read_text())
        self.assertEqual({**answer, "plan": ""}, {**json.loads(planned.stdout), "plan": ""})
        served = json.loads((self.work / "serve.json").read_text())
        self.assertEqual((served["schema"], served["schema_version"]), ("hedgehop serve", 1))
        lines = (self.work / "watch.json").read_text().splitlines()
        self.assertTrue(lines)
        for line in lines:
            self.assertEqual((json.loads(line)["schema"], json.loads(line)["schema_version"]), ("hedgehop watch", 1))
        self.assertEqual((answer["schema"], answer["schema_version"]), ("hedgehop plan result", 1))

        info = self.hedgehop("log", "info", log, "--json")
        self.assertEqual(info.returncode, 0, info.stderr)
        self.assertEqual(json.loads(info.stdout)["schema_version"], 1)
        for stage in ("global", "local"):
            replayed = self.hedgehop("replay", log, "--stage", stage, "--json")
            self.assertEqual(replayed.returncode, 0, replayed.stdout + replayed.stderr)
            self.assertEqual(json.loads(replayed.stdout)["result"], "equal")
        self.check_mending(log)

    def check_mending(self, log):
        """Taken apart, damaged, mended and joined again, the log replays as before."""
        blobs, rest, damaged, mended, whole = (self.work / f"{name}.lcmlog" for name in ("blobs", "rest", "damaged", "mended", "whole"))
        names = json.loads(self.hedgehop("log", "info", log, "--json").stdout)["channels"]
        self.assertIn("CHUNK", names)
        others = [argument for name in names if name != "CHUNK" for argument in ("--channel", name)]
        for out, channels in ((blobs, ["--channel", "CHUNK"]), (rest, others)):
            cut = self.hedgehop("log", "cut", log, *channels, "--out", out, "--json")
            self.assertEqual(cut.returncode, 0, cut.stderr)
        self.assertEqual(json.loads(self.hedgehop("log", "info", rest, "--json").stdout)["channels"],
                         {name: count for name, count in names.items() if name != "CHUNK"})
        damaged.write_bytes(b"no event of a log" + rest.read_bytes())
        check = self.hedgehop("log", "check", damaged, "--json")
        self.assertEqual(check.returncode, 5, check.stderr)
        self.assertEqual(json.loads(check.stdout)["damages"], [{"offset_bytes": 0, "bytes": 17, "is_at_end": False}])
        self.assertEqual(self.hedgehop("log", "repair", damaged, "--out", mended).returncode, 0)
        self.assertEqual(mended.read_bytes(), rest.read_bytes())
        self.assertEqual(self.hedgehop("log", "check", mended).returncode, 0)
        self.assertEqual(self.hedgehop("log", "repair", damaged, "--out", mended).returncode, 2)  # it exists
        joined = self.hedgehop("log", "cut", blobs, mended, "--out", whole)
        self.assertEqual(joined.returncode, 0, joined.stderr)
        replayed = self.hedgehop("replay", whole, "--stage", "local", "--json")
        self.assertEqual(replayed.returncode, 0, replayed.stdout + replayed.stderr)
        self.assertEqual(json.loads(replayed.stdout)["result"], "equal")

    def test_request_that_nobody_answers_says_so(self):
        script = '"$1" request --start "$2" --goal "$3" --out nowhere --timeout-s 1'
        result = self.in_own_network(script, HEDGEHOP, START, GOAL)
        self.assertEqual(result.returncode, 6, result.stderr)
        self.assertRegex(result.stderr, "(?m)^error: ")
        self.assertRegex(result.stderr, "(?m)^hint: ")
        self.assert_nothing_left()

    def test_request_without_a_multicast_route_says_so(self):
        script = 'ip link set lo down; "$1" request --start "$2" --goal "$3" --out nowhere --timeout-s 1'
        result = self.in_own_network(script, HEDGEHOP, START, GOAL)
        self.assertEqual(result.returncode, 6, result.stderr)
        self.assertRegex(result.stderr, "(?m)^error: ")
        self.assertRegex(result.stderr, "net-setup|route")
        self.assert_nothing_left()

    def test_log_and_replay_refuse_what_is_no_log(self):
        text = self.work / "notes.lcmlog"
        text.write_text("this is no log\n" * 100)
        for arguments in (["log", "info", text], ["replay", text, "--stage", "local"],
                          ["log", "info", self.work / "none.lcmlog"], ["replay", self.work / "none.lcmlog", "--stage", "local"]):
            with self.subTest(arguments=arguments):
                result = self.hedgehop(*arguments)
                self.assertEqual(result.returncode, 5, result.stdout + result.stderr)
                self.assertRegex(result.stdout + result.stderr, r"\.lcmlog|no event|damage")


class Demo(CliTest):
    def test_leaves_a_verified_plan_a_log_and_pictures(self):
        result = self.hedgehop("demo", "--out", self.work / "demo", "--json", timeout=280)
        self.assertEqual(result.returncode, 0, result.stderr)
        found = json.loads(result.stdout)
        self.assertEqual(found["schema_version"], 1)
        self.assertTrue(found["is_verified"])
        demo = self.work / "demo"
        pictures = list((demo / "plan" / "figures").glob("*.png"))
        self.assertTrue(pictures)
        for picture in pictures:
            self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        self.assertIn("SYNTHETIC", (demo / "plan" / "plan.json").read_text())
        self.assertGreater((demo / "flight.lcmlog").stat().st_size, 100000)
        self.assertEqual([path.name for path in self.work.iterdir()], ["demo"])
        self.assertEqual(listing(self.temporary), [])


def all_tests():
    names = []
    for suite in unittest.defaultTestLoader.loadTestsFromModule(sys.modules[__name__]):
        names.extend(".".join(test.id().split(".")[-2:]) for test in suite)
    return sorted(names)


def main():
    global HEDGEHOP, INPUTS
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hedgehop")
    parser.add_argument("--inputs", type=pathlib.Path)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--make-inputs", action="store_true")
    parser.add_argument("tests", nargs="*")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(all_tests()))
        return 0
    if not arguments.hedgehop or not arguments.inputs:
        parser.error("--hedgehop and --inputs are needed")
    HEDGEHOP, INPUTS = os.path.abspath(arguments.hedgehop), arguments.inputs.absolute()
    if arguments.make_inputs:
        make_inputs(INPUTS)
        return 0
    suite = unittest.defaultTestLoader.loadTestsFromNames(arguments.tests or all_tests(), sys.modules[__name__])
    result = unittest.TextTestRunner(verbosity=2).run(suite)
    for test, why in result.skipped:
        print(f"skipped: {why}")
    if not result.wasSuccessful():
        return 1
    return 77 if result.skipped and len(result.skipped) == result.testsRun else 0


if __name__ == "__main__":
    sys.exit(main())
