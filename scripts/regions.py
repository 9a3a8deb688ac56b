"""The regions that scripts measure and draw: how their maps are made, from files that a user has."""

import json
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("HEDGEHOP_DATA", ROOT.parent / "shared/data"))
NAMES = ("synthetic", "bayreuth", "hsinchu")


def run_json(command, log):
    """Standard output as JSON; progress goes on to the terminal, or into the log."""
    with open(log, "w", encoding="utf-8") as errors:
        done = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, text=True,
                              stderr=None if sys.stderr.isatty() else errors, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} ended with {done.returncode}; see {log}")
    return json.loads(done.stdout)


def prepare(program, work, data, asked):
    """Folders of maps and the commands that made them, by region; and why others are left out."""
    folders, commands, absent = {}, {}, {}
    files = {
        "bayreuth": ["--dem", data / "bayreuth/N49E011.hgt.zip", "--dem", data / "bayreuth/N50E011.hgt.zip",
                     "--osm", data / "bayreuth/bayreuth_north_2014.osm.gz", "--bbox", "11.38,49.87,11.69,50.11"],
        "hsinchu": ["--dem", data / "hsinchu/hsinchu_moi20m.tif",
                    "--vectors", data / "hsinchu/hsinchu_topo25k.gpkg", "--mapping", "taiwan_topo25k"],
    }
    for name in asked:
        if name == "synthetic":
            folder = work / "demo"
            commands[name] = "hedgehop demo --out demo"
            if not (folder / "map/manifest.json").exists():
                run_json([program, "demo", "--out", folder, "--overwrite", "--json"], work / "demo.log")
            folders[name] = folder / "map"
            continue
        missing = [part for part in files[name] if isinstance(part, pathlib.Path) and not part.exists()]
        if missing:
            absent[name] = f"{missing[0].name} is not there"
            continue
        folder = work / f"map_{name}"
        words = [part.name if isinstance(part, pathlib.Path) else part for part in files[name]]
        commands[name] = f"hedgehop prepare {' '.join(words)} --out {folder.name}"
        if not (folder / "manifest.json").exists():
            run_json([program, "prepare", *files[name], "--out", folder, "--overwrite", "--json"],
                     work / f"prepare_{name}.log")
        folders[name] = folder
    return folders, commands, absent
