#!/usr/bin/env python3
"""Feeds `hedgehop prepare` files that were damaged in a thousand ways; run by scripts/fuzz.

Each round damages one valid input (elevation, OpenStreetMap, vectors, mapping, obstacles, areas) and
prepares a small map with it. The program must end by itself, with exit code 0, 2 or 5, say something on stderr when it
refuses, leave no output behind then, and a bundle that `hedgehop info` reads when it does not.

  mangled_files.py --hedgehop PROGRAM [--seconds N] [--seed N] [--keep FOLDER]
"""

import argparse
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "cli"))
import synthetic_inputs  # noqa: E402

TIME_LIMIT_S = 120
BBOX = "11.45,49.53,11.48,49.55"
MAPPING = """attribution: "(c) surveyor"
coverage_layers: [land]
rules:
  - {layer: land, attribute: kind, values: [wood], class: forest, height_attribute: height, height_unit: m}
  - {layer: land, attribute: kind, values: [house], class: building, levels_attribute: levels}
  - {layer: land, attribute: kind, values: [cable], class: power_line, default_height_m: 30}
"""
GEOJSON = """{"type": "FeatureCollection", "name": "land", "features": [
{"type": "Feature", "properties": {"kind": "wood", "height": "12'6\\"", "levels": 0}, "geometry":
 {"type": "Polygon", "coordinates": [[[11.45, 49.53], [11.46, 49.53], [11.46, 49.54], [11.45, 49.53]]]}},
{"type": "Feature", "properties": {"kind": "house", "height": null, "levels": 3}, "geometry":
 {"type": "MultiPolygon", "coordinates": [[[[11.465, 49.53], [11.466, 49.53], [11.466, 49.531], [11.465, 49.53]]]]}},
{"type": "Feature", "properties": {"kind": "cable", "height": "", "levels": 1}, "geometry":
 {"type": "LineString", "coordinates": [[11.45, 49.545], [11.46, 49.546], [11.48, 49.54]]}}]}
"""

AREAS = """{"type": "FeatureCollection", "name": "areas", "features": [
{"type": "Feature", "properties": {"name": "one", "kind": "no_fly", "floor": "GND", "ceiling": "FL 65"}, "geometry":
 {"type": "Polygon", "coordinates": [[[11.45, 49.53], [11.46, 49.53], [11.46, 49.54], [11.45, 49.53]]]}}]}
"""


def make_inputs(folder):
    """Valid files; returns cases: (name of the file to damage, arguments with {} in its place)."""
    tile = folder / "N49E011.hgt"
    synthetic_inputs.write_hgt(tile)
    synthetic_inputs.zip_of(folder / "N49E011.hgt.zip", tile)
    for name in ("land.osm", "land.osm.gz", "land.osm.bz2"):
        synthetic_inputs.write_osm(folder / name, synthetic_inputs.land_use())
    (folder / "mapping.yaml").write_text(MAPPING)
    (folder / "land.geojson").write_text(GEOJSON)
    window = ["-q", "-projwin", "11.40", "49.60", "11.53", "49.48", str(tile)]
    made = [("dem.tif", "GTiff", ["-co", "COMPRESS=DEFLATE", "-co", "TILED=YES", "-co", "PREDICTOR=2"]),
            ("plain.tif", "GTiff", []), ("dem.asc", "AAIGrid", []), ("dem.vrt", "VRT", []),
            ("dem.bil", "EHdr", [])]
    for name, driver, options in made:
        subprocess.run(["gdal_translate", "-of", driver, *options, *window, str(folder / name)], check=True)
    for name, driver in (("land.gpkg", "GPKG"), ("land.shp", "ESRI Shapefile"), ("land.kml", "KML"),
                         ("land.fgb", "FlatGeobuf")):
        where = ["-where", "kind = 'wood'"] if driver == "ESRI Shapefile" else []
        subprocess.run(["ogr2ogr", "-f", driver, "-nln", "land", *where, str(folder / name),
                        str(folder / "land.geojson")], check=True, stderr=subprocess.DEVNULL)
    good = str(folder / "plain.tif")
    cases = [(name, ["--dem", "{}"]) for name, _, _ in made]
    cases += [("N49E011.hgt.zip", ["--dem", "{}"])]
    cases += [(name, ["--dem", good, "--osm", "{}"]) for name in ("land.osm", "land.osm.gz", "land.osm.bz2")]
    mapping = str(folder / "mapping.yaml")
    cases += [(name, ["--dem", good, "--vectors", "{}", "--mapping", mapping])
              for name in ("land.geojson", "land.gpkg", "land.shp", "land.kml", "land.fgb")]
    corpus = pathlib.Path(__file__).resolve().parent / "corpus"
    shutil.copy(corpus / "obstacle_file_fuzz" / "columns.dat", folder / "dof.dat")
    (folder / "masts.csv").write_text("lat,lon,height_m,accuracy,name\n49.54,11.46,80,1A,one\n49.545,11.47,60,5D,two\n")
    (folder / "airspace.txt").write_text("AC R\nAN one\nAL 100 ft AGL\nAH FL 65\nV X=49:32:24 N 011:27:36 E\nDC 0.5\n"
                                         "AC Q\nDP 49:32:00 N 011:27:00 E\nDP 49:32:30 N 011:28:00 E\nDP 49:33:00 N 011:27:00 E\n")
    (folder / "areas.geojson").write_text(AREAS)
    for name, driver in (("areas.gpkg", "GPKG"), ("areas.kml", "KML")):
        subprocess.run(["ogr2ogr", "-f", driver, "-nln", "areas", str(folder / name), str(folder / "areas.geojson")],
                       check=True, stderr=subprocess.DEVNULL)
    cases += [(name, ["--dem", good, "--obstacles", "{}"]) for name in ("dof.dat", "masts.csv")]
    cases += [(name, ["--dem", good, "--areas", "{}"])
              for name in ("airspace.txt", "areas.geojson", "areas.gpkg", "areas.kml")]
    cases += [("mapping.yaml", ["--dem", good, "--vectors", str(folder / "land.gpkg"), "--mapping", "{}"])]
    return cases


