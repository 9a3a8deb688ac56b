#!/usr/bin/env python3
"""The report in a real browser: no word on the console, cursors that go together, readable on a wide and a narrow
window. Exits with 77 and a line "skipped: reason" where no Chromium is installed (scripts/setup --browser).

  report_browser_test.py --hedgehop PROGRAM --inputs FOLDER [--pictures FOLDER]
      --inputs holds the folders `map` and `plan`; --pictures keeps screenshots to look at.
"""

import argparse
import csv
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

START = "2026-05-01T06:30:00Z"
DECLINATION_DEG = 4.0
# Runs after the page's own script: moves the pointer as a person would, then writes down what it sees.
PROBE = """
<script>
window.addEventListener("load", () => {
  const svg = document.querySelector("#chart-bank svg");
  const box = svg.getBoundingClientRect();
  svg.dispatchEvent(new PointerEvent("pointermove", {clientX: box.left + 0.25 * box.width, clientY: box.top + 5, bubbles: true}));
  const seen = {cursors: Array.from(document.querySelectorAll("line.cursor"), (line) => Number(line.getAttribute("x1"))),
                marker: document.getElementById("marker").getAttribute("transform"),
                time: document.querySelector("dd[data-field=time]").textContent};
  const map = document.getElementById("map");
  const goal = JSON.parse(document.getElementById("flight").textContent);
  const last = goal.x.length - 1;
  const point = new DOMPoint(goal.x[last], goal.y[last]).matrixTransform(map.getScreenCTM());
  map.dispatchEvent(new PointerEvent("pointermove", {clientX: point.x, clientY: point.y, bubbles: true}));
  seen.at_goal = document.querySelector("dd[data-field=time]").textContent;
  document.querySelectorAll("tr.jump")[0].click();
  seen.after_click = document.querySelector("dd[data-field=time]").textContent;
  seen.first_manoeuvre = Number(document.querySelectorAll("tr.jump")[0].dataset.time);
  const layer = document.querySelector("g.layer-visibility");
  seen.before_switch = getComputedStyle(layer).display;
  document.getElementById("layer-visibility").click();
  seen.after_switch = getComputedStyle(layer).display;
  document.getElementById("zoom-in").click();
  seen.zoomed = map.getAttribute("viewBox");
  seen.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  const note = document.createElement("pre");
  note.id = "seen";
  note.textContent = JSON.stringify(seen);
  document.body.appendChild(note);
});
</script>
"""


def fail(what):
    print(f"FAILED: {what}")
    sys.exit(1)


def expect(condition, what):
    if not condition:
        fail(what)


def clock(seconds):
    return "%02d:%02d" % divmod(round(seconds), 60)


class Browser:
    def __init__(self, program, folder):
        self.command = [program, "--headless", "--disable-gpu", "--no-first-run", "--hide-scrollbars", "--enable-logging=stderr",
                        "--allow-file-access-from-files", "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder}/profile"]
        if os.geteuid() == 0:
            self.command.append("--no-sandbox")

    def run(self, *arguments):
        result = subprocess.run([*self.command, *arguments], capture_output=True, text=True, timeout=120)
        expect(result.returncode == 0, f"chromium: exit code {result.returncode}\n{result.stderr}")
        said = [line for line in result.stderr.splitlines() if ":CONSOLE" in line]
        expect(not said, "the page wrote on the console: " + "\n".join(said))
        return result.stdout


