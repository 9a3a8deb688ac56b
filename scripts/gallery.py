#!/usr/bin/env python3
"""Draws the gallery: plans its missions and writes their pictures, profiles and numbers."""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys

import regions

FOLDER = regions.ROOT / "docs/gallery"
# (mission, title, region, settings, what to look at)
MISSIONS = [
    ("across_the_hills", "Across the hills", "synthetic", [],
     "Corner to corner: valleys where they lead the right way, saddles where they do not."),
    ("past_the_towns", "Past the towns", "synthetic", [],
     "The way bends around settlements and their rings, and stays off the crests between them."),
    ("two_places_to_pass", "Two places to pass", "synthetic", [],
     "Via points are passed in order; the flight cuts their corners within its turn radius."),
    ("slowly_over_the_lines", "Slowly, over power lines", "synthetic", [],
     "At 25 m/s turns are tighter and climbs steeper. Lines are crossed above their wires."),
    ("north_of_bayreuth", "North of Bayreuth", "bayreuth", [],
     "Real land from SRTM and OpenStreetMap. The terrain is smooth, so concealment is in its folds."),
    ("the_short_way", "The short way", "bayreuth", ["weights.visibility=0"],
     "The same ends with no weight for being seen: shorter, and seen by more."),
]


def picture(source, target):
    """A palette is enough for maps, and a quarter of the bytes."""
    subprocess.run(["pngquant", "--force", "--speed", "1", "--nofs", "--output", target, "64", source], check=True)


def entry(mission, command, plan):
    name, title, _, _, words = mission
    measures, verdict = plan["measures"], plan["verification"]
    numbers = [
        ("length", f"{measures['length_m'] / 1000:.1f} km"), ("time", f"{measures['duration_s'] / 60:.1f} min"),
        ("mean height above the surface", f"{measures['mean_height_m']:.1f} m"),
        ("under the ceiling", f"{100 * measures['share_under_ceiling']:.0f} % of the way"),
        ("least clearance", f"{verdict['clearance_min_m']:.1f} m"),
        ("seen by, on average", f"{100 * measures['visibility_m'] / measures['length_m']:.1f} % of the surroundings"),
        ("verdict", "verified" if verdict["is_verified"] else "not verified")]
    lines = [f"## {title}", "", words, "", f"    {command}", "", "| " + " | ".join(n for n, _ in numbers) + " |",
             "|" + "---|" * len(numbers), "| " + " | ".join(v for _, v in numbers) + " |", "",
             f"![{title}: the map with route and flight]({name}.png)", "",
             f"![{title}: profiles of the flight]({name}_profile.png)", ""]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(prog="scripts/gallery", description=__doc__)
    parser.add_argument("--data", type=pathlib.Path, default=regions.DATA, help="folder with the real region's files")
    parser.add_argument("--program", type=pathlib.Path, default=regions.ROOT / "build/release/hedgehop",
                        help=argparse.SUPPRESS)
    parser.add_argument("--out", type=pathlib.Path, default=FOLDER, help="folder to write to (default: docs/gallery)")
    arguments = parser.parse_args()
    if not shutil.which("pngquant"):
        sys.exit("gallery: pngquant is not installed; scripts/setup --gallery installs it")
    work = regions.ROOT / "build/gallery"
    work.mkdir(parents=True, exist_ok=True)
    folders, commands, absent = regions.prepare(arguments.program.resolve(), work, arguments.data.resolve(),
                                                ["synthetic", "bayreuth"])
    if absent:
        sys.exit(f"gallery: {next(iter(absent.values()))}; --data names the folder")
    arguments.out.mkdir(parents=True, exist_ok=True)
    entries = []
    for mission in MISSIONS:
        name, _, region, settings, _ = mission
        print(f"gallery: {name}", file=sys.stderr)
        options = [part for setting in settings for part in ("--set", setting)]
        plan = work / name
        regions.run_json([arguments.program.resolve(), "plan", "--map", folders[region], "--mission",
                          FOLDER / f"{name}.yaml", *options, "--out", plan, "--overwrite", "--figures", "--json"],
                         work / f"{name}.log")
        for figure, target in (("map", name), ("profile", f"{name}_profile")):
            picture(plan / "figures" / f"{figure}.png", arguments.out / f"{target}.png")
        shown = " ".join(["hedgehop plan --map", str(folders[region].relative_to(work)),
                          f"--mission docs/gallery/{name}.yaml", *options, f"--out {name} --figures"])
        entries.append(entry(mission, shown, json.loads((plan / "plan.json").read_text(encoding="utf-8"))))
    head = ["# Gallery", "", "Six missions, planned by `scripts/gallery`, which writes this page. The maps:", "",
            *[f"    {command}" for command in commands.values()], ""]
    (arguments.out / "README.md").write_text("\n".join(head) + "\n" + "\n".join(entries), encoding="utf-8")


if __name__ == "__main__":
    main()
