#!/usr/bin/env python3
"""The programs together over UDP: what `serve` and `request` do, what a log is good for.

  chain_test.py --list                           names of the tests
  chain_test.py --programs DIR --map-maker PROGRAM NAME
                                                 runs one; exit code 77 with the reason: skipped

Every test runs in a network namespace of its own (scripts/in-own-network), so that buses cannot
meet and ports need no bookkeeping.
"""

import argparse
import json
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

WORK = ["--work", "20000"]
FILES = ["plan.json", "route.geojson", "trajectory.csv"]
SERVICES = ["map_tiler", "global_planner", "local_planner", "command_model", "flight_logger"]
ROOT = pathlib.Path(__file__).resolve().parents[2]


class Failure(Exception):
    pass


def check(condition, what):
    if not condition:
        raise Failure(what)


class Setup:
    def __init__(self, programs, map_maker, folder):
        self.programs = pathlib.Path(programs)
        self.folder = pathlib.Path(folder)
        self.map = self.folder / "map"
        self.map_maker = map_maker
        ends = subprocess.run([map_maker, self.map], check=True, capture_output=True, text=True).stdout.split()
        self.ends = ["--start", ends[0], "--goal", ends[1]]
        self.children = []

    def run(self, *arguments, timeout=60, cwd=None):
        return subprocess.run([self.programs / "hedgehop", *map(str, arguments)], capture_output=True, text=True,
                              timeout=timeout, cwd=cwd or self.folder)

    def start(self, program, *arguments):
        out = open(self.folder / f"{program}.{len(self.children)}.txt", "w+")
        child = subprocess.Popen([self.programs / program, *map(str, arguments)], stdout=out,
                                 stderr=subprocess.STDOUT, cwd=self.folder)
        child.out = out
        self.children.append(child)
        return child

    def text(self, child):
        child.out.flush()
        return pathlib.Path(child.out.name).read_text()

    def serve(self, *arguments):
        child = self.start("hedgehop", "serve", "--map", self.map, "--log", self.folder / "flight.lcmlog", *arguments)
        wait(lambda: "services are ready" in self.text(child), 20, lambda: "serve: " + self.text(child),
             lambda: child.poll() is None)
        return child

    def plan(self, *arguments):
        """What one process makes; the reference of every comparison."""
        out = self.folder / "in_process"
        done = self.run("plan", "--map", self.map, *self.ends, *WORK, "--out", out, *arguments)
        check(done.returncode == 0, f"plan ended with {done.returncode}: {done.stderr}")
        return out

    def request(self, name, *arguments):
        out = self.folder / name
        done = self.run("request", *self.ends, *WORK, "--out", out, *arguments)
        check(done.returncode == 0, f"request ended with {done.returncode}: {done.stderr}")
        return out

    def end(self):
        for child in self.children:
            if child.poll() is None:
                child.terminate()
                try:
                    child.wait(15)
                except subprocess.TimeoutExpired:
                    child.kill()
                    child.wait()


def wait(is_reached, timeout_s, what, is_possible=lambda: True):
    end = time.monotonic() + timeout_s
    while not is_reached():
        check(is_possible() and time.monotonic() < end, "waited in vain: " + what())
        time.sleep(0.02)


def stop(child, timeout_s=10):
    child.send_signal(signal.SIGTERM)
    return child.wait(timeout_s)


def same_files(one, other):
    for name in FILES:
        check((one / name).read_bytes() == (other / name).read_bytes(), f"{name} differs")


def events(log):
    """(start, end, channel, message) of each event of a log, read as the format says."""
    data = log.read_bytes()
    at = 0
    while at < len(data):
        magic, _, _, channel_length, length = struct.unpack_from(">IqqII", data, at)
        check(magic == 0xEDA1DA01, f"{log}: no event at {at}")
        end = at + 28 + channel_length + length
        yield at, end, data[at + 28:at + 28 + channel_length].decode(), data[end - length:end]
        at = end


