#!/usr/bin/env python3
"""Services on bad networks: spread over namespaces with packet loss, killed at any moment, asked by many at once.

  scripts/network_campaign [TEST...]
      loss    map_tiler and recorder, global_planner and command_model, local_planner and request in three
              network namespaces behind a bridge of 100 Mbit/s; every machine loses a share of what it hears.
              Each plan must be that of one process, byte for byte.
      kill    SIGKILL for each service at random moments of a plan. The plan must come, and be the right one,
              or its cause within 10 s.
      crowd   100 requests at once from 10 clients, among them the same request twice. All must be answered,
              each planned once.
      record  a sender that publishes as fast as it can, and the recorder. What is missed must be counted: nothing
              with a receive buffer of 4 MiB, at most 0.1 % with that of a stock kernel. Then the recorder is killed
              while it records, and all but the last 100 ms must be in the log.
      hostile packets that no program of ours sends, to all five services at once. None may end, take 512 MiB or
              need more than a second for an answer afterwards; then a plan must be that of one process.
  --losses 0,1,5,20    per cent, for loss
  --kills N            for each service, for kill (20)
  --requests N         for crowd (100)
  --messages N         for record (2000000)
  --missed-percent-max P  for record, instead of 0 and 0.1: for machines that do other things meanwhile
  --recorder-kills N   for record (10)
  --packets N          for hostile (1000000)
  --seed S             of the random moments (default: a fresh one, printed)
  --json FILE          what was measured

Nothing leaves the namespaces, and nothing stays behind. Exit code 0, 1 if a goal is missed, 77 with the
reason if the system does not allow it.
"""

import argparse
import json
import os
import pathlib
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

import chain_test
from chain_test import SERVICES, WORK, Failure, Setup, check, same_files, stop, wait

URL = "udpm://239.255.76.67:7667?ttl=1"
URL_HERE = "udpm://239.255.76.67:7667?ttl=0"
LOSSES_TIME_MAX_S = 30.0
KILL_TIME_MAX_S = 10.0
KILL_WITHIN_S = 0.8  # about as long as a plan takes
KILLS_OF_ONE_SERVE = 3  # it gives a service up that dies more often


def skip(why):
    print(f"SKIPPED: {why}")
    sys.exit(77)


