#!/usr/bin/env python3
"""Draws the paper's figures of local planning from flights made anew: the polar histogram on terrain (its figure 5),
a purely local flight beside a guided one (6), growing weights of risk with one pass and three (8)."""

import argparse
import cmath
import json
import math
import pathlib
import subprocess
import sys

import regions

FOLDER = regions.ROOT / "docs/local_figures"
STEP_S = 0.05
MASK, FREE = "#c0392b", "#2e9e4f"
ONCE, THRICE = "#2e9e4f", "#e67e22"


def table(file):
    return [[float(word) for word in line.split()] for line in file.read_text().splitlines() if line.strip()]


def numbers(data):
    rows = []
    for line in (data / "numbers.txt").read_text().splitlines():
        name, *values = line.split()
        weight, length_m, risk_m, height_m = map(float, values)
        rows.append({"name": name, "weight": weight, "length_m": length_m, "risk_m": risk_m, "height_m": height_m})
    return rows


def draw(data, out, name, size, script):
    """Runs gnuplot in the folder of the tables."""
    head = f"set terminal pngcairo size {size} font 'DejaVu Sans,10'\nset output '{(out / name).resolve()}'\n"
    done = subprocess.run(["gnuplot"], input=head + script, text=True, cwd=data, capture_output=True, check=False)
    if done.returncode != 0 or "warning" in done.stderr:
        sys.exit(f"local_figures: gnuplot refused {name}: {done.stderr}")


def histogram(data, out):
    """Terrain around the vehicle; around it, sector by sector, the climb that it needs and whether that can be flown."""
    x_m, y_m, altitude_m, heading_rad, limit, window_m, radius_m, safety_m = table(data / "histogram_view.txt")[0]
    sectors = table(data / "histogram_sectors.txt")
    count = len(sectors)
    outer = window_m + 100.0
    # Climb as a radius: level flight on the ring of half the window.
    scale = 0.35 * window_m / limit
    level = 0.5 * window_m

    def radius(tangent):
        return max(20.0, min(window_m, level + scale * max(tangent, -3.0 * limit)))

    def ring(column, file):
        with open(data / file, "w", encoding="utf-8") as lines:
            for k in range(count + 1):
                azimuth = sectors[k % count][0]
                r = radius(sectors[k % count][column])
                lines.write(f"{r * math.cos(azimuth)} {r * math.sin(azimuth)}\n")

    ring(1, "ring_climb.txt")
    ring(2, "ring_masked.txt")
    with open(data / "halo.txt", "w", encoding="utf-8") as halo:
        for azimuth, _, _, is_free in sectors:
            for at in (-0.5, 0.0, 0.5):
                angle = azimuth + at * 2.0 * math.pi / count
                halo.write(f"{outer * math.cos(angle)} {outer * math.sin(angle)} {FREE if is_free else MASK}\n"
                           .replace("#", "0x"))
            halo.write("\n")
    with open(data / "arcs.txt", "w", encoding="utf-8") as arcs:
        for bend in (-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0):
            for s in (window_m * part / 40 for part in range(41)):
                turn = bend * s / radius_m
                chord = s if abs(turn) < 1e-9 else 2.0 * radius_m / abs(bend) * math.sin(abs(turn) / 2.0)
                angle = heading_rad + turn / 2.0
                arcs.write(f"{chord * math.cos(angle)} {chord * math.sin(angle)}\n")
            arcs.write("\n")
    draw(data, out, "histogram.png", "900,760", f"""
set size ratio -1
set xrange [-{outer + 40}:{outer + 40}]
set yrange [-{outer + 40}:{outer + 40}]
set xlabel 'east of the vehicle [m]'
set ylabel 'north of the vehicle [m]'
set cblabel 'surface and safety height above the vehicle [m]'
set palette defined (-1 '#f7f3e8', 0 '#f2d9a0', 1 '#b5372a')
set key above
set style fill solid noborder
set parametric
plot 'histogram_terrain.txt' using 1:2:($3 + {safety_m} - {altitude_m}) with image notitle, \\
  'ring_masked.txt' using 1:2 with filledcurves closed lc rgb '#602c4f9e' title 'climb with the arc mask', \\
  'ring_climb.txt' using 1:2 with filledcurves closed lc rgb '#6035c8c0' title 'climb of straight flight', \\
  'arcs.txt' using 1:2 with lines lc rgb 'white' lw 2 notitle, \\
  'halo.txt' using 1:2:3 with lines lw 9 lc rgb variable notitle, \\
  {level}*cos(t), {level}*sin(t) with lines lc rgb 'black' dt 3 title 'level flight', \\
  {radius(limit)}*cos(t), {radius(limit)}*sin(t) with lines lc rgb 'black' title 'steepest climb', \\
  NaN, NaN with lines lw 2 lc rgb '#dddddd' title 'turns of the vehicle', \\
  NaN, NaN with lines lw 9 lc rgb '{FREE}' title 'may be flown', \\
  NaN, NaN with lines lw 9 lc rgb '{MASK}' title 'may not'
""")
    return {"free": sum(1 for row in sectors if row[3]), "sectors": count}