def blob_of(chunk):
    """The blob that a CHUNK belongs to: after type hash, utime, sender, seq and version."""
    return chunk[34:50]


def whole_events(log):
    """(channel, message) of a log that is still written."""
    found = []
    try:
        for _, _, channel, message in events(log):
            found.append((channel, message))
    except (struct.error, UnicodeDecodeError):
        pass
    return found


def recorded_flight(setup, flown_s=0.0):
    """A log of one planning run, recorder first."""
    serve = setup.serve()
    setup.request("over_bus")
    time.sleep(flown_s)
    check(stop(serve) == 0, "serve did not end with 0:\n" + setup.text(serve))
    return setup.folder / "flight.lcmlog"


# ----------------------------------------------------------------------------------------------

def services_make_the_same_bytes_as_one_process(setup):
    in_process = setup.plan("--threads", "1")
    serve = setup.serve("--threads", "2")
    same_files(in_process, setup.request("over_bus"))
    # Asked again, it is answered at once, and with the same.
    same_files(in_process, setup.request("again"))
    check(stop(serve) == 0, "serve did not end with 0:\n" + setup.text(serve))
    for name in SERVICES:
        check(f"{name} " in setup.text(serve), f"serve did not report {name}")


def in_lockstep_with_the_command_model_the_bytes_are_the_same(setup):
    in_process = setup.plan()
    serve = setup.serve("--lockstep")
    same_files(in_process, setup.request("over_bus"))
    check(stop(serve) == 0, "serve did not end with 0:\n" + setup.text(serve))
    times = [struct.unpack_from(">q", (setup.folder / "flight.lcmlog").read_bytes(), start + 12)[0]
             for start, _, channel, _ in events(setup.folder / "flight.lcmlog") if channel == "VEHICLE_TARGET"]
    check(len(times) > 2000, f"only {len(times)} steps over the bus")
    print(f"{len(times)} steps, {(len(times) - 1) / (times[-1] - times[0]) * 1e6:.0f} a second")


def replay_makes_every_stage_again(setup):
    log = recorded_flight(setup)
    for stage in ["global", "local", "flight"]:
        done = setup.run("replay", log, "--stage", stage, "--json")
        check(done.returncode == 0, f"{stage}: {done.returncode} {done.stdout}{done.stderr}")
        check(json.loads(done.stdout)["result"] == "equal", f"{stage}: {done.stdout}")
    # Recorded by another version with another route: the difference is found, and the version named.
    data = bytearray(log.read_bytes())
    version = next(message for _, _, channel, message in events(log) if channel == "ROUTE").rstrip(b"\0").rsplit(b" ", 1)[1]
    for _, end, channel, message in list(events(log)):
        if channel == "ROUTE":
            data[end - len(message) + 89] ^= 1  # the end of the blob's name, after map and patch
        if channel == "SERVICE_STATUS" and b"global_planner" in message:
            at = data.find(version, end - len(message), end)
            data[at:at + len(version)] = b"9" * len(version)
    other = setup.folder / "other.lcmlog"
    other.write_bytes(data)
    done = setup.run("replay", other, "--stage", "global")
    check(done.returncode == 1 and "different" in done.stdout, f"{done.returncode} {done.stdout}")
    check(f"recorded by version {'9' * len(version)}, this is {version.decode()}" in done.stdout, done.stdout)
    info = json.loads(setup.run("log", "info", log, "--json").stdout)
    check(info["damage_count"] == 0 and info["requests"][0]["has_trajectory"], f"log info: {info}")
    check({"MAP_INDEX", "CHUNK", "PLAN_REQUEST", "PLAN_STATUS", "ROUTE", "TRAJECTORY", "SERVICE_STATUS",
           "VEHICLE_STATE"} <= set(info["channels"]), f"channels: {info['channels']}")


