"""Messages, the bus and its logs."""

import struct
import subprocess
import sys

import pytest
from conftest import BUILD, SOURCE

import hedgehop
from hedgehop import messages


def cancel(half=5):
    message = messages.plan_cancel_t()
    message.request_id = [half, -half]
    return message


def test_what_is_published_is_heard_with_sender_and_number():
    speaker, listener = hedgehop.Bus("memq://python"), hedgehop.Bus("memq://python")
    heard = []
    listener.subscribe("PLAN_CANCEL", heard.append)
    sent = cancel()
    for _ in range(3):
        speaker.publish("PLAN_CANCEL", sent)
    listener.poll(1.0)
    assert [message.seq for message in heard] == [1, 2, 3]
    assert {tuple(message.request_id) for message in heard} == {(5, -5)}
    assert len({message.sender_id for message in heard}) == 1 and heard[0].sender_id != 0
    assert heard[0].utime > 1_500_000_000_000_000
    assert (sent.utime, sent.seq) == (0, 0), "the caller's message was changed"
    assert speaker.counters["published"] == 3 and listener.counters["received"] == 3


def test_prefixes_keep_aircraft_apart():
    alpha, bravo = (hedgehop.Bus("memq://prefix", channel_prefix=prefix) for prefix in ("alpha_", "bravo_"))
    heard = []
    bravo.subscribe("PLAN_CANCEL", heard.append)
    alpha.publish("PLAN_CANCEL", cancel())
    bravo.poll(0.1)
    assert heard == []


def test_what_the_services_would_refuse_is_neither_sent_nor_decoded():
    bus = hedgehop.Bus("memq://refusal")
    request = messages.vehicle_state_t()
    request.flight_time_s = float("nan")
    with pytest.raises(hedgehop.MessageError):
        bus.publish("VEHICLE_STATE", request)
    with pytest.raises(hedgehop.MessageError):
        bus.publish("PLAN_CANCEL", cancel(half=2**70))
    with pytest.raises(hedgehop.UsageError):
        bus.publish("PLAN_CANCEL", request)
    with pytest.raises(hedgehop.UsageError):
        bus.publish("NO_SUCH_CHANNEL", cancel())
    with pytest.raises(hedgehop.UsageError):
        bus.subscribe("NO_SUCH_CHANNEL", print)
    assert bus.counters["published"] == 0
    good = cancel()
    good.utime = good.sender_id = good.seq = good.version = 1
    encoded = good.encode()
    assert hedgehop.decode("PLAN_CANCEL", encoded).request_id == (5, -5)
    for bad in (encoded[:-1], b"", b"\0" * 8 + encoded[8:]):
        with pytest.raises(hedgehop.MessageError):
            hedgehop.decode("PLAN_CANCEL", bad)


def test_an_exception_of_a_handler_comes_out_of_poll():
    speaker, listener = hedgehop.Bus("memq://exception"), hedgehop.Bus("memq://exception")

    def fail(message):
        raise LookupError("mine")

    listener.subscribe("PLAN_CANCEL", fail)
    speaker.publish("PLAN_CANCEL", cancel())
    with pytest.raises(LookupError, match="mine"):
        listener.poll(1.0)


def test_fingerprints_are_those_of_the_services(tmp_path):
    """A log with every channel, written by C++: each event decodes, and encodes to the same bytes."""
    log = tmp_path / "example.lcmlog"
    subprocess.run([BUILD / "tests/bus/example_log", log], check=True, capture_output=True)
    channels = set()
    events = list(hedgehop.read_log(log))
    for event in events:
        channels.add(event.channel)
        message = event.decode()
        assert type(message).__name__ == hedgehop.CHANNELS[event.channel]
        assert message.encode() == event.message, event.channel
    assert channels == set(hedgehop.CHANNELS)
    assert [event.number for event in events] == sorted(event.number for event in events)

    data = log.read_bytes()
    magic, number, utime, channel_length, length = struct.unpack_from(">IqqII", data)
    assert (events[0].number, events[0].utime, len(events[0].message)) == (number, utime, length)

    damaged = tmp_path / "damaged.lcmlog"
    second = 28 + channel_length + length
    damaged.write_bytes(data[:second] + b"\xff" * 4 + data[second + 4:])
    assert len(list(hedgehop.read_log(damaged))) == len(events) - 1
    with pytest.raises(hedgehop.DataError):
        hedgehop.read_log(tmp_path / "nowhere.lcmlog")


def test_a_log_can_be_heard_as_a_bus(tmp_path):
    log = tmp_path / "example.lcmlog"
    subprocess.run([BUILD / "tests/bus/example_log", log], check=True, capture_output=True)
    bus = hedgehop.Bus(f"file://{log}")
    heard = []
    for channel in hedgehop.CHANNELS:
        bus.subscribe(channel, lambda message, channel=channel: heard.append(channel))
    while not bus.is_finished:
        bus.poll(0.0)
    assert heard == [event.channel for event in hedgehop.read_log(log)]


LISTEN = """
import hedgehop, sys, time
bus = hedgehop.Bus(sys.argv[1])
names = set()
bus.subscribe("SERVICE_STATUS", lambda status: names.add(status.name))
end = time.monotonic() + 20
while "command_model" not in names and time.monotonic() < end:
    bus.poll(0.2)
sys.exit(0 if "command_model" in names else f"heard only {names}")
"""


def test_a_service_is_heard_over_the_network(tmp_path):
    url = "udpm://239.255.76.67:7667?ttl=0"
    script = (f"{BUILD}/hedgehop-command-model --lcm-url '{url}' & child=$!; "
              f"{sys.executable} -c '{LISTEN}' '{url}'; code=$?; kill $child; wait $child; exit $code")
    done = subprocess.run([SOURCE / "scripts/in-own-network", "bash", "-c", script], capture_output=True, text=True,
                          timeout=60)
    if done.returncode == 77:
        pytest.skip(done.stdout.strip())
    assert done.returncode == 0, done.stdout + done.stderr