def guided(data, out):
    draw(data, out, "guided.png", "900,760", """
set size ratio -1
set xlabel 'east [km]'
set ylabel 'north [km]'
set cblabel 'surface [m]'
set palette defined (0 '#e9f0df', 1 '#c9b48a', 2 '#7d5a3c')
set key above
set autoscale fix
stats 'region.txt' using 1 name 'X' nooutput
stats 'region.txt' using 2 name 'Y' nooutput
plot 'region.txt' using (($1-X_min)/1000):(($2-Y_min)/1000):3 with image notitle, \\
  'purely_local.txt' using (($1-X_min)/1000):(($2-Y_min)/1000) with lines lw 3 lc rgb '#2e9e4f' title 'purely local', \\
  'guided.txt' using (($1-X_min)/1000):(($2-Y_min)/1000) with lines lw 3 lc rgb '#2c4f9e' title 'guided by a global route'
""")


def spectrum(data, name, frequencies):
    """Amplitude of the bank angle at each frequency [rad s], from means of four steps."""
    bank = [row[3] for row in table(data / name)]
    means = [sum(bank[at:at + 4]) / 4.0 for at in range(0, len(bank) - 3, 4)]
    amplitudes = []
    for frequency in frequencies:
        turn = cmath.exp(-2j * math.pi * frequency * 4.0 * STEP_S)
        phase, total = 1.0, 0.0
        for value in means:
            total += value * phase
            phase *= turn
        amplitudes.append(abs(total) * 4.0 * STEP_S)
    return amplitudes


def weights(data, out, rows):
    values = sorted({row["weight"] for row in rows if row["name"] == "once"})
    shown = [at for at, value in enumerate(values) if value > 0.0]
    frequencies = [0.01 * at for at in range(1, 101)]
    columns = {}
    for kind in ("once", "thrice"):
        flights = [spectrum(data, f"{kind}_{at}.txt", frequencies) for at in shown]
        columns[kind] = [sum(values) for values in zip(*flights)]
    greatest = max(columns["once"])
    powers = {kind: sum(value ** 2 for value, frequency in zip(column, frequencies) if frequency > 0.1)
              for kind, column in columns.items()}
    with open(data / "spectrum.txt", "w", encoding="utf-8") as lines:
        for row in zip(frequencies, columns["once"], columns["thrice"]):
            lines.write(f"{row[0]} {row[1] / greatest} {row[2] / greatest}\n")
    with open(data / "totals.txt", "w", encoding="utf-8") as lines:
        for value in values:
            at = {row["name"]: row for row in rows if row["weight"] == value and row["name"] in ("once", "thrice")}
            lines.write(" ".join(str(part) for part in (
                value, at["once"]["risk_m"], at["thrice"]["risk_m"], at["once"]["length_m"],
                at["once"]["risk_m"] / at["once"]["length_m"])) + "\n")
    flights = ", \\\n  ".join(
        f"'{kind}_{at}.txt' using ($1/1000):($2/1000) with lines lw {1 + 0.3 * at} lc rgb '{colour}' "
        + (f"title '{words}'" if at == shown[0] else "notitle")
        for kind, colour, words in (("once", ONCE, "one pass"), ("thrice", THRICE, "three passes")) for at in shown)
    draw(data, out, "weights.png", "900,1150", f"""
set multiplot
set origin 0,0.42
set size 1,0.58
set size ratio -1
set xlabel 'east [km]'
set ylabel 'north [km]'
set cblabel 'seen by, share'
set palette defined (0 '#3b3f8f', 1 '#f5e04e')
set autoscale fix
set key above
plot 'seen.txt' using ($1/1000):($2/1000):3 with image notitle, \\
  'once_0.txt' using ($1/1000):($2/1000) with lines lw 2 dt 2 lc rgb '#bbbbbb' title 'no weight', \\
  {flights}
unset colorbox
set size noratio
set key inside top right vertical
set origin 0,0.0
set size 0.5,0.4
set xlabel 'frequency [Hz]'
set ylabel 'bank, normalised'
set logscale y
set xrange [0:1]
set yrange [1e-3:2]
set format y '10^{{%T}}'
plot 'spectrum.txt' using 1:2 with lines lc rgb '{ONCE}' title 'one pass', \\
  'spectrum.txt' using 1:3 with lines lc rgb '{THRICE}' title 'three passes'
unset logscale y
set format y '%g'
set origin 0.5,0.0
set autoscale
set xlabel 'weight of visibility'
set ylabel 'risk summed over the way [m]'
set y2label 'risk per metre'
set y2tics
set ytics nomirror
set key inside right center vertical
plot 'totals.txt' using 1:2 with linespoints lc rgb '{ONCE}' pt 7 title 'one pass', \\
  'totals.txt' using 1:3 with linespoints lc rgb '{THRICE}' pt 7 title 'three passes', \\
  'totals.txt' using 1:5 axes x1y2 with linespoints lc rgb '#555555' dt 3 pt 6 title 'per metre, one pass'
unset multiplot
""")
    return powers