def stages_fed_by_the_log_player_make_the_recorded_bytes(setup):
    player = shutil.which("lcm-logplayer")
    if player is None:
        print("SKIPPED: lcm-logplayer is not installed (Debian: liblcm-bin)")
        sys.exit(77)
    limit = int(pathlib.Path("/proc/sys/net/core/rmem_max").read_text())
    if limit < 4 << 20:
        print(f"SKIPPED: net.core.rmem_max is {limit}, 4194304 are needed lest packets be lost (scripts/net-setup)")
        sys.exit(77)
    log = recorded_flight(setup, 1.5)
    recorded = list(events(log))
    # Behind type hash and time stand sender and number, which are another's; then the content. That of
    # ROUTE and TRAJECTORY names its blob by the hash of its bytes.
    senders = {message[16:24] for _, _, _, message in recorded}
    answers = {channel: next(message for _, _, heard, message in recorded if heard == channel)
               for channel in ("ROUTE", "TRAJECTORY")}
    states = {message[50:58]: message[32:] for _, _, channel, message in recorded if channel == "VEHICLE_STATE"}
    check(len(states) > 20, f"only {len(states)} states were recorded")
    for speed in ("1", "4"):
        again = setup.folder / f"again-{speed}.lcmlog"
        children = [setup.start("hedgehop-flight-logger", "--out", again)]
        children += [setup.start(program) for program in
                     ("hedgehop-global-planner", "hedgehop-local-planner", "hedgehop-command-model")]
        wait(lambda: again.exists() and all(name.encode() in again.read_bytes() for name in SERVICES[1:]), 10,
             lambda: "".join(setup.text(child) for child in children))
        subprocess.run([player, "-s", speed, "-e", "(MAP_INDEX|CHUNK|PLAN_REQUEST|ROUTE|TRAJECTORY)", log], check=True,
                       capture_output=True, timeout=60)
        def new():
            return [(channel, message) for channel, message in whole_events(again) if message[16:24] not in senders]
        wait(lambda: sum(channel == "VEHICLE_STATE" for channel, _ in new()) > 20
             and {"ROUTE", "TRAJECTORY"} <= {channel for channel, _ in new()}, 20,
             lambda: "".join(setup.text(child) for child in children))
        for channel, message in answers.items():
            answer = next(message for heard, message in new() if heard == channel)
            check(answer[:16] == message[:16] and answer[32:] == message[32:], f"at {speed}x another {channel}")
        flown = {message[50:58]: message[32:] for channel, message in new() if channel == "VEHICLE_STATE"}
        common = [step for step in flown if step in states]
        check(len(common) > 15, f"at {speed}x only {len(common)} states to compare")
        check(all(flown[step] == states[step] for step in common), f"at {speed}x another flight")
        for child in children:
            check(stop(child) == 0, setup.text(child))


