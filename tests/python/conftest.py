"""What the tests of the Python module share: programs, the map of small hills, a plan of the command line on it."""

import os
import pathlib
import subprocess

import pytest

import hedgehop

BUILD = pathlib.Path(os.environ["HEDGEHOP_BUILD"])
SOURCE = pathlib.Path(__file__).resolve().parents[2]
WORK = 20000


@pytest.fixture(scope="session")
def hills(tmp_path_factory):
    """Folder of a map, start and goal of a flight over it."""
    folder = tmp_path_factory.mktemp("hills") / "map"
    said = subprocess.run([BUILD / "tests/services/small_hills_map", folder], check=True, capture_output=True, text=True)
    start, goal = (tuple(map(float, place.split(","))) for place in said.stdout.split())
    return folder, start, goal


@pytest.fixture(scope="session")
def hills_map(hills):
    return hedgehop.read_map(hills[0])


@pytest.fixture(scope="session")
def command_line_plan(hills, tmp_path_factory):
    folder, start, goal = hills
    out = tmp_path_factory.mktemp("command_line") / "plan"
    subprocess.run([BUILD / "hedgehop", "plan", "--map", folder, "--start", "%r,%r" % start, "--goal", "%r,%r" % goal,
                    "--work", str(WORK), "--out", out], check=True, capture_output=True)
    return out