def page(rows, sectors, powers, commands, attributions):
    by_name = {row["name"]: row for row in rows if row["name"] in ("purely_local", "guided")}

    def line(name, words):
        row = by_name[name]
        return f"| {words} | {row['length_m'] / 1000:.1f} | {row['height_m']:.0f} | {row['risk_m']:.0f} |"

    once = [row for row in rows if row["name"] == "once"]
    least = min(once, key=lambda row: row["risk_m"])
    last = max(once, key=lambda row: row["weight"])
    lines = [
        "# Figures of local planning", "",
        "Three figures of the paper, from flights made anew by `scripts/local_figures`, which writes this page. The map:", "",
        *[f"    {command}" for command in commands.values()], "", f"Made from: {'; '.join(attributions)}.", "",
        "## The polar histogram on terrain", "",
        "The paper's figure 5. Around the vehicle, in each direction, the climb that straight flight over the terrain needs (turquoise), and",
        "the same with what the arcs of its turns cannot clear (blue); further out is steeper. A direction is masked (red on the ring) when",
        f"it needs more than the vehicle can climb: {sectors['free']} of {sectors['sectors']} may be flown here. The place is the one of "
        "the purely", "local flight below where the mask divides the sectors most evenly.", "",
        "![Terrain around the vehicle, climb angles by direction, and a ring of directions that may or may not be flown](histogram.png)",
        "", "## Purely local and guided", "",
        "The paper's figure 6. The same local planner, with the direction of its target as the only cost: steering at the goal itself, or",
        "following the route of the global planner, which weighs what is seen and how high it is.", "",
        "| | length [km] | mean height [m] | visibility over the way [m] |", "|---|---|---|---|",
        line("purely_local", "purely local"), line("guided", "guided"), "",
        "![The region from above with both flights](guided.png)", "",
        "## Growing weight of risk", "",
        "The paper's figure 8. Flat ground; a strip that everybody sees lies across the way, obliquely. Purely local flights with a growing",
        "weight of visibility, and the same flown twice more, each time guided by the flight before and with a smaller window.",
        f"Risk summed over the way is least at a weight of {least['weight']:g}, {least['risk_m']:.0f} m; at {last['weight']:g} it is "
        f"{last['risk_m']:.0f} m, on a way",
        f"of {last['length_m'] / 1000:.1f} km instead of {least['length_m'] / 1000:.1f} km"
        + (": too large a weight makes flights longer than it makes them safer." if last["risk_m"] > least["risk_m"] else "."),
        f"Above 0.1 Hz, three passes have {100 * powers['thrice'] / powers['once']:.0f} % of the power of bank that one pass has.", "",
        "![Flights over the map of visibility, the spectrum of their bank, and their risk by weight](weights.png)", ""]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(prog="scripts/local_figures", description=__doc__)
    parser.add_argument("--data", type=pathlib.Path, default=regions.DATA, help="folder with the real region's files")
    parser.add_argument("--build", type=pathlib.Path, default=regions.ROOT / "build/release", help=argparse.SUPPRESS)
    parser.add_argument("--map", type=pathlib.Path, help="another map than the one that is made from --data")
    parser.add_argument("--out", type=pathlib.Path, default=FOLDER, help="folder to write to (default: docs/local_figures)")
    arguments = parser.parse_args()
    build = arguments.build.resolve()
    work = build / "local_figures"
    work.mkdir(parents=True, exist_ok=True)
    if arguments.map:
        folder, commands = arguments.map.resolve(), {"map": f"{arguments.map.name}, given"}
    else:
        folders, commands, absent = regions.prepare(build / "hedgehop", work, arguments.data.resolve(), ["hsinchu"])
        if absent:
            sys.exit(f"local_figures: {next(iter(absent.values()))}; --data names the folder, --map another map")
        folder = folders["hsinchu"]
    attributions = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["attributions"]
    arguments.out.mkdir(parents=True, exist_ok=True)
    done = subprocess.run([build / "examples/local_figures", folder, work], check=False)
    if done.returncode != 0:
        sys.exit("local_figures: no flights, so no figures")
    rows = numbers(work)
    sectors = histogram(work, arguments.out)
    guided(work, arguments.out)
    powers = weights(work, arguments.out, rows)
    (arguments.out / "README.md").write_text(page(rows, sectors, powers, commands, attributions),
                                             encoding="utf-8")


if __name__ == "__main__":
    main()