def a_missing_tile_is_named(setup):
    log = recorded_flight(setup)
    # The map's blobs went over the bus before the request; MAP_INDEX names two of them, tile table
    # and features. The others are tiles.
    chunks = {}
    for _, _, channel, message in events(log):
        if channel == "MAP_INDEX":
            index = message
        if channel == "CHUNK":
            chunks.setdefault(blob_of(message), []).append(message)
        if channel == "PLAN_REQUEST":
            break
    tiles = [blob for blob in chunks if blob not in index]
    check(len(tiles) == len(chunks) - 2, f"{len(tiles)} tiles among {len(chunks)} blobs")
    victim = tiles[len(tiles) // 2]
    holed = setup.folder / "holed.lcmlog"
    data = log.read_bytes()
    holed.write_bytes(b"".join(data[start:end] for start, end, channel, message in events(log)
                               if not (channel == "CHUNK" and blob_of(message) == victim)))
    for stage in ["global", "local"]:
        done = setup.run("replay", holed, "--stage", stage)
        check(done.returncode == 5, f"replay ended with {done.returncode}: {done.stdout}")
        check("tile column" in done.stdout and "layer" in done.stdout, f"no tile is named: {done.stdout}")

    player = shutil.which("lcm-logplayer")
    if player is None:
        return
    # Live as well: after a limit in message time, which the played log exceeds.
    config = setup.folder / "impatient.yaml"
    config.write_text("patience_s: 1.0\n")
    planner = setup.start("hedgehop-local-planner", "--config", config)
    time.sleep(0.5)
    subprocess.run([player, "-s", "4", "-e", "(MAP_INDEX|CHUNK|ROUTE)", holed], check=True,
                   capture_output=True, timeout=60)
    wait(lambda: "tile column" in setup.text(planner), 10, lambda: setup.text(planner))


def nobody_there_is_exit_code_6(setup):
    out = setup.folder / "plan"
    done = setup.run("request", *setup.ends, "--out", out, "--timeout-s", "0.5")
    check(done.returncode == 6, f"ended with {done.returncode}")
    check("map_tiler" in done.stderr and "hedgehop serve" in done.stderr, done.stderr)
    tiler = setup.start("hedgehop-map-tiler", "--map", setup.map)
    done = setup.run("request", *setup.ends, "--out", out, "--timeout-s", "2")
    check(done.returncode == 6, f"ended with {done.returncode}")
    check("no global_planner answered" in done.stderr, done.stderr)
    check(stop(tiler) == 0, "map_tiler did not end with 0")
    check(sorted(p.name for p in setup.folder.iterdir() if "plan" in p.name) == [], "something was left behind")


def requests_that_cannot_be_met_say_why(setup):
    serve = setup.serve()
    out = setup.folder / "plan"
    outside = ["--start", setup.ends[1], "--goal", "50.5,10.4"]
    for arguments in [["plan", "--map", setup.map], ["request"]]:
        done = setup.run(*arguments, *outside, "--out", out, "--json")
        check(done.returncode == 2, f"{arguments[0]} ended with {done.returncode}: {done.stderr}")
        check(json.loads(done.stdout)["no_plan"]["cause"] == "goal_outside_map", done.stdout)
    check(not out.exists(), "a bundle was written")
    check(stop(serve) == 0, setup.text(serve))


def an_interrupted_request_cancels_the_planning(setup):
    serve = setup.serve()
    out = setup.folder / "plan"
    request = setup.start("hedgehop", "request", *setup.ends, "--work", "2000000000",
                          "--set", "global.planner=bit_star", "--out", out)  # it spends its whole budget
    wait(lambda: "planning the route" in setup.text(request), 20, lambda: setup.text(request))
    request.send_signal(signal.SIGINT)
    check(request.wait(10) == 130, f"ended with {request.returncode}: {setup.text(request)}")
    check(not out.exists(), "a bundle was written")
    # The planner is free again.
    setup.request("after")
    check(stop(serve) == 0, setup.text(serve))
    leftovers = [p.name for p in setup.folder.iterdir() if p.name.startswith(".")]
    check(leftovers == [], f"left behind: {leftovers}")


def a_service_that_dies_is_started_again(setup):
    serve = setup.serve()
    lines = [line.split() for line in setup.text(serve).splitlines() if line.startswith("global_planner ")]
    os.kill(int(lines[0][-1]), signal.SIGKILL)
    wait(lambda: "global_planner starts again" in setup.text(serve), 10, lambda: setup.text(serve))
    check("Killed" in setup.text(serve), "the cause is not reported")
    lines = [line.split() for line in setup.text(serve).splitlines() if line.startswith("flight_logger ")]
    os.kill(int(lines[0][-1]), signal.SIGKILL)
    setup.request("after")
    second = setup.folder / "flight-2.lcmlog"
    wait(lambda: second.exists() and b"SERVICE_STATUS" in second.read_bytes(), 10, lambda: setup.text(serve))
    check(stop(serve) == 0, setup.text(serve))


def serve_without_a_map_says_so(setup):
    done = setup.run("serve", "--map", setup.folder / "nothing")
    check(done.returncode == 5 and "nothing" in done.stderr, f"{done.returncode}: {done.stderr}")
    broken = setup.folder / "broken"
    shutil.copytree(setup.map, broken)
    (broken / "terrain.tif").write_bytes(b"no raster")
    done = setup.run("serve", "--map", broken, "--log", setup.folder / "log")
    check(done.returncode == 5, f"{done.returncode}: {done.stderr}")
    check("terrain.tif" in done.stderr and "map_tiler ended with exit code 5" in done.stderr, done.stderr)


def without_multicast_the_bus_error_names_the_remedy(setup):
    subprocess.run(["ip", "route", "flush", "table", "all"], check=False, capture_output=True)
    subprocess.run(["ip", "link", "set", "lo", "down"], check=False, capture_output=True)
    for arguments in [["request", *setup.ends, "--out", setup.folder / "plan"],
                      ["serve", "--map", setup.map, "--log", setup.folder / "log"], ["watch"]]:
        done = setup.run(*arguments)
        check(done.returncode == 6, f"{arguments[0]} ended with {done.returncode}: {done.stderr}")
        check("net-setup" in done.stderr, done.stderr)
    done = setup.run("doctor", "--json")
    check(done.returncode == 1 and not json.loads(done.stdout)["is_fit"], done.stdout)


def every_service_ends_with_0_on_sigterm(setup):
    children = {
        "map_tiler": setup.start("hedgehop-map-tiler", "--map", setup.map),
        "flight_logger": setup.start("hedgehop-flight-logger", "--out", setup.folder / "log"),
        "global_planner": setup.start("hedgehop-global-planner"),
        "local_planner": setup.start("hedgehop-local-planner"),
        "command_model": setup.start("hedgehop-command-model"),
    }
    watch = setup.run("watch", "--duration-s", "3", "--json")
    names = {json.loads(line).get("name") for line in watch.stdout.splitlines()}
    check(set(SERVICES) <= names, f"watch saw only {names}")
    for name, child in children.items():
        check(stop(child) == 0, f"{name} ended with {child.returncode}: {setup.text(child)}")


def across_the_way(setup):
    """Options for an area that closes the straight way from start to goal."""
    ends = [[float(part) for part in text.split(",")[:2]] for text in setup.ends[1::2]]
    lat, lon = [(a + b) / 2 for a, b in zip(*ends)]
    return [option for dlat, dlon in [(-0.008, -0.002), (-0.008, 0.002), (0.008, 0.002), (0.008, -0.002)]
            for option in ["--corner", f"{lat + dlat:.6f},{lon + dlon:.6f}"]]


def patch(setup, *arguments):
    done = setup.run("patch", *arguments, "--json")
    check(done.returncode == 0, f"patch {arguments[0]} ended with {done.returncode}: {done.stderr}")
    return json.loads(done.stdout)


def patches_come_go_and_outlive_the_map_tiler(setup):
    base = setup.plan()
    serve = setup.serve()
    added = patch(setup, "add", "area", *across_the_way(setup), "--label", "fire")
    check(added["patch_number"] == 1 and added["is_present"], str(added))
    with_patch = setup.request("with_patch")
    said = json.loads((with_patch / "plan.json").read_text())["map"]
    check(said["patch_number"] == 1 and said["hash"] == added["map_hash"], str(said))
    check((with_patch / "route.geojson").read_bytes() != (base / "route.geojson").read_bytes(),
          "the route leads through the area")

    # The map on the bus, taken off it: plans and checks of the plan are the same there.
    patch(setup, "map", "--out", setup.folder / "patched")
    done = setup.run("verify", with_patch, "--map", setup.folder / "patched")
    check(done.returncode == 0, f"verify: {done.returncode} {done.stdout}{done.stderr}")
    done = setup.run("verify", with_patch, "--map", setup.map)
    check(done.returncode == 2 and said["hash"] in done.stderr, f"verify: {done.returncode} {done.stderr}")
    out = setup.folder / "alone"
    done = setup.run("plan", "--map", setup.folder / "patched", *setup.ends, *WORK, "--out", out)
    check(done.returncode == 0, done.stderr)
    for name in ["route.geojson", "trajectory.csv"]:
        check((out / name).read_bytes() == (with_patch / name).read_bytes(), f"{name} differs")

    lines = [line.split() for line in setup.text(serve).splitlines() if line.startswith("map_tiler ")]
    os.kill(int(lines[0][-1]), signal.SIGKILL)
    wait(lambda: "map_tiler starts again" in setup.text(serve), 10, lambda: setup.text(serve))
    listed = patch(setup, "list")
    check([thing["label"] for thing in listed["patches"]] == ["fire"], str(listed))
    crane = patch(setup, "add", "obstacle", "--at", setup.ends[1], "--radius-m", "20", "--height-m", "50")
    check(crane["patch_number"] == 2, str(crane))
    check(patch(setup, "remove", crane["id"])["patch_number"] == 3, "the crane does not go")
    gone = patch(setup, "remove", added["id"])
    check(not gone["is_present"] and gone["map_hash"] == gone["base_map_hash"], str(gone))
    after = setup.request("after")
    for name in ["route.geojson", "trajectory.csv"]:
        check((after / name).read_bytes() == (base / name).read_bytes(), f"{name} differs from the base map's")
    done = setup.run("patch", "remove", "12345")
    check(done.returncode == 5 and "nothing of this id" in done.stderr, f"{done.returncode}: {done.stderr}")
    check(stop(serve) == 0, setup.text(serve))


def a_plan_under_way_is_made_again_when_a_patch_comes(setup):
    serve = setup.serve()
    request = setup.start("hedgehop", "request", *setup.ends, "--work", "2000000000",
                          "--set", "global.planner=bit_star", "--out", setup.folder / "plan")
    wait(lambda: "planning the route" in setup.text(request), 20, lambda: setup.text(request))
    patch(setup, "add", "threat", "--at", setup.ends[3], "--range-m", "2000", "--mast-height-m", "10")
    wait(lambda: "patch 1: planning again" in setup.text(request), 10, lambda: setup.text(request))
    time.sleep(0.5)
    request.send_signal(signal.SIGINT)
    check(request.wait(10) == 130, f"ended with {request.returncode}: {setup.text(request)}")
    check(stop(serve) == 0, setup.text(serve))
    recorded = list(events(setup.folder / "flight.lcmlog"))
    check({"MAP_PATCH", "MAP_PATCH_STATE"} <= {channel for _, _, channel, _ in recorded}, "not recorded")
    # After type hash, time, sender, number and version.
    asked = {message[34:50] for _, _, channel, message in recorded if channel == "PLAN_REQUEST"}
    check(len(asked) == 2, f"{len(asked)} requests, wanted one on each map")


def two_maps_on_one_network_are_named_and_not_mixed(setup):
    other = setup.folder / "other"
    serve = setup.serve()
    base = setup.request("before")
    # The same region, one thing more: another map.
    patch(setup, "add", "area", *across_the_way(setup))
    patch(setup, "map", "--out", other)
    for thing in patch(setup, "list")["patches"]:
        patch(setup, "remove", thing["id"])
    setup.start("hedgehop-map-tiler", "--map", other)
    wait(lambda: "two maps on the bus" in setup.text(serve), 10, lambda: setup.text(serve))
    text = setup.text(serve)
    hashes = [json.loads((folder / "manifest.json").read_text())["map_hash"] for folder in (setup.map, other)]
    check(all(value in text for value in hashes), f"{hashes} are not named: {text}")
    done = setup.run("patch", "list")
    check(done.returncode == 6 or "base map" in done.stdout, done.stderr)
    # Who comes now may take the other one for the map that counts; then it is refused.
    again = setup.folder / "again"
    done = setup.run("request", *setup.ends, *WORK, "--out", again)
    if done.returncode == 0:
        same_files(base, again)
    else:
        check(done.returncode == 1 and all(value in done.stderr for value in hashes), done.stderr)
    check(stop(serve) == 0, setup.text(serve))


def evaluate_bus_measures_what_the_bus_costs(setup):
    done = setup.run("evaluate", "bus", "--map", setup.map, "--plans", "1", "--lockstep-steps", "500", "--without-loss",
                     "--distance", "2500", "--seed", "7", "--json", timeout=100)
    check(done.returncode == 0, f"{done.returncode}: {done.stderr}")
    found = json.loads(done.stdout)
    check(found["is_same"], "another trajectory over the bus")
    check(found["lockstep_steps_per_s"] > 500 and found["tile_mb_per_s"] > 0.2, done.stdout)
    check(found["loss_table"] is None and "without-loss" in found["loss_table_reason"], done.stdout)
    check(-1 < found["first_plan_overhead_s"] < 10 and -1 < found["plan_overhead_s"] < 5, done.stdout)


def watch_shows_services_channels_and_echoes(setup):
    serve = setup.serve()
    setup.request("over_bus")
    lines = setup.run("watch", "--duration-s", "2.5", "--json").stdout.splitlines()
    tables = [json.loads(line) for line in lines if json.loads(line)["channel"] == "TABLE"]
    check(tables, "no table")
    table = tables[-1]
    check({service["name"] for service in table["services"]} == set(SERVICES), str(table["services"]))
    for service in table["services"]:
        check(-0.5 < service["clock_offset_s"] < 0.5 and service["published_per_s"] > 0, str(service))
    check(table["channels"]["MAP_INDEX"]["messages"] >= 1 and table["mismatches"] == [], str(table))
    text = setup.run("watch", "--duration-s", "2").stdout
    check("map_tiler" in text and "clock ms" in text and "MISMATCH" not in text, text)
    echoed = setup.run("watch", "--echo", "MAP_I*", "--echo", "SERVICE_STATUS", "--duration-s", "2.5", "--json").stdout
    messages = [json.loads(line) for line in echoed.splitlines()]
    check({message["channel"] for message in messages} == {"MAP_INDEX", "SERVICE_STATUS"}, echoed)
    index = next(message["message"] for message in messages if message["channel"] == "MAP_INDEX")
    check(index["type"] == "map_index_v2_t" and index["column_count"] == 240 and index["label"] == "TEST HILLS", str(index))
    doctor = json.loads(setup.run("doctor", "--json").stdout)
    checks = {one["name"]: one for one in doctor["checks"]}
    check({"multicast route", "TTL", "receive buffer", "IP fragments", "PROJ grids", "disk", "versions"} <= set(checks), str(checks))
    check(checks["multicast route"]["is_ok"] and "over lo" in checks["multicast route"]["text"], str(checks))
    check("5 services" in checks["versions"]["text"], str(checks["versions"]))
    check(all(one["is_ok"] or one["remedy"] for one in doctor["checks"]), str(checks))
    check(stop(serve) == 0, setup.text(serve))


def configs_are_checked_before_anything_else(setup):
    for name in SERVICES:
        program = setup.programs / ("hedgehop-" + name.replace("_", "-"))
        shipped = ROOT / "config" / f"{name}.yaml"
        done = subprocess.run([program, "--config", shipped, "--check"], capture_output=True, text=True)
        check(done.returncode == 0 and done.stdout == "ok\n", f"{name}: {done.returncode} {done.stderr}")
        lines = shipped.read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if line and not line.startswith("#"))
        lines[at] = "x" + lines[at]
        wrong = setup.folder / f"{name}.yaml"
        wrong.write_text("\n".join(lines) + "\n")
        done = subprocess.run([program, "--config", wrong, "--check"], capture_output=True, text=True)
        check(done.returncode == 2, f"{name}: {done.returncode}")
        check(f"{name}.yaml:{at + 1}:" in done.stderr, f"{name}: {done.stderr}")


