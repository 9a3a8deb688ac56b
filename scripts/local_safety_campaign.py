"""See scripts/local_safety_campaign."""

import argparse
import json
import math
import secrets
import subprocess
import sys
import time

SUMS = ("flights", "reached", "collisions", "clearance_violations", "ways_out")


def arguments():
    parser = argparse.ArgumentParser(prog="local_safety_campaign")
    parser.add_argument("--program", required=True)
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--block", type=int, default=50)
    parser.add_argument("--planner", action="append")
    parser.add_argument("--seconds", type=float, default=math.inf)
    parser.add_argument("--routes")
    parser.add_argument("--json")
    parser.add_argument("maps", nargs="+", metavar="MAP")
    asked = parser.parse_args()
    if asked.flights < 1 or asked.block < 1:
        parser.error("--flights and --block must be positive")
    asked.planner = asked.planner or ["rollout", "tvfh"]
    return asked


def rows_of(asked, map_folder, flights, seed):
    command = [asked.program, "evaluate", "local-safety", "--map", map_folder, "--flights", str(flights), "--seed", str(seed),
               "--json", "--quiet"]
    for planner in asked.planner:
        command += ["--planner", planner]
    if asked.routes:
        command += ["--routes", asked.routes]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"local_safety_campaign: {' '.join(command)} ended with code {done.returncode}")
    return json.loads(done.stdout)["rows"]


def add(total, row):
    for key in SUMS:
        total[key] = total.get(key, 0) + row[key]
    total["length_m"] = total.get("length_m", 0.0) + row["length_m"]
    low_m = row["length_m"] * (row["share_under_ceiling_off_towers"] or 0.0)
    total["low_m"] = total.get("low_m", 0.0) + low_m
    if row["min_clearance_m"] is not None:
        total["min_clearance_m"] = min(total.get("min_clearance_m", math.inf), row["min_clearance_m"])
    return total


def told(name, total):
    low = total["low_m"] / total["length_m"] if total["length_m"] > 0.0 else math.nan
    return (f"{name}: {total['flights']} flights, {total['reached']} reached the goal, {total['collisions']} collisions, "
            f"{total['clearance_violations']} violations, {total['ways_out']} ways out, "
            f"least clearance {total.get('min_clearance_m', math.nan):.1f} m, {100.0 * low:.1f} % under the ceiling away from towers")


def main():
    asked = arguments()
    began = time.monotonic()
    totals = {}
    blocks = []
    flown = 0
    while flown < asked.flights and time.monotonic() - began < asked.seconds:
        map_folder = asked.maps[len(blocks) % len(asked.maps)]
        flights = min(asked.block, asked.flights - flown)
        seed = secrets.randbits(31)
        print(f"map {map_folder}, seed {seed}, {flights} flights", flush=True)
        rows = rows_of(asked, map_folder, flights, seed)
        for row in rows:
            name = row["planner"] + (" with towers" if row["towers"] else " without towers")
            add(totals.setdefault(name, {}), row)
            if row["unsafe_problems"]:
                print(f"  {name}: problems {row['unsafe_problems']} did not reach the goal or came too near", flush=True)
        blocks.append({"map": map_folder, "seed": seed, "rows": rows})
        flown += flights
    for name, total in totals.items():
        print(told(name, total))
    print(f"{flown} of {asked.flights} flights in {time.monotonic() - began:.0f} s")
    if asked.json:
        with open(asked.json, "w", encoding="utf-8") as out:
            json.dump({"planner": asked.planner, "totals": totals, "blocks": blocks}, out, indent=2)
            out.write("\n")
    is_safe = all(total["collisions"] == 0 and total["clearance_violations"] == 0 and
                  total["reached"] >= 0.99 * total["flights"] for total in totals.values())
    return 0 if is_safe and totals else 1


if __name__ == "__main__":
    sys.exit(main())
