#!/usr/bin/env python3
"""`hedgehop fetch` against a server on the loopback: whole and broken transfers, sea, wrong hashes, patience.

  fetch_test.py --list
  fetch_test.py --hedgehop PROGRAM [NAME...]
"""

import argparse
import hashlib
import http.server
import json
import os
import pathlib
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

HEDGEHOP = None
SEED = random.SystemRandom().randrange(1 << 32)
BOX = "9.2,51.2,9.4,51.4"
TILE = "/N51E009.hgt.zip"
OSM = "/osm/9.2_51.2_9.4_51.4"


class Page:
    """What stands at a path."""

    def __init__(self, body, **behaviour):
        self.body = body
        self.etag = behaviour.get("etag", '"' + hashlib.md5(body).hexdigest() + '"')
        self.cuts = list(behaviour.get("cuts", []))  # of the next answers: bytes after which the connection breaks
        self.statuses = list(behaviour.get("statuses", []))  # of the next answers: (status, headers)
        self.has_ranges = behaviour.get("has_ranges", True)
        self.bodies = list(behaviour.get("bodies", []))  # of the next answers, before `body`
        self.delay_s = behaviour.get("delay_s", 0.0)  # between pieces


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *arguments):
        pass

    def do_GET(self):
        server = self.server
        with server.lock:
            server.asked.append((self.path, dict(self.headers), time.monotonic()))
            page = server.pages.get(self.path)
            status, headers = page.statuses.pop(0) if page and page.statuses else (None, {})
            cut = page.cuts.pop(0) if page and page.cuts and status is None else None
            body = page.bodies.pop(0) if page and page.bodies and status is None else page.body if page else b""
        self.close_connection = True
        if page is None or status is not None:
            self.send_response(404 if page is None else status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", "5")
            self.end_headers()
            self.wfile.write(b"sorry")
            return
        begin = 0
        wanted = self.headers.get("Range")
        if wanted and page.has_ranges and self.headers.get("If-Range") in (None, page.etag):
            begin = int(wanted.removeprefix("bytes=").removesuffix("-"))
            if begin >= len(body):
                self.send_response(416)
                self.send_header("Content-Length", "0")
                self.end_headers()
                return
        self.send_response(206 if begin else 200)
        if begin:
            self.send_header("Content-Range", f"bytes {begin}-{len(body) - 1}/{len(body)}")
        if page.etag:
            self.send_header("ETag", page.etag)
        self.send_header("Content-Length", str(len(body) - begin))
        self.end_headers()
        sent = body[begin:] if cut is None else body[begin:begin + cut]
        try:
            for at in range(0, len(sent), 20000):
                self.wfile.write(sent[at:at + 20000])
                self.wfile.flush()
                with server.lock:
                    server.sent += len(sent[at:at + 20000])
                time.sleep(page.delay_s)
        except OSError:
            pass


class FetchTest(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory(prefix="hedgehop_fetch_")
        self.addCleanup(scratch.cleanup)
        self.scratch = pathlib.Path(scratch.name)
        self.out = self.scratch / "out"
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.server.lock, self.server.asked, self.server.sent, self.server.pages = threading.Lock(), [], 0, {}
        threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        self.addCleanup(self.server.server_close)
        self.addCleanup(self.server.shutdown)
        self.root = f"http://127.0.0.1:{self.server.server_port}"
        random_bytes = random.Random(SEED)
        self.tile = b"PK" + random_bytes.randbytes(150000)
        self.osm = b"<?xml version='1.0'?><osm/>" + random_bytes.randbytes(3000)
        self.put(TILE, self.tile)
        self.put(OSM, self.osm)
        self.config = self.scratch / "fetch.yaml"
        self.configure()

    def put(self, path, body, **behaviour):
        self.server.pages[path] = Page(body, **behaviour)

    def configure(self, root=None, terrain="", **manners):
        root = root or self.root
        manners = {"pause_s": 0.0, "back_off_s": 0.02, "back_off_max_s": 0.05, "retries_max": 2, "user_agent": "test agent",
                   **manners}
        said = {"kind": "terrain", "url": f"{root}/{{ns}}{{lat2}}{{ew}}{{lon3}}.hgt.zip",
                "file": "{ns}{lat2}{ew}{lon3}.hgt.zip", "tile_deg": 1, "absent_statuses": [404], "checksum": "none",
                "checksum_url": "", "sha256": [], "bytes_max": 1000000, "dem_suffix": "", "licence": "a licence",
                "attribution": "(c) somebody", "page": "https://example.org"}
        said.update(terrain or {})
        osm = {**said, "kind": "osm", "url": f"{root}/osm/{{west}}_{{south}}_{{east}}_{{north}}", "file": "box.osm",
               "tile_deg": 0, "absent_statuses": [], "checksum": "none", "checksum_url": "", "sha256": []}
        self.config.write_text(json.dumps({
            "politeness": manners, "terrain_margin_m": 0.0, "default_terrain": "hills", "default_osm": "streets",
            "sources": [{"name": "hills", **said}, {"name": "streets", **osm}]}))

    def start(self, *arguments, box=BOX):
        environment = {name: value for name, value in os.environ.items() if not name.lower().endswith("_proxy")}
        return subprocess.Popen([HEDGEHOP, "fetch", "--bbox", box, "--out", self.out, "--config", self.config, *arguments],
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)

    def fetch(self, *arguments, code=0, **options):
        child = self.start(*arguments, **options)
        self.stdout, self.stderr = child.communicate(timeout=60)
        self.assertEqual(child.returncode, code, f"seed {SEED}\n{self.stdout}\n{self.stderr}")
        return self.stdout + self.stderr

    def record(self):
        return json.loads((self.out / "fetch.json").read_text())

    def paths(self):
        return [path for path, _, _ in self.server.asked]

    def holds(self, *names):
        self.assertEqual(sorted(path.name for path in self.out.iterdir()), sorted(names))

    def test_files_come_whole_with_a_record_of_their_source(self):
        said = self.fetch()
        self.holds("N51E009.hgt.zip", "box.osm", "fetch.json")
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)
        self.assertEqual((self.out / "box.osm").read_bytes(), self.osm)
        for entry, name, body in zip(self.record()["files"], ("N51E009.hgt.zip", "box.osm"), (self.tile, self.osm)):
            self.assertEqual((entry["file"], entry["bytes"], entry["sha256"]),
                             (name, len(body), hashlib.sha256(body).hexdigest()))
            self.assertEqual((entry["licence"], entry["attribution"], entry["how"]), ("a licence", "(c) somebody", "fetched"))
            self.assertTrue(entry["url"].startswith(self.root))
        self.assertIn(f"hedgehop prepare --dem {self.out}/N51E009.hgt.zip --osm {self.out}/box.osm "
                      f"--attribution '(c) somebody' --bbox {BOX} --out map", said)
        self.assertEqual({headers["User-Agent"] for _, headers, _ in self.server.asked}, {"test agent"})
        asked = len(self.server.asked)
        self.assertIn("kept", self.fetch())
        self.assertEqual(len(self.server.asked), asked, "what is there was asked for again")

    def test_tiles_over_the_sea_are_no_error(self):
        said = self.fetch(box="8.9,51.2,9.4,51.4", code=7)  # the OSM file of this box is missing
        self.assertIn("N51E008.hgt.zip (no such tile: sea)", said)
        self.assertIn("/osm/8.9_51.2_9.4_51.4", self.stderr)
        self.fetch("--osm", "none", box="8.9,51.2,9.4,51.4")
        self.assertEqual([entry["file"] for entry in self.record()["absent"]], ["N51E008.hgt.zip"])
        self.holds("N51E009.hgt.zip", "fetch.json")

    def test_a_broken_transfer_goes_on_where_it_ended(self):
        self.put(TILE, self.tile, cuts=[40000, 30000])
        self.fetch()
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)
        ranges = [headers.get("Range") for path, headers, _ in self.server.asked if path == TILE]
        self.assertEqual(ranges, [None, "bytes=40000-", "bytes=70000-"])
        self.assertLessEqual(self.server.sent, len(self.tile) + len(self.osm))
        self.holds("N51E009.hgt.zip", "box.osm", "fetch.json")

    def test_an_interrupted_run_is_taken_up_by_the_next(self):
        self.put(TILE, self.tile, delay_s=0.3)
        child = self.start("--osm", "none")
        part = self.out / "N51E009.hgt.zip.part"
        while child.poll() is None and not (part.exists() and part.stat().st_size > 0):
            time.sleep(0.01)
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=20)
        self.assertEqual(child.returncode, 130)
        self.assertFalse((self.out / "N51E009.hgt.zip").exists())
        begun = part.stat().st_size
        self.assertGreater(begun, 0)
        self.assertEqual(part.read_bytes(), self.tile[:begun])
        self.put(TILE, self.tile)
        self.fetch("--osm", "none")
        self.assertEqual(self.server.asked[-1][1].get("Range"), f"bytes={begun}-")
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)
        self.holds("N51E009.hgt.zip", "fetch.json")

    def test_a_file_that_changed_meanwhile_is_fetched_as_a_whole(self):
        self.put(TILE, self.tile, cuts=[40000] + [0] * 9)
        self.fetch("--osm", "none", code=7)
        self.assertTrue((self.out / "N51E009.hgt.zip.part").exists())
        newer = b"PK" + self.tile[::-1]
        self.put(TILE, newer)
        self.fetch("--osm", "none")
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), newer)

    def test_servers_without_ranges_or_without_tags_give_whole_files(self):
        for behaviour in ({"has_ranges": False}, {"etag": ""}, {"etag": 'W/"weak"'}):
            with self.subTest(behaviour=behaviour):
                self.put(TILE, self.tile, cuts=[40000], **behaviour)
                self.fetch("--osm", "none", "--overwrite")
                self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)

    def test_a_part_that_is_longer_than_the_file_is_thrown_away(self):
        self.put(TILE, self.tile, cuts=[90000] + [0] * 9)
        self.fetch("--osm", "none", code=7)
        shorter = self.tile[:50000]
        self.put(TILE, shorter, etag=self.server.pages[TILE].etag)  # a server that lies
        self.fetch("--osm", "none")
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), shorter)

    def test_a_wrong_checksum_is_tried_once_more_and_never_kept(self):
        for kind, digest in (("md5", hashlib.md5), ("sha256", hashlib.sha256)):
            with self.subTest(kind=kind):
                self.configure(terrain={"checksum": kind, "checksum_url": f"{self.root}/sum"})
                self.put("/sum", f"{digest(self.tile).hexdigest()}  N51E009.hgt.zip\n".encode())
                self.put(TILE, self.tile, bodies=[self.tile[:-1] + b"x"])
                self.fetch("--osm", "none", "--overwrite")
                self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)
                (self.out / "N51E009.hgt.zip").unlink()
                self.put(TILE, self.tile[:-1] + b"x")
                said = self.fetch("--osm", "none", code=7)
                self.assertIn(digest(self.tile).hexdigest(), said)
                self.holds("fetch.json")

    def test_known_files_are_held_to_their_hash(self):
        self.configure(terrain={"sha256": ["N51E009.hgt.zip " + hashlib.sha256(self.tile).hexdigest()]})
        self.fetch("--osm", "none")
        self.configure(terrain={"sha256": ["N51E009.hgt.zip " + "0" * 64]})
        self.assertIn("SHA-256", self.fetch("--osm", "none", code=5))
        self.fetch("--osm", "none", "--overwrite", code=7)
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile, "a right file was lost to a wrong one")

    def test_a_server_that_asks_for_patience_gets_it(self):
        self.put(TILE, self.tile, statuses=[(429, {"Retry-After": "1"}), (503, {})])
        self.fetch("--osm", "none")
        times = [when for path, _, when in self.server.asked if path == TILE]
        self.assertEqual(len(times), 3)
        self.assertGreaterEqual(times[1] - times[0], 1.0)
        self.put(OSM, self.osm, statuses=[(429, {"Retry-After": "5000"})])
        started = time.monotonic()
        self.assertIn("5000 s", self.fetch("--terrain", "none", code=7))
        self.assertLess(time.monotonic() - started, 20)
        self.assertEqual(self.paths().count(OSM), 1)

    def test_pauses_grow_and_end(self):
        self.configure(back_off_s=0.2, back_off_max_s=5.0, retries_max=3)
        self.put(TILE, self.tile, statuses=[(500, {})] * 10)
        self.fetch("--osm", "none", code=7)
        times = [when for path, _, when in self.server.asked if path == TILE]
        self.assertEqual(len(times), 4)
        for (first, second), least_s in zip(zip(times, times[1:]), (0.2, 0.4, 0.8)):
            self.assertGreaterEqual(second - first, least_s - 0.01)

    def test_requests_to_one_host_keep_their_distance(self):
        self.configure(pause_s=0.5)
        self.fetch()
        times = [when for _, _, when in self.server.asked]
        self.assertEqual(len(times), 2)
        self.assertGreaterEqual(times[1] - times[0], 0.49)

    def test_refusals_are_final(self):
        self.put(TILE, self.tile, statuses=[(403, {})])
        self.assertIn("status 403", self.fetch("--osm", "none", code=7))
        self.assertEqual(self.paths().count(TILE), 1)

    def test_web_pages_and_floods_are_no_files(self):
        self.put(TILE, b"\n <!DOCTYPE HTML><html>please log in</html>")
        self.assertIn("web page", self.fetch("--osm", "none", code=7))
        self.configure(terrain={"bytes_max": 1000})
        self.put(TILE, self.tile)
        self.assertIn("bytes_max", self.fetch("--osm", "none", code=7))
        self.holds("fetch.json")

    def test_redirects_lead_to_other_servers_but_not_into_the_machine(self):
        secret = self.scratch / "secret"
        secret.write_text("PK secret")
        self.put("/elsewhere", self.tile)
        self.put(TILE, b"", statuses=[(302, {"Location": "/elsewhere"})])
        self.fetch("--osm", "none")
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)
        self.put(TILE, b"", statuses=[(302, {"Location": f"file://{secret}"})] * 9)
        self.fetch("--osm", "none", "--overwrite", code=7)
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)

    def test_without_a_network_it_says_what_to_bring_and_takes_it(self):
        with socket.socket() as unused:  # bound, not listening: connections are refused
            unused.bind(("127.0.0.1", 0))
            root = f"http://127.0.0.1:{unused.getsockname()[1]}"
            self.configure(root=root)
            started = time.monotonic()
            said = self.fetch(box="8.9,51.2,9.4,51.4", code=7)
            self.assertLess(time.monotonic() - started, 20)
            for name in ("N51E008.hgt.zip", "N51E009.hgt.zip"):
                self.assertIn(f"{root}/{name}\n    to {self.out / name}\n", said)
            self.assertIn(f"to {self.out / 'box.osm'}\n", said)
            self.assertIn("hint: ", said)
            for name in ("N51E008.hgt.zip", "N51E009.hgt.zip", "box.osm"):
                (self.out / name).write_bytes(self.tile)
            said = self.fetch(box="8.9,51.2,9.4,51.4")
            self.assertIn("next          hedgehop prepare", said)
            self.assertEqual({entry["how"] for entry in self.record()["files"]}, {"brought"})

    def test_nothing_is_overwritten_unasked(self):
        self.out.mkdir()
        mine = self.out / "N51E009.hgt.zip"
        mine.write_bytes(b"mine")
        self.fetch()
        self.assertEqual(mine.read_bytes(), b"mine")
        self.fetch("--overwrite")
        self.assertEqual(mine.read_bytes(), self.tile)
        mine.write_bytes(b"changed")
        said = self.fetch(code=5)
        self.assertIn("has changed since it was fetched", said)
        self.assertEqual(mine.read_bytes(), b"changed")

    def test_a_failed_overwrite_leaves_what_there_was(self):
        self.fetch("--osm", "none")
        self.put(TILE, b"", statuses=[(500, {})] * 10)
        self.fetch("--osm", "none", "--overwrite", code=7)
        self.assertEqual((self.out / "N51E009.hgt.zip").read_bytes(), self.tile)

    def test_a_dry_run_asks_nobody_and_json_tells_all(self):
        said = self.fetch("--dry-run")
        self.assertIn(f"to fetch      {self.root}{TILE}", said)
        self.assertEqual((self.server.asked, self.out.exists()), ([], False))
        self.fetch("--json", "--quiet")
        result = json.loads(self.stdout)
        self.assertEqual((result["schema_version"], result["is_complete"]), (1, True))
        self.assertEqual([file["state"] for file in result["files"]], ["fetched", "fetched"])
        self.assertTrue(result["prepare"].startswith("hedgehop prepare --dem"))
        (self.out / "fetch.json").write_text("{")
        self.assertIn("damaged", self.fetch("--json", code=5))

    def test_the_example_of_the_documents_names_the_files_that_it_prepares(self):
        text = (pathlib.Path(__file__).resolve().parents[2] / "docs/fetch.md").read_text()
        command = next(line.split() for line in text.splitlines() if line.startswith("hedgehop fetch"))
        prepare = next(line for line in text.splitlines() if line.startswith("hedgehop prepare"))
        said = subprocess.run([HEDGEHOP, *command[1:], "--dry-run"], capture_output=True, text=True, cwd=self.scratch, timeout=60)
        self.assertEqual(said.returncode, 0, said.stderr)
        urls = [line.split()[2] for line in said.stdout.splitlines() if line.startswith("to fetch")]
        self.assertEqual([url.rsplit("/", 1)[1] for url in urls[:2]], ["N51E009.SRTMGL1.hgt.zip", "N52E009.SRTMGL1.hgt.zip"])
        self.assertEqual(len(urls), 3)
        self.assertIn("bbox%3A51.65%2C9.35%2C51.95%2C9.85", urls[2])
        named = json.loads(subprocess.run([HEDGEHOP, *command[1:], "--dry-run", "--json"], capture_output=True, text=True,
                                          cwd=self.scratch, timeout=60).stdout)
        for file in named["files"]:
            self.assertIn(file["path"], prepare.split())

    def test_wrong_questions_are_refused_with_the_nearest_word(self):
        self.assertIn("did you mean 'hills'", self.fetch("--terrain", "hils", code=2))
        self.fetch("--terrain", "none", "--osm", "none", code=2)
        self.fetch(box="9.4,51.2,9.2,51.4", code=2)
        self.fetch("--set", "politeness.pause_s=-1", code=2)
        self.assertEqual(self.server.asked, [])

    def test_records_of_other_boxes_stay(self):
        self.fetch("--osm", "none")
        self.put("/N51E010.hgt.zip", self.tile)
        self.fetch("--osm", "none", box="10.2,51.2,10.4,51.4")
        self.assertEqual(sorted(entry["file"] for entry in self.record()["files"]), ["N51E009.hgt.zip", "N51E010.hgt.zip"])


def names():
    return sorted(name for name in dir(FetchTest) if name.startswith("test_"))


def main():
    global HEDGEHOP
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--hedgehop", type=pathlib.Path)
    parser.add_argument("names", nargs="*")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(name.removeprefix("test_") for name in names()))
        return 0
    HEDGEHOP = arguments.hedgehop.resolve()
    chosen = [f"test_{name}" for name in arguments.names] or names()
    result = unittest.TextTestRunner(verbosity=2).run(unittest.TestSuite(FetchTest(name) for name in chosen))
    return 0 if result.wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main())