def named_observers_are_weighed_over_the_bus_as_on_the_command_line(setup):
    weighed = ["--set", "weights.threats=20"]
    serve = setup.serve()
    done = setup.run("request", *setup.ends, *WORK, *weighed, "--out", setup.folder / "refused")
    check(done.returncode == 1 and "--observers" in done.stderr, f"{done.returncode}: {done.stderr}")
    check(stop(serve) == 0, setup.text(serve))

    setup.map = setup.folder / "watched"
    subprocess.run([setup.map_maker, setup.map, "--observers"], check=True, capture_output=True)
    alone = setup.plan(*weighed)
    (setup.folder / "flight.lcmlog").unlink()
    serve = setup.serve()
    same_files(setup.request("over_bus", *weighed), alone)
    ends = [[float(part) for part in text.split(",")[:2]] for text in setup.ends[1::2]]
    lat, lon = [(a + b) / 2 for a, b in zip(*ends)]
    patch(setup, "add", "threat", "--at", f"{lat:.6f},{lon:.6f}", "--range-m", "1000", "--mast-height-m", "10")
    patched = setup.folder / "patched"
    patch(setup, "map", "--out", patched)
    after = setup.request("after", *weighed)
    check((after / "plan.json").read_bytes() != (alone / "plan.json").read_bytes(), "nobody saw the observer")
    done = setup.run("verify", after, "--map", patched)
    check(done.returncode == 0, f"verify: {done.returncode} {done.stdout}{done.stderr}")
    out = setup.folder / "patched_alone"
    done = setup.run("plan", "--map", patched, *setup.ends, *WORK, *weighed, "--out", out)
    check(done.returncode == 0, done.stderr)
    for name in ["route.geojson", "trajectory.csv"]:
        check((out / name).read_bytes() == (after / name).read_bytes(), f"{name} differs")
    check(stop(serve) == 0, setup.text(serve))
    for stage in ["global", "local"]:
        done = setup.run("replay", setup.folder / "flight.lcmlog", "--stage", stage, "--json")
        check(done.returncode == 0 and json.loads(done.stdout)["result"] == "equal", done.stdout + done.stderr)