def field(dom, name):
    match = re.search(rf'<dd data-field="{name}">([^<]*)</dd>', dom)
    expect(match is not None, f"no field {name}")
    return match.group(1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hedgehop", required=True)
    parser.add_argument("--inputs", type=pathlib.Path, required=True)
    parser.add_argument("--pictures", type=pathlib.Path)
    arguments = parser.parse_args()
    program = shutil.which("chromium")
    if program is None:
        print("skipped: no chromium here; scripts/setup --browser installs it")
        return 77
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(scratch)
        page = work / "report.html"
        subprocess.run([arguments.hedgehop, "report", arguments.inputs / "plan", "--map", arguments.inputs / "map", "--no-figures",
                        "--start-time", START, "--declination-deg", str(DECLINATION_DEG), "--out", page, "-q"], check=True,
                       stdout=subprocess.DEVNULL)
        browser = Browser(program, work)
        with open(arguments.inputs / "plan" / "trajectory.csv", newline="") as file:
            states = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        along = [0.0]
        for before, after in zip(states, states[1:]):
            along.append(along[-1] + ((after["x_m"] - before["x_m"]) ** 2 + (after["y_m"] - before["y_m"]) ** 2) ** 0.5)

        # The page opens with the cursor at a time, and says what the trajectory says there.
        time_s = 60.0
        dom = browser.run("--dump-dom", f"{page.as_uri()}#t={time_s}")
        expect('class="no-script"' not in dom, "the script did not run: its hash or the policy is wrong")
        state, flown = min(zip(states, along), key=lambda pair: abs(pair[0]["time_s"] - time_s))
        expect(field(dom, "time") == clock(time_s), f"time {field(dom, 'time')}")
        expect(field(dom, "eta") == "06:31:00Z", f"eta {field(dom, 'eta')}")
        expect(abs(float(field(dom, "altitude").split()[0]) - state["altitude_m"]) <= 1.5, f"altitude {field(dom, 'altitude')}")
        heading = state["heading_true_rad"] * 57.29577951308232
        for name, wanted in (("true", heading), ("grid", state["heading_grid_rad"] * 57.29577951308232),
                             ("magnetic", heading - DECLINATION_DEG)):
            expect(abs((float(field(dom, name)[:3]) - wanted + 180.0) % 360.0 - 180.0) <= 1.6, f"{name} heading {field(dom, name)}")
        latitude, longitude = (float(word) for word in field(dom, "place").split(","))
        expect(abs(latitude - state["latitude_deg"]) < 2e-4 and abs(longitude - state["longitude_deg"]) < 4e-4, field(dom, "place"))
        cursors = re.findall(r'<line class="cursor" x1="([0-9.]+)"', dom)
        expect(len(cursors) == 5 and len(set(cursors)) == 1, f"cursors {cursors}")
        expect(abs(float(cursors[0]) - 1000.0 * flown / along[-1]) < 2.0, f"cursor at {cursors[0]}")

        # The pointer on one plot moves the cursors of all, the marker on the map and the words; so does the map.
        probed = work / "probed.html"
        text = page.read_text(encoding="utf-8")
        probed.write_text(re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text).replace("</body>", PROBE + "</body>"),
                          encoding="utf-8")
        dom = browser.run("--window-size=1400,1000", "--dump-dom", probed.as_uri())
        match = re.search(r'<pre id="seen">(.*?)</pre>', dom, re.S)
        expect(match is not None, "the probe did not run")
        seen = json.loads(match.group(1).replace("&gt;", ">").replace("&lt;", "<").replace("&amp;", "&"))
        expect(all(abs(x - 250.0) < 2.0 for x in seen["cursors"]), f"cursors {seen['cursors']} after the pointer")
        quarter = min(zip(states, along), key=lambda pair: abs(pair[1] - 0.25 * along[-1]))[0]
        expect(seen["time"] == clock(quarter["time_s"]) or abs(quarter["time_s"] - round(quarter["time_s"])) > 0.3, seen["time"])
        expect(seen["marker"] != "translate(0 0)", seen["marker"])
        expect(seen["at_goal"] == clock(states[-1]["time_s"]), f"pointer at the goal shows {seen['at_goal']}")
        expect(abs(int(seen["after_click"][:2]) * 60 + int(seen["after_click"][3:]) - seen["first_manoeuvre"]) <= 1.0, "click on a row")
        expect(seen["before_switch"] == "none" and seen["after_switch"] != "none", "the visibility layer cannot be switched on")
        expect(abs(float(seen["zoomed"].split()[2]) - 500.0) < 0.01, f"zoom {seen['zoomed']}")
        expect(seen["wide"] <= 0, f"the page is {seen['wide']} px too wide for 1400 px")

        # 400 px: a window of Chromium cannot be as narrow as that, a frame can.
        frame = work / "frame.html"
        frame.write_text('<body style="margin:0"><iframe src="report.html#t=60" style="width:400px;height:5000px;border:0"></iframe>'
                         '<pre id="seen"></pre><script>window.addEventListener("load", () => {'
                         'const root = document.querySelector("iframe").contentDocument.documentElement;'
                         'document.getElementById("seen").textContent = root.scrollWidth + " " + '
                         'root.querySelector("svg.map").getBoundingClientRect().width;});</script></body>')
        dom = browser.run("--window-size=600,1000", "--dump-dom", frame.as_uri())
        width, map_width = (float(word) for word in re.search(r'<pre id="seen">([^<]*)</pre>', dom).group(1).split())
        expect(width <= 400, f"the page is {width} px wide in a window of 400 px")
        expect(map_width >= 350, f"the map is {map_width} px wide in a window of 400 px")

        pictures = arguments.pictures or work
        pictures.mkdir(exist_ok=True)
        for name, address, size in (("wide", f"{page.as_uri()}#t=60", "1400,1000"), ("narrow", frame.as_uri(), "500,1600")):
            picture = pictures / f"report_{name}.png"
            browser.run(f"--screenshot={picture}", f"--window-size={size}", address)
            # An empty page packs into a few kilobytes.
            expect(picture.stat().st_size > 60_000, f"{picture} shows next to nothing")
    print("the report is fine in Chromium")
    return 0


if __name__ == "__main__":
    sys.exit(main())
