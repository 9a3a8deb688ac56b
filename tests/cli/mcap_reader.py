"""A reader of MCAP recordings, written from the published specification alone (mcap.dev/spec).

Reads a whole file twice, from its beginning and through its index, and fails on anything that the specification does not
allow: wrong CRC, offsets that lead elsewhere, records out of their section, statistics that do not count what is there.
"""

import struct
import zlib

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 0x0B, 0x0C, 0x0D, 0x0E, 0x0F


class Cursor:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        piece = self.data[self.at:self.at + count]
        if len(piece) != count:
            raise ValueError("ends too early")
        self.at += count
        return piece

    def number(self, code):
        return struct.unpack("<" + code, self.take(struct.calcsize("<" + code)))[0]

    def bytes(self):
        return self.take(self.number("I"))

    def text(self):
        return self.bytes().decode("utf-8")

    def map(self, key, value):
        inner, found = Cursor(self.bytes()), {}
        while inner.at < len(inner.data):
            name = key(inner)
            if name in found:
                raise ValueError(f"key {name!r} stands twice")
            found[name] = value(inner)
        return found

    def done(self):
        if self.at != len(self.data):
            raise ValueError(f"{len(self.data) - self.at} bytes too many")


def records(data, start, end):
    """(offset, opcode, content) one after the other."""
    at = start
    while at < end:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if at + 9 + length > end:
            raise ValueError(f"record at {at} reaches beyond its section")
        yield at, opcode, data[at + 9:at + 9 + length]
        at += 9 + length


def record_at(data, offset, opcode):
    found, length = struct.unpack_from("<BQ", data, offset)
    if found != opcode:
        raise ValueError(f"at {offset} stands record {found}, not {opcode}")
    return data[offset + 9:offset + 9 + length]


def message(content):
    cursor = Cursor(content)
    channel, sequence, log_time, publish_time = (cursor.number(code) for code in "HIQQ")
    return {"channel": channel, "sequence": sequence, "log_time": log_time, "publish_time": publish_time,
            "data": cursor.data[cursor.at:]}


def definition(opcode, content, schemas, channels):
    cursor = Cursor(content)
    number = cursor.number("H")
    if opcode == SCHEMA:
        known, entry = schemas, {"name": cursor.text(), "encoding": cursor.text(), "data": cursor.bytes()}
    else:
        known = channels
        entry = {"schema": cursor.number("H"), "topic": cursor.text(), "encoding": cursor.text(),
                 "metadata": cursor.map(Cursor.text, Cursor.text)}
        if entry["schema"] not in schemas:
            raise ValueError("a channel comes before its schema")
    cursor.done()
    if number == 0 or known.setdefault(number, entry) != entry:
        raise ValueError("number of a schema or channel is 0 or stands for two")