def command(*arguments):
    done = subprocess.run(list(map(str, arguments)), capture_output=True, text=True)
    check(done.returncode == 0, f"{' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


class Machine:
    """A network namespace with one interface at the bridge."""

    count = 0  # interfaces go some time after their namespace, so no name comes twice

    def __init__(self, number, loss_percent):
        self.holder = subprocess.Popen(["unshare", "-n", "sleep", "900"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            self.connect(number, loss_percent)
        except BaseException:
            self.end()
            raise

    def connect(self, number, loss_percent):
        Machine.count += 1
        inside, outside = f"in{Machine.count}", f"out{Machine.count}"
        own = os.readlink("/proc/self/ns/net")
        wait(lambda: os.readlink(f"/proc/{self.holder.pid}/ns/net") != own, 5, lambda: "namespace")
        command("ip", "link", "add", outside, "type", "veth", "peer", "name", inside)
        command("ip", "link", "set", inside, "netns", self.holder.pid)
        command("ip", "link", "set", outside, "master", "bridge", "up")
        self.run("ip", "addr", "add", f"10.9.0.{number}/24", "dev", inside)
        for link in (inside, "lo"):
            self.run("ip", "link", "set", link, "up")
        self.run("ip", "route", "add", "224.0.0.0/4", "dev", inside)
        self.run("tc", "qdisc", "add", "dev", inside, "root", "tbf", "rate", "100mbit", "burst", "256kb", "latency", "200ms")
        if loss_percent > 0:
            # Before fragments are put together, and not for what the machine says to itself.
            self.run("nft", "add", "table", "inet", "loss")
            self.run("nft", "add", "chain", "inet", "loss", "input", "{ type filter hook prerouting priority -450; }")
            self.run("nft", "add", "rule", "inet", "loss", "input", "iifname", inside, "udp", "dport", "7667",
                     "numgen", "random", "mod", "100", "<", str(loss_percent), "drop")

    def within(self, *arguments):
        return ["nsenter", "-t", str(self.holder.pid), "-n", *map(str, arguments)]

    def run(self, *arguments):
        return command(*self.within(*arguments))

    def end(self):
        self.holder.kill()
        self.holder.wait()


def loss(setup, options, measured):
    for tool, package in (("nft", "nftables"), ("tc", "iproute2"), ("nsenter", "util-linux")):
        if shutil.which(tool) is None:
            skip(f"{tool} is not installed (Debian: {package})")
    try:  # a kernel may lack any of it
        command("ip", "link", "add", "bridge", "type", "bridge", "mcast_snooping", "0")
        command("ip", "link", "set", "bridge", "up")
        Machine(9, 50).end()
    except Failure as failure:
        skip(f"no lossy network can be made here: {failure}")
    in_process = setup.plan()
    for loss_percent in options.losses:
        machines = [Machine(number, loss_percent) for number in (1, 2, 3)]
        children = []

        def start(machine, program, *arguments):
            out = open(setup.folder / f"loss-{loss_percent}-{program}.txt", "w+")
            child = subprocess.Popen(machine.within(setup.programs / program, "--lcm-url", URL, *arguments), stdout=out,
                                     stderr=subprocess.STDOUT, cwd=setup.folder)
            children.append(child)
            return out.name

        try:
            start(machines[0], "hedgehop-flight-logger", "--out", setup.folder / f"loss-{loss_percent}.lcmlog")
            start(machines[0], "hedgehop-map-tiler", "--map", setup.map)
            start(machines[1], "hedgehop-global-planner")
            start(machines[1], "hedgehop-command-model")
            start(machines[2], "hedgehop-local-planner")
            times_s = []
            for turn in range(2):  # the first one with the map's way to the planners
                out = setup.folder / f"loss-{loss_percent}-{turn}"
                begin = time.monotonic()
                done = subprocess.run(machines[2].within(setup.programs / "hedgehop", "request", "--lcm-url", URL, *setup.ends,
                                                         *WORK, "--out", out, "--timeout-s", "20"),
                                      capture_output=True, text=True, timeout=120, cwd=setup.folder)
                times_s.append(time.monotonic() - begin)
                check(done.returncode == 0, f"at {loss_percent} % loss: request ended with {done.returncode}: {done.stderr}")
                same_files(in_process, out)
            print(f"loss {loss_percent:2d} %: the plan came after {times_s[0]:.2f} s, a second one after {times_s[1]:.2f} s, "
                  "both as from one process", flush=True)
            measured.append({"loss_percent": loss_percent, "first_plan_s": times_s[0], "second_plan_s": times_s[1]})
            check(times_s[0] <= LOSSES_TIME_MAX_S, f"{times_s[0]:.1f} s at {loss_percent} % loss")
        finally:
            for child in children:
                child.terminate()
            for child in children:
                child.wait(15)
            for machine in machines:
                machine.end()


def kill(setup, options, measured):
    draw = random.Random(options.seed)
    serve = None
    count = 0
    for name in SERVICES:
        outcome = {"service": name, "planned": 0, "failed": 0, "slowest_s": 0.0, "causes": []}
        for turn in range(options.kills):
            if turn % KILLS_OF_ONE_SERVE == 0:
                if serve is not None:
                    check(stop(serve) == 0, setup.text(serve))
                for log in setup.folder.glob("*.lcmlog"):
                    log.unlink()
                serve = setup.serve()
            out = setup.folder / f"kill-{name}-{turn}"
            count += 1
            # Another speed is another request, which nobody has answered yet.
            speed = ["--speed-mps", f"{40.0 - 0.001 * count:.3f}"]
            wanted = setup.folder / "wanted"
            shutil.rmtree(wanted, ignore_errors=True)
            done = setup.run("plan", "--map", setup.map, *setup.ends, *WORK, *speed, "--out", wanted)
            check(done.returncode == 0, done.stderr)
            running = {}
            for line in setup.text(serve).splitlines():
                match = re.match(r"(\w+)\s+ready, process (\d+)", line)
                if match:
                    running[match.group(1)] = int(match.group(2))
            begin = time.monotonic()
            request = setup.start("hedgehop", "request", *setup.ends, *WORK, *speed, "--out", out, "--timeout-s", "8")
            time.sleep(draw.uniform(0.0, KILL_WITHIN_S))
            try:
                os.kill(running[name], signal.SIGKILL)
            except ProcessLookupError:
                pass
            code = request.wait(60)
            needed_s = time.monotonic() - begin
            outcome["slowest_s"] = max(outcome["slowest_s"], needed_s)
            if code == 0:
                outcome["planned"] += 1
                same_files(wanted, out)
            else:
                text = setup.text(request)
                outcome["failed"] += 1
                outcome["causes"].append(text.strip().splitlines()[-2:])
                check("error: " in text, f"killed {name}: no cause: {text}")
                check(needed_s <= KILL_TIME_MAX_S, f"killed {name}: the cause came after {needed_s:.1f} s")
            deaths = turn % KILLS_OF_ONE_SERVE + 1
            wait(lambda: len(re.findall(rf"(?m)^{name} +ready", setup.text(serve))) > deaths, 20, lambda: setup.text(serve))
        print(f"kill {name}: {outcome['planned']} of {options.kills} plans came, all right; slowest {outcome['slowest_s']:.1f} s",
              flush=True)
        measured.append(outcome)
    check(stop(serve) == 0, setup.text(serve))


def crowd(setup, options, measured):
    serve = setup.serve()
    # Ten clients ask for the same ten speeds in another order each: ten plans, each asked for ten times.
    kinds = max(1, options.requests // 10)
    order = [(client, (client + k) % kinds) for k in range(kinds) for client in range(10)][:options.requests]
    begin = time.monotonic()
    asked = {}
    for client, kind in order:
        out = setup.folder / f"crowd-{client}-{kind}"
        asked[client, kind] = (setup.start("hedgehop", "request", *setup.ends, "--work", "5000", "--speed-mps", f"{40 - kind}",
                                           "--out", out, "--timeout-s", "60"), out)
    for (client, kind), (request, out) in asked.items():
        code = request.wait(300)
        check(code == 0, f"client {client}, speed {40 - kind}: {code} {setup.text(request)}")
    needed_s = time.monotonic() - begin
    for (client, kind), (_, out) in asked.items():
        same_files(setup.folder / f"crowd-0-{kind}", out)
    check(stop(serve) == 0, setup.text(serve))
    log = setup.folder / "flight.lcmlog"
    trajectories = {message[33:50] for _, _, channel, message in chain_test.events(log) if channel == "TRAJECTORY"}
    print(f"crowd: {len(asked)} requests for {kinds} plans answered in {needed_s:.1f} s", flush=True)
    measured.append({"requests": len(asked), "plans": kinds, "all_answered_s": needed_s})
    check(len(trajectories) == kinds, f"{len(trajectories)} different answers to {kinds} requests")


STOCK_BUFFER = 212992  # net.core.rmem_max of a kernel as it comes


def record(setup, options, measured):
    if options.flood is None:
        raise Failure("record needs --flood PROGRAM")
    failures = []
    for buffer_bytes, percent_max in ((4 << 20, 0.0), (STOCK_BUFFER, 0.1)):
        url = f"udpm://239.255.76.67:7667?ttl=0&recv_buf_size={buffer_bytes}"
        log = setup.folder / "flood.lcmlog"
        logger = setup.start("hedgehop-flight-logger", "--lcm-url", url, "--out", log)
        wait(lambda: log.exists() and log.stat().st_size > 0, 10, lambda: setup.text(logger))
        rate = float(command(options.flood, url, options.messages, 0))
        time.sleep(3.0)  # two more statuses
        check(stop(logger, 60) == 0, setup.text(logger))
        done = setup.run("log", "check", log, "--json", timeout=300)
        found = json.loads(done.stdout)
        check(done.returncode == 0, f"the log is damaged: {done.stdout}")
        info = json.loads(setup.run("log", "info", log, "--json", timeout=300).stdout)
        recorded = info["channels"]["PLAN_CANCEL"]["events"]
        missed = options.messages - recorded
        counted = sum(sender["messages"] for sender in found["missing"])
        given = re.search(r"the receive buffer has (\d+) bytes", setup.text(logger))
        given = int(given.group(1)) if given else buffer_bytes
        print(f"record: {recorded} of {options.messages} messages at {rate:.0f} a second, {missed} missed, {counted} of them "
              f"counted; receive buffer of {given} bytes", flush=True)
        measured.append({"messages": options.messages, "recorded": recorded, "missed": missed, "counted": counted,
                         "messages_per_s": rate, "buffer_bytes": given})
        log.unlink()
        # The last ones of a sender can be missed without leaving a gap.
        check(missed - counted <= max(1000, missed // 10), f"{missed} missed, only {counted} counted")
        if options.missed_percent_max is not None:
            percent_max = options.missed_percent_max
        if missed > 0.01 * percent_max * options.messages:
            failures.append(f"{missed} missed with a receive buffer of {given} bytes")

    draw = random.Random(options.seed)
    worst_s = 0.0
    for turn in range(options.recorder_kills):
        log = setup.folder / f"killed-{turn}.lcmlog"
        logger = setup.start("hedgehop-flight-logger", "--lcm-url", URL_HERE, "--out", log)
        wait(lambda: log.exists() and log.stat().st_size > 0, 10, lambda: setup.text(logger))
        flood = subprocess.Popen([options.flood, URL_HERE, "1000000000", "20000"], stdout=subprocess.DEVNULL)
        try:
            time.sleep(draw.uniform(0.3, 1.0))
            logger.kill()
            killed_s = time.time()
            logger.wait()
        finally:
            flood.kill()
            flood.wait()
        last_us = 0
        data = log.read_bytes()
        at = 0
        while at + 28 <= len(data):
            magic, _, utime, channel_length, length = struct.unpack_from(">IqqII", data, at)
            at += 28 + channel_length + length
            if magic != 0xEDA1DA01 or at > len(data):
                break
            last_us = utime
        worst_s = max(worst_s, killed_s - 1e-6 * last_us)
    if options.recorder_kills > 0:
        print(f"record: killed {options.recorder_kills} times, at most the last {1e3 * worst_s:.0f} ms were lost", flush=True)
        measured.append({"recorder_kills": options.recorder_kills, "lost_at_most_s": worst_s})
        if options.missed_percent_max is None:
            check(worst_s <= 0.1, f"{worst_s:.3f} s were lost")
    check(not failures, "; ".join(failures))


def hostile(setup, options, measured):
    if options.hostile is None:
        raise Failure("hostile needs --hostile PROGRAM")
    in_process = setup.plan()
    serve = setup.serve()
    same_files(in_process, setup.request("before"))
    running = {match.group(1): int(match.group(2))
               for match in re.finditer(r"(?m)^(\w+) +ready, process (\d+)", setup.text(serve))}
    check(set(running) == set(SERVICES), setup.text(serve))
    begin = time.monotonic()
    done = subprocess.run([options.hostile, str(options.packets), "1500", str(options.seed)], capture_output=True, text=True,
                          timeout=600)
    check(done.returncode == 0, f"hostile ended with {done.returncode}: {done.stderr}")
    needed_s = time.monotonic() - begin
    found = json.loads(done.stdout)
    check(serve.poll() is None, setup.text(serve))
    failures = []
    for name, process in running.items():
        status = pathlib.Path(f"/proc/{process}/status")
        if not status.exists() or name not in found:
            failures.append(f"{name} did not outlive it (seed {options.seed}): {setup.text(serve)[-2000:]}")
            continue
        memory_mib = int(re.search(r"VmHWM:\s+(\d+) kB", status.read_text()).group(1)) / 1024
        row = {"service": name, "packets": options.packets, "memory_mib": memory_mib, **found[name]}
        measured.append(row)
        print(f"hostile {name}: {row['rejected']} refused, {row['dropped']} missed, at most {memory_mib:.0f} MiB, "
              f"answer after {row['answered_s']:.2f} s", flush=True)
        if memory_mib >= 512:
            failures.append(f"{name} took {memory_mib:.0f} MiB")
        # A status comes once a second.
        if row["answered_s"] > (1.0 if name not in ("command_model", "flight_logger") else 1.2) * options.patience:
            failures.append(f"{name} needed {row['answered_s']:.2f} s for an answer")
    check(not failures, "\n".join(failures))
    same_files(in_process, setup.request("after", "--timeout-s", "20"))
    print(f"hostile: {options.packets} packets in {needed_s:.1f} s (seed {options.seed}); the plan after them is the one before",
          flush=True)
    check(stop(serve) == 0, setup.text(serve)[-2000:])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", required=True)
    parser.add_argument("--map-maker", required=True)
    parser.add_argument("--losses", type=lambda text: [int(part) for part in text.split(",")], default=[0, 1, 5, 20])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--requests", type=int, default=100)
    parser.add_argument("--messages", type=int, default=2_000_000)
    parser.add_argument("--missed-percent-max", type=float)
    parser.add_argument("--recorder-kills", type=int, default=10)
    parser.add_argument("--packets", type=int, default=1_000_000)
    parser.add_argument("--patience", type=float, default=1.0, help=argparse.SUPPRESS)
    parser.add_argument("--flood")
    parser.add_argument("--hostile")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 32))
    parser.add_argument("--json")
    parser.add_argument("tests", nargs="*", metavar="TEST")
    options = parser.parse_args()
    tests = {"loss": loss, "kill": kill, "crowd": crowd, "record": record, "hostile": hostile}
    for name in options.tests:
        if name not in tests:
            parser.error(f"there is no test '{name}'; there are {', '.join(tests)}")
    print(f"seed {options.seed}", flush=True)
    measured = {"seed": options.seed}
    failed = False
    for name in options.tests or tests:
        with tempfile.TemporaryDirectory(prefix="hedgehop-network-") as folder:
            setup = Setup(pathlib.Path(options.programs).resolve(), pathlib.Path(options.map_maker).resolve(), folder)
            try:
                tests[name](setup, options, measured.setdefault(name, []))
            except Failure as failure:
                print(f"FAILED: {name}: {failure}", flush=True)
                failed = True
            finally:
                setup.end()
    if options.json:
        pathlib.Path(options.json).write_text(json.dumps(measured, indent=2) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
