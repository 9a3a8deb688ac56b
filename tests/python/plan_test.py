"""Planning, verification, plan bundles."""

import math
import pathlib
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest
from conftest import SOURCE, WORK

import hedgehop

FILES = ("plan.json", "route.geojson", "trajectory.csv")


def request_of(hills, **options):
    return hedgehop.Request(start=hills[1], goal=hills[2], work=WORK, **options)


def test_a_plan_has_the_bytes_of_the_command_line(hills, hills_map, command_line_plan, tmp_path):
    plan = hedgehop.plan(hills_map, request_of(hills), threads=1)
    plan.write(str(tmp_path / "plan"))
    for name in FILES:
        assert (tmp_path / "plan" / name).read_bytes() == (command_line_plan / name).read_bytes(), name
    assert plan.as_json() == (command_line_plan / "plan.json").read_text()
    with pytest.raises(hedgehop.UsageError):
        plan.write(str(tmp_path / "plan"))
    plan.write(str(tmp_path / "plan"), overwrite=True)


def test_states_are_a_view_of_what_the_trajectory_file_says(command_line_plan):
    plan = hedgehop.read_plan(command_line_plan)
    states = plan.states
    assert not states.flags.writeable and np.shares_memory(states, plan.states)
    with open(command_line_plan / "trajectory.csv") as file:
        columns = file.readline().strip().split(",")
    table = np.genfromtxt(command_line_plan / "trajectory.csv", delimiter=",", skip_header=1)
    common = [name for name in states.dtype.names if name in columns]
    assert len(common) >= 15
    for name in common:
        np.testing.assert_array_equal(states[name], table[:, columns.index(name)], err_msg=name)
    assert plan.waypoints.shape[1] == 3
    assert plan.waypoints[0, :2] == pytest.approx([states["x_m"][0], states["y_m"][0]], abs=1.0)
    del plan
    assert states["time_s"][0] == 0.0