def read(data):
    """Schemas, channels, metadata and messages in the order of the file."""
    if data[:8] != MAGIC or data[-8:] != MAGIC:
        raise ValueError("no magic bytes")
    footer_at = len(data) - 8 - 29
    footer = Cursor(record_at(data, footer_at, FOOTER))
    summary_start, offsets_start, summary_crc = (footer.number(code) for code in "QQI")
    footer.done()
    if zlib.crc32(data[summary_start:footer_at + 9 + 16]) != summary_crc:
        raise ValueError("CRC of the summary")

    schemas, channels, metadata, messages, chunks = {}, {}, {}, [], {}
    indexed = {}  # message indexes after their chunk
    opcodes = []
    for at, opcode, content in records(data, 8, summary_start):
        opcodes.append(opcode)
        cursor = Cursor(content)
        if opcode == HEADER:
            header = {"profile": cursor.text(), "library": cursor.text()}
        elif opcode in (SCHEMA, CHANNEL):
            definition(opcode, content, schemas, channels)
        elif opcode == METADATA:
            name = cursor.text()
            metadata[name] = cursor.map(Cursor.text, Cursor.text)
        elif opcode == CHUNK:
            first, last, size, crc = (cursor.number(code) for code in "QQQI")
            if cursor.text() != "":
                raise ValueError("compressed")
            inner = cursor.take(cursor.number("Q"))
            cursor.done()
            if len(inner) != size or zlib.crc32(inner) != crc:
                raise ValueError("size or CRC of a chunk")
            here = [(offset, message(part)) for offset, op, part in records(inner, 0, len(inner)) if op == MESSAGE]
            times = [entry["log_time"] for _, entry in here]
            if (min(times), max(times)) != (first, last):
                raise ValueError("times of a chunk")
            for _, entry in here:
                if entry["channel"] not in channels:
                    raise ValueError("a message comes before its channel")
                messages.append(entry)
            chunks[at] = (here, first, last, size, 9 + len(content))
            latest = at
        elif opcode == MESSAGE_INDEX:
            channel = cursor.number("H")
            places = Cursor(cursor.bytes())
            cursor.done()
            entries = []
            while places.at < len(places.data):
                entries.append((places.number("Q"), places.number("Q")))
            wanted = [(entry["log_time"], offset) for offset, entry in chunks[latest][0] if entry["channel"] == channel]
            if sorted(entries) != sorted(wanted) or not entries:
                raise ValueError("index of messages")
            indexed.setdefault(latest, {})[channel] = at
        elif opcode == DATA_END:
            crc = cursor.number("I")
            if crc != zlib.crc32(data[:at]):
                raise ValueError("CRC of the data section")
        else:
            raise ValueError(f"record {opcode} in the data section")
    if opcodes[0] != HEADER or opcodes[-1] != DATA_END or opcodes.count(HEADER) != 1:
        raise ValueError("header or end of the data section")

    groups, summary_schemas, summary_channels, chunk_indexes = [], {}, {}, 0
    for at, opcode, content in records(data, summary_start, offsets_start):
        cursor = Cursor(content)
        if not groups or groups[-1][0] != opcode:
            groups.append([opcode, at, 0])
        groups[-1][2] += 9 + len(content)
        if opcode in (SCHEMA, CHANNEL):
            definition(opcode, content, summary_schemas, summary_channels)
        elif opcode == CHUNK_INDEX:
            first, last, start, length = (cursor.number(code) for code in "QQQQ")
            offsets = cursor.map(lambda c: c.number("H"), lambda c: c.number("Q"))
            index_length = cursor.number("Q")
            compression, compressed, size = cursor.text(), cursor.number("Q"), cursor.number("Q")
            cursor.done()
            if chunks[start][1:] != (first, last, size, length) or compression != "" or compressed != size:
                raise ValueError("index of a chunk")
            if offsets != indexed[start]:
                raise ValueError("places of message indexes")
            ends = [offset + 9 + len(record_at(data, offset, MESSAGE_INDEX)) for offset in offsets.values()]
            if max(ends) - (start + length) != index_length:
                raise ValueError("length of message indexes")
            chunk_indexes += 1
        elif opcode == METADATA_INDEX:
            offset, length, name = cursor.number("Q"), cursor.number("Q"), cursor.text()
            content = record_at(data, offset, METADATA)
            if Cursor(content).text() != name or 9 + len(content) != length:
                raise ValueError("index of metadata")
        elif opcode == STATISTICS:
            counts = [cursor.number(code) for code in "QHIIIIQQ"]
            by_channel = cursor.map(lambda c: c.number("H"), lambda c: c.number("Q"))
            cursor.done()
            times = [entry["log_time"] for entry in messages]
            if counts != [len(messages), len(schemas), len(channels), 0, len(metadata), len(chunks), min(times), max(times)]:
                raise ValueError(f"statistics {counts}")
            if by_channel != {number: sum(m["channel"] == number for m in messages) for number in channels}:
                raise ValueError("messages by channel")
        else:
            raise ValueError(f"record {opcode} in the summary")
    if summary_schemas != schemas or summary_channels != channels or chunk_indexes != len(chunks):
        raise ValueError("the summary is not complete")
    if len({group[0] for group in groups}) != len(groups):
        raise ValueError("records of the summary are not grouped")
    found = []
    for _, opcode, content in records(data, offsets_start, footer_at):
        if opcode != SUMMARY_OFFSET:
            raise ValueError(f"record {opcode} among summary offsets")
        found.append(list(struct.unpack("<BQQ", content)))
    if found != groups:
        raise ValueError("summary offsets")
    return {"header": header, "schemas": schemas, "channels": channels, "metadata": metadata, "messages": messages,
            "chunks": len(chunks)}
