"""Small inputs for tests of the command line, written with Python's own means: no file is downloaded."""

import array
import bz2
import gzip
import math
import sys
import zipfile

SIDE = 1201  # samples along one side of a 3-arc-second tile
SOUTH, WEST = 49, 11  # lower left corner of the tile [degrees]
VOID = -32768
# Part of the tile that the test map covers; the land use lies inside.
BBOX = (11.40, 49.50, 11.52, 49.58)
START = (49.51, 11.42)
GOAL = (49.57, 11.50)


def elevation_m(row, column):
    """Rolling hills, 300 to 500 m high: two waves, about 7 km and 5 km long."""
    return 400.0 + 60.0 * math.sin(2.0 * math.pi * row / 75.0) + 40.0 * math.sin(2.0 * math.pi * column / 75.0)


def write_hgt(path, elevation=elevation_m):
    """A tile as the shuttle radar mission published it: big-endian 16-bit rows from north to south."""
    rows = array.array("h")
    for row in range(SIDE):
        rows.extend(round(elevation(row, column)) for column in range(SIDE))
    if sys.byteorder == "little":
        rows.byteswap()
    path.write_bytes(rows.tobytes())


def write_all_void_hgt(path):
    path.write_bytes(array.array("h", [0x0080 if sys.byteorder == "little" else VOID] * (SIDE * SIDE)).tobytes())


def zip_of(path, *members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member in members:
            archive.write(member, member.name)


class Osm:
    """OpenStreetMap XML, element by element."""

    def __init__(self):
        self.nodes, self.ways, self.next_id = [], [], 1

    def node(self, latitude, longitude, **tags):
        self.nodes.append((self.next_id, latitude, longitude, tags))
        self.next_id += 1
        return self.next_id - 1

    def way(self, places, **tags):
        ids = [self.node(latitude, longitude) for latitude, longitude in places]
        if places[0] == places[-1]:
            ids[-1] = ids[0]
        self.ways.append((self.next_id, ids, tags))
        self.next_id += 1

    def rectangle(self, latitude, longitude, height_deg, width_deg, **tags):
        n, e = latitude + height_deg, longitude + width_deg
        self.way([(latitude, longitude), (latitude, e), (n, e), (n, longitude), (latitude, longitude)], **tags)

    def xml(self):
        def tag_lines(tags):
            return "".join(f'<tag k="{key.replace("__", ":")}" v="{value}"/>' for key, value in tags.items())

        lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<osm version="0.6" generator="hedgehop test">']
        for number, latitude, longitude, tags in self.nodes:
            lines.append(f'<node id="{number}" lat="{latitude:.7f}" lon="{longitude:.7f}" version="1">'
                         f"{tag_lines(tags)}</node>")
        for number, ids, tags in self.ways:
            references = "".join(f'<nd ref="{reference}"/>' for reference in ids)
            lines.append(f'<way id="{number}" version="1">{references}{tag_lines(tags)}</way>')
        lines.append("</osm>\n")
        return "\n".join(lines)


def land_use():
    """A village of 40 houses, a forest, a power line and one tree."""
    osm = Osm()
    for i in range(8):
        for j in range(5):
            osm.rectangle(49.540 + 0.0004 * i, 11.460 + 0.0006 * j, 0.0001, 0.00015, building="house")
    osm.rectangle(49.540, 11.460, 0.0034, 0.0032, landuse="residential")
    osm.rectangle(49.555, 11.430, 0.008, 0.012, natural="wood")
    osm.way([(49.52, 11.41), (49.53, 11.45), (49.53, 11.50)], power="line")
    osm.node(49.525, 11.47, natural="tree", height="22")
    return osm.xml()


def write_osm(path, text):
    if path.name.endswith(".gz"):
        path.write_bytes(gzip.compress(text.encode()))
    elif path.name.endswith(".bz2"):
        path.write_bytes(bz2.compress(text.encode()))
    else:
        path.write_text(text)