def test_what_is_asked_for_is_what_is_planned(hills, hills_map):
    via = tuple((a + b) / 2 + 0.003 for a, b in zip(hills[1], hills[2]))
    plan = hedgehop.plan(hills_map, request_of(hills, via=[via], start_heading_deg=90.0, speed_mps=40.0))
    x_m, y_m = hills_map.to_map(*via)
    assert np.hypot(plan.states["x_m"] - x_m, plan.states["y_m"] - y_m).min() < 150.0
    assert math.degrees(plan.states["heading_true_rad"][0]) == pytest.approx(90.0, abs=0.1)
    assert plan.states["speed_mps"][len(plan.states) // 2] == pytest.approx(40.0, abs=1.0)


def test_no_plan_is_a_value_that_is_false(hills, hills_map):
    none = hedgehop.plan(hills_map, hedgehop.Request(start=(10.0, 10.0), goal=hills[2]))
    assert not none and isinstance(none, hedgehop.NoPlan)
    assert none.cause == "start_outside_map" and none.explanation


def test_wrong_requests_are_refused(hills, hills_map):
    for place in ((95.0, 10.0), (math.nan, 10.0), (50.0,)):
        with pytest.raises(hedgehop.UsageError):
            hedgehop.plan(hills_map, hedgehop.Request(start=place, goal=hills[2]))
    with pytest.raises(hedgehop.UsageError):
        hedgehop.plan(hills_map, request_of(hills), threads=-1)
    with pytest.raises(hedgehop.UserError) as error:
        hedgehop.plan(hills_map, request_of(hills), settings=["global.work_bugdet=1"])
    assert error.value.exit_code == 2


def test_progress_grows_and_the_lock_of_python_is_free_meanwhile(hills, hills_map):
    seen = []
    turns = [0]
    done = threading.Event()

    def count():
        while not done.wait(0.001):
            turns[0] += 1

    counter = threading.Thread(target=count)
    counter.start()
    before = turns[0]
    try:
        assert hedgehop.plan(hills_map, request_of(hills), progress=lambda stage, share: seen.append((stage, share)))
    finally:
        during = turns[0] - before
        done.set()
        counter.join()
    assert during > 20, "no other thread ran"
    assert {stage for stage, _ in seen} >= {"planning the route"}
    for stage in {stage for stage, _ in seen}:
        shares = [share for other, share in seen if other == stage]
        assert shares == sorted(shares) and 0.0 <= shares[0] and shares[-1] <= 1.0


def test_the_progress_function_can_stop_the_work(hills, hills_map):
    with pytest.raises(hedgehop.Interrupted) as error:
        hedgehop.plan(hills_map, request_of(hills), progress=lambda stage, share: False)
    assert error.value.exit_code == 130

    def fail(stage, share):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        hedgehop.plan(hills_map, request_of(hills), progress=fail)


def test_plans_of_two_threads_do_not_disturb_each_other(hills, hills_map, command_line_plan):
    plans = []
    threads = [threading.Thread(target=lambda: plans.append(hedgehop.plan(hills_map, request_of(hills)))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wanted = (command_line_plan / "plan.json").read_text()
    assert [plan.as_json() for plan in plans] == [wanted, wanted]


def test_verify_says_what_the_program_says_and_sees_a_lie(hills, hills_map, command_line_plan, tmp_path):
    verdict = hedgehop.verify(hills_map, command_line_plan)
    assert verdict.is_verified and verdict.violation_count == 0
    assert verdict.clearance_min_m == pytest.approx(hedgehop.read_plan(command_line_plan).verdict.clearance_min_m)
    assert hedgehop.verify(hills[0], command_line_plan).is_verified

    lie = tmp_path / "lie"
    shutil.copytree(command_line_plan, lie)
    lines = (lie / "trajectory.csv").read_text().splitlines()
    column = lines[0].split(",").index("altitude_m")
    fields = lines[len(lines) // 2].split(",")
    fields[column] = repr(float(fields[column]) - 40.0)
    lines[len(lines) // 2] = ",".join(fields)
    (lie / "trajectory.csv").write_text("\n".join(lines) + "\n")
    verdict = hedgehop.verify(hills_map, lie)
    assert not verdict.is_verified and verdict.violation_count > 0
    assert any(violation.rule.startswith("continuity") for violation in verdict.violations)


def test_the_example_of_the_documents_runs(tmp_path):
    done = subprocess.run([sys.executable, SOURCE / "docs/examples/plan_and_look.py", tmp_path / "out"],
                          capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    assert "verified" in done.stdout.splitlines()
    assert (tmp_path / "out/plan/plan.json").is_file()


def test_a_type_checker_accepts_the_module_and_the_example(tmp_path):
    mypy = shutil.which("mypy", path="/usr/bin")
    if mypy is None:
        pytest.skip("mypy is not installed")
    package = pathlib.Path(hedgehop.__file__).parent
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import hedgehop\nhedgehop.read_map(3)\nhedgehop.read_plan('x').lenght_m\n"
                     "hedgehop.messages.route_t().cost_m = 'dear'\n")
    command = [mypy, "--strict", "--python-executable", sys.executable, "--cache-dir", tmp_path / "cache"]
    good = subprocess.run([*command, SOURCE / "docs/examples/plan_and_look.py"],
                          env={"MYPYPATH": str(package.parent), "PATH": "/usr/bin"}, capture_output=True, text=True)
    assert good.returncode == 0, good.stdout
    bad = subprocess.run([*command, wrong], env={"MYPYPATH": str(package.parent), "PATH": "/usr/bin"}, capture_output=True,
                         text=True)
    assert [line.split(":")[1] for line in bad.stdout.splitlines() if ": error:" in line] == ["2", "3", "4"], bad.stdout


def test_the_stubs_say_what_the_native_module_has():
    from hedgehop import _native
    text = (pathlib.Path(_native.__file__).parent / "_native.pyi").read_text()
    blocks = text.split("\nclass ")
    for block in blocks[1:]:
        name = block.split("(")[0].split(":")[0]
        body = block.split("\n\ndef ")[0]
        said = {line.split("def ")[1].split("(")[0] for line in body.splitlines() if line.startswith("    def ")}
        said |= {line.split(":")[0].strip() for line in body.splitlines() if line.startswith("    hint") or "exit_code:" in line}
        real = {member for member in vars(getattr(_native, name)) if not member.startswith("_")}
        assert {member for member in said if not member.startswith("_")} == real or issubclass(
            getattr(_native, name), Exception), name
    functions = {line.split("def ")[1].split("(")[0] for line in text.splitlines() if line.startswith("def ")}
    real = {name for name in vars(_native) if callable(getattr(_native, name)) and not isinstance(getattr(_native, name), type)}
    assert functions == {name for name in real if not name.startswith("_")}