WORDS = [b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"99999999999999999999", b"null", b"''", b"{", b"]",
         b"\xff\xfe", b"<", b"&#0;", b"1e-320", b"-32768"]


def damaged(data, dice):
    data = bytearray(data)
    for _ in range(dice.choice([1, 1, 2, 3, 8, 40])):
        if not data:
            break
        # Half of the damage hits the beginning, where headers are.
        reach = len(data) if dice.random() < 0.5 else min(len(data), 512)
        at = dice.randrange(reach)
        kind = dice.randrange(8)
        if kind == 0:
            data[at] ^= 1 << dice.randrange(8)
        elif kind == 1:
            data[at] = dice.choice([0, 1, 0x7f, 0x80, 0xff, dice.randrange(256)])
        elif kind == 2:
            del data[dice.randrange(len(data)):]
        elif kind == 3:
            del data[at:at + dice.choice([1, 2, 4, 16, 300])]
        elif kind == 4:
            data[at:at] = data[at:at + dice.choice([1, 8, 64, 1000])]
        elif kind == 5:
            size = dice.choice([2, 4, 8])
            data[at:at + size] = dice.choice([b"\0", b"\xff", b"\x7f"]) * size
        elif kind == 6:
            data[at:at + dice.choice([0, 1, 3])] = dice.choice(WORDS)
        else:
            begin = at
            while begin < len(data) and not chr(data[begin]).isdigit():
                begin += 1
            end = begin
            while end < len(data) and chr(data[end]) in "0123456789.":
                end += 1
            data[begin:end] = dice.choice(WORDS)
    return bytes(data)


def complaint(program, arguments, folder, out):
    """What is wrong with how the program behaved, or None; and its exit code."""
    environment = dict(os.environ, ASAN_OPTIONS="exitcode=99:allocator_may_return_null=1",
                       UBSAN_OPTIONS="halt_on_error=1:exitcode=99")
    try:
        done = subprocess.run([program, "prepare", *arguments, "--bbox", BBOX, "--set", "visibility.radius_m=300",
                               "--threads", "1", "--out", str(out)], capture_output=True, timeout=TIME_LIMIT_S,
                              env=environment, cwd=folder)
    except subprocess.TimeoutExpired:
        return f"did not end within {TIME_LIMIT_S} s", None
    talk = done.stderr.decode(errors="replace")
    if done.returncode not in (0, 2, 5):
        return f"exit code {done.returncode}: {talk[-2000:]}", done.returncode
    if "runtime error:" in talk or "Sanitizer" in talk:
        return f"sanitizer: {talk[-2000:]}", done.returncode
    if done.returncode != 0:
        if not talk.strip():
            return "refused without a word", done.returncode
        if out.exists():
            return "refused, but left an output folder", done.returncode
        return None, done.returncode
    look = subprocess.run([program, "info", str(out)], capture_output=True, timeout=TIME_LIMIT_S, env=environment)
    if look.returncode != 0:
        return "wrote a bundle that cannot be read: " + look.stderr.decode(errors="replace"), 0
    return None, 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hedgehop", required=True, help="the program")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=None, help="of an earlier run, to repeat it")
    parser.add_argument("--keep", type=pathlib.Path, default=pathlib.Path("build/fuzz/crashes"),
                        help="folder for files that did harm")
    options = parser.parse_args()
    program = str(pathlib.Path(options.hedgehop).resolve())
    seed = options.seed if options.seed is not None else random.SystemRandom().randrange(1 << 48)
    print(f"mangled_files: seed {seed}", flush=True)
    dice = random.Random(seed)
    counts = {}
    findings = 0
    rounds = 0
    with tempfile.TemporaryDirectory(prefix="hedgehop-mangled-") as name:
        folder = pathlib.Path(name)
        cases = make_inputs(folder)
        for victim, arguments in cases:  # undamaged, all of them must work
            out = folder / "map"
            wrong, code = complaint(program, [a.format(str(folder / victim)) for a in arguments], folder, out)
            if wrong or code != 0:
                print(f"mangled_files: {victim} is refused although it is whole: {wrong}", file=sys.stderr)
                return 1
            shutil.rmtree(out)
        begin = time.monotonic()
        while time.monotonic() - begin < options.seconds:
            victim, arguments = dice.choice(cases)
            whole = (folder / victim).read_bytes()
            bad = damaged(whole, dice)
            out = folder / "map"
            (folder / victim).write_bytes(bad)
            wrong, code = complaint(program, [a.format(str(folder / victim)) for a in arguments], folder, out)
            (folder / victim).write_bytes(whole)
            for left in folder.glob("*.aux.xml"):
                left.unlink()
            shutil.rmtree(out, ignore_errors=True)
            rounds += 1
            counts[code] = counts.get(code, 0) + 1
            if wrong:
                findings += 1
                options.keep.mkdir(parents=True, exist_ok=True)
                kept = options.keep / f"mangled-{seed}-{rounds}-{victim}"
                kept.write_bytes(bad)
                print(f"mangled_files: {kept} with {' '.join(arguments)}: {wrong}", file=sys.stderr, flush=True)
    summary = ", ".join(f"{count} ended with {code}" for code, count in sorted(counts.items(), key=str))
    print(f"mangled_files: {rounds} rounds, {findings} findings ({summary})")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
