#!/usr/bin/env python3
"""The measured pages: what their scripts write, on a small scale, and what is committed."""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def sections(text):
    return re.findall(r"^## (.*)$", text, re.M)


def run_small(program, work):
    done = subprocess.run([sys.executable, ROOT / "scripts/reproduce_paper.py", "--small", "--program", program,
                           "--work", work], capture_output=True, text=True, check=False)
    check(done.returncode == 0, f"reproduce_paper --small: {done.stderr}")
    return (work / "results.md").read_text(encoding="utf-8")


def small_version_has_every_section_and_sane_values(program):
    committed = (ROOT / "docs/results.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        page = run_small(program, work)
        check(set(sections(page)) == set(sections(committed)),
              f"docs/results.md has other sections than a fresh page: {sections(page)} and {sections(committed)}")
        for picture in re.findall(r"\]\((images/results/.*?)\)", page):
            check((work / picture).stat().st_size > 2000, f"{picture} is no picture")
        for picture in re.findall(r"\]\((images/results/.*?)\)", committed):
            check((ROOT / "docs" / picture).exists(), f"docs/results.md shows {picture}, which is not there")

        def result(name):
            return json.loads((work / f"measured/{name}.json").read_text(encoding="utf-8"))["result"]

        # Bounds that hold on any machine and for so few problems.
        rows = result("local-speed")["rows"]
        check(sum(row["paper_ms_per_km"] is not None and row["planner"] == "tvfh" for row in rows) == 28,
              "table 1 has 28 cells")
        check(all(row["same_bytes"] for row in rows), "fast and plain forms fly the same bytes")
        check(result("protection_synthetic")["error"]["mean_abs"] <= 0.002, "visibility near its oracle")
        drawn = result("random_synthetic")
        check(drawn["verified"] + drawn["named_cause"] == drawn["drawn"], "random missions end well")
        check(drawn["visibility_change"] < 0, "weights make flights less seen")
        optimised = result("table2_synthetic")["comparisons"][0]
        check(optimised["name"] == "optimised" and optimised["regressions"] == 0, "never worse than plain following")
        check(optimised["height"]["change"] < -0.09, "the vertical pass sinks")
        for row in result("local-safety_synthetic")["rows"]:
            check(row["reached"] == row["flights"] and row["collisions"] == 0, f"safe flights: {row['planner']}")
        best = {row["planner"]: row["cost_over_best_median"] for row in result("optimality_synthetic")["rows"]}
        check(1.0 <= best["recommended"] < best["ompl_bitstar"], f"ours is nearer to the best: {best}")
        verifier = result("verifier_synthetic")
        check(verifier["false_alarms"] == verifier["accepted_wrongly"] == 0, "verifier agrees with brute force")
        base = [row for row in result("sensitivity_synthetic")["rows"] if row["is_base"]]
        check(len(base) == 3 and all(row["length"]["change"] == 0 for row in base), "base values change nothing")
        seen = {row["value"]: row["visibility"]["change"] for row in result("sensitivity_synthetic")["rows"]
                if row["parameter"] == "weights.visibility"}
        check(seen[0] > seen[100], "with its weight visibility sinks")
        table3 = result("table3_synthetic")
        check(table3["solved"] == 3 and table3["success"] >= 0.5, "problems are solved")
        framework = table3["comparisons"][0]
        check((framework["name"], framework["against"]) == ("framework", "dubins"), "the paper's comparison is first")
        if framework["pairs"]:
            check(framework["visibility"]["change"] < 0 and framework["height"]["change"] < 0,
                  "less seen and lower than the baseline")

        # Nothing is measured twice: the second page is the first.
        check(run_small(program, work) == page, "a second run changes the page")


def gallery_has_all_it_names(program):
    page = (ROOT / "docs/gallery/README.md").read_text(encoding="utf-8")
    pictures = re.findall(r"\]\((.*?\.png)\)", page)
    missions = re.findall(r"--mission docs/gallery/(\S+)\.yaml", page)
    check(len(missions) == len(set(missions)) >= 6 and len(pictures) == 2 * len(missions), "six missions, two pictures each")
    check({path.stem for path in (ROOT / "docs/gallery").glob("*.yaml")} == set(missions), "each mission file is shown")
    for picture in pictures:
        check((ROOT / "docs/gallery" / picture).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n", f"{picture} is no picture")
    check(page.count("| verified |") == len(missions), "every flight of the gallery is verified")
    # What is shown of the invented region comes out again, whoever plans it.
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        for command in ([program, "demo", "--out", work / "demo", "-q"],
                        [program, "plan", "--map", work / "demo/map", "--mission",
                         ROOT / "docs/gallery/past_the_towns.yaml", "--out", work / "plan", "-q"]):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            check(done.returncode == 0, f"{command}: {done.stderr}")
        measures = json.loads((work / "plan/plan.json").read_text(encoding="utf-8"))["measures"]
        entry = page[page.index("--mission docs/gallery/past_the_towns.yaml"):]
        shown = re.search(r"^\| ([0-9.]+) km \| ([0-9.]+) min \| ([0-9.]+) m ", entry, re.M)
        check(shown.group(1) == f"{measures['length_m'] / 1000:.1f}" and
              shown.group(3) == f"{measures['mean_height_m']:.1f}",
              "the gallery's numbers are not those of a fresh plan; run scripts/gallery")


def local_figures_are_those_of_fresh_flights(program):
    page = (ROOT / "docs/local_figures/README.md").read_text(encoding="utf-8")
    for picture in re.findall(r"\]\((.*?\.png)\)", page):
        check((ROOT / "docs/local_figures" / picture).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n", f"{picture} is no picture")
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        for command in ([program, "demo", "--out", work / "demo", "-q"],
                        [sys.executable, ROOT / "scripts/local_figures.py", "--build", pathlib.Path(program).parent,
                         "--map", work / "demo/map", "--out", work / "figures"]):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            check(done.returncode == 0, f"{command}: {done.stderr}")
        fresh = (work / "figures/README.md").read_text(encoding="utf-8")
        check(sections(fresh) == sections(page), "docs/local_figures has other sections than a fresh page")
        for picture in ("histogram.png", "guided.png", "weights.png"):
            check((work / "figures" / picture).stat().st_size > 20000, f"{picture} is no picture")
        # The flights past the strip need no map: they are the same ones.
        weights = page[page.index("## Growing weight"):]
        check(weights == fresh[fresh.index("## Growing weight"):], "docs/local_figures is old; run scripts/local_figures")
        least, last, share = re.search(r"of [0-9.]+, (\d+) m; at [0-9.]+ it is (\d+) m,.*?have (\d+) % of the power", weights,
                                       re.S).groups()
        check(int(last) > 1.1 * int(least), "too large a weight adds to the risk")
        check(int(share) < 80, "passes smooth the flight")
        free, all_sectors = map(int, re.search(r"(\d+) of (\d+) may be flown", page).groups())
        check(0 < free < all_sectors, "some directions may be flown, some may not")
        heights = re.findall(r"^\| (?:purely local|guided) \| [0-9.]+ \| (\d+) \| (\d+) \|$", page, re.M)
        check(len(heights) == 2 and int(heights[1][0]) < int(heights[0][0]) and int(heights[1][1]) < int(heights[0][1]),
              "the guided flight is lower and less seen")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--program", required=True)
    parser.add_argument("test", choices=["small_version_has_every_section_and_sane_values", "gallery_has_all_it_names",
                                         "local_figures_are_those_of_fresh_flights"])
    arguments = parser.parse_args()
    globals()[arguments.test](arguments.program)


if __name__ == "__main__":
    main()