TESTS = [
    services_make_the_same_bytes_as_one_process,
    in_lockstep_with_the_command_model_the_bytes_are_the_same,
    replay_makes_every_stage_again,
    stages_fed_by_the_log_player_make_the_recorded_bytes,
    a_missing_tile_is_named,
    nobody_there_is_exit_code_6,
    requests_that_cannot_be_met_say_why,
    an_interrupted_request_cancels_the_planning,
    a_service_that_dies_is_started_again,
    serve_without_a_map_says_so,
    without_multicast_the_bus_error_names_the_remedy,
    every_service_ends_with_0_on_sigterm,
    patches_come_go_and_outlive_the_map_tiler,
    a_plan_under_way_is_made_again_when_a_patch_comes,
    two_maps_on_one_network_are_named_and_not_mixed,
    named_observers_are_weighed_over_the_bus_as_on_the_command_line,
    evaluate_bus_measures_what_the_bus_costs,
    watch_shows_services_channels_and_echoes,
    configs_are_checked_before_anything_else,
]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--programs")
    parser.add_argument("--map-maker")
    parser.add_argument("name", nargs="?")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(test.__name__ for test in TESTS))
        return 0
    test = next(test for test in TESTS if test.__name__ == arguments.name)
    with tempfile.TemporaryDirectory(prefix="hedgehop-chain-") as folder:
        setup = Setup(arguments.programs, arguments.map_maker, folder)
        try:
            test(setup)
        except Failure as failure:
            print(f"FAILED: {failure}")
            return 1
        finally:
            setup.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
