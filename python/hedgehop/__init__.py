"""Contour flight planning over real terrain.

    import hedgehop

    map = hedgehop.read_map("map")
    plan = hedgehop.plan(map, hedgehop.Request(start=(49.92, 11.43), goal=(49.98, 11.57)))
    if isinstance(plan, hedgehop.NoPlan):
        print(plan.cause, plan.explanation)
    else:
        plan.write("plan")
        print(plan.length_m, plan.verdict.is_verified)

Angles are radians, lengths metres, unless a name ends otherwise; places are (latitude, longitude) in degrees, with the
height above the surface in metres behind them if there is one. Heights that are not known are NaN.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Callable, Iterator, Sequence, Tuple, Union

from . import _native, messages
from ._native import (BusError, CHANNELS, ConfigError, DataError, Interrupted, Map, MessageError, NoPlan, Plan,
                      SEMANTIC_CLASSES, SystemFailure, UsageError, UserError, Verdict, Violation, VISIBILITY_UNKNOWN,
                      private_url)

__all__ = ["Bus", "BusError", "CHANNELS", "ConfigError", "DataError", "Interrupted", "LogEvent", "Map", "MessageError",
           "NoPlan", "Plan", "Request", "SEMANTIC_CLASSES", "SyntheticRegion", "SystemFailure", "UsageError", "UserError",
           "Verdict", "VISIBILITY_UNKNOWN", "Violation", "decode", "messages", "plan", "prepare", "private_url", "read_log",
           "read_map", "read_plan", "verify", "write_synthetic_region"]
__version__ = _native.VERSION

Path = Union[str, "os.PathLike[str]"]
Place = Union[Tuple[float, float], Tuple[float, float, float]]
#: Called with the name of a stage and the share of it that is done, from any thread; False stops the work.
Progress = Callable[[str, float], Any]


@dataclass(frozen=True)
class Request:
    """What is asked of the planner; all else stands in the map and the configuration."""

    start: Place
    goal: Place
    via: Sequence[Place] = ()
    start_heading_deg: float | None = None  #: true; without it, towards the first waypoint
    speed_mps: float | None = None  #: without it, that of the configuration
    seed: int = 1
    work: int = 0  #: work units; 0: those of the configuration


@dataclass(frozen=True)
class SyntheticRegion:
    """Files of an invented region, and what to do with them."""

    dem_file: str
    osm_file: str
    label: str
    attribution: str
    crs: str
    bbox_deg: Tuple[float, float, float, float]
    start: Tuple[float, float]
    goal: Tuple[float, float]


def read_map(folder: Path) -> Map:
    """Opens a map bundle. Raises DataError."""
    return _native.read_map(os.fspath(folder))


def prepare(dem: Sequence[Path], out: Path, *, osm: Sequence[Path] = (),
            bbox_deg: Tuple[float, float, float, float] | None = None, cell_m: float | None = None, crs: str = "",
            label: str = "", attributions: Sequence[str] = (), obstacles: Sequence[Path] = (),
            areas: Sequence[Path] = (), config_file: Path = "", settings: Sequence[str] = (), overwrite: bool = False,
            threads: int = 0, progress: Progress | None = None) -> Map:
    """Makes a map bundle as `hedgehop prepare` does, and opens it."""
    return _native.prepare([os.fspath(file) for file in dem], [os.fspath(file) for file in osm], os.fspath(out),
                           None if bbox_deg is None else list(bbox_deg), cell_m, crs, label, list(attributions),
                           [os.fspath(file) for file in obstacles], [os.fspath(file) for file in areas],
                           os.fspath(config_file), list(settings), overwrite, threads, progress)


def write_synthetic_region(folder: Path, seed: int = 1) -> SyntheticRegion:
    """Invents a region of 24 km x 24 km; the same seed gives the same files. The folder must exist."""
    return SyntheticRegion(**_native.write_synthetic_region(os.fspath(folder), seed))


def _place(place: Place) -> Tuple[float, float, float | None]:
    if len(place) not in (2, 3):
        raise UsageError(f"{place!r} is no place: give latitude and longitude in degrees, and a height in metres if any")
    numbers: Tuple[float, ...] = place
    return numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else None


def plan(map: Map, request: Request, *, config_file: Path = "", settings: Sequence[str] = (), threads: int = 0,
         progress: Progress | None = None) -> Plan | NoPlan:
    """Plans as `hedgehop plan` does: the same plan, byte for byte. NoPlan, which is false, says why there is none.

    Other threads of Python run meanwhile. Raises what `progress` raises, and Interrupted when it returned False.
    """
    return _native.plan(map, _place(request.start), _place(request.goal), [_place(place) for place in request.via],
                        request.start_heading_deg, request.speed_mps, request.seed, request.work,
                        os.fspath(config_file), list(settings), threads, progress)


def read_plan(folder: Path) -> Plan:
    """Reads a plan bundle. Raises DataError."""
    return _native.read_plan(os.fspath(folder))


def verify(map: Map | Path, folder: Path) -> Verdict:
    """Checks a plan bundle as `hedgehop verify` does, with no code of the planners."""
    return _native.verify(map if isinstance(map, Map) else read_map(map), os.fspath(folder))


def decode(channel: str, message: bytes) -> Any:
    """The message of a channel (without prefix), checked as the services check it. Raises MessageError."""
    _native.check_message(channel, message)
    return getattr(messages, CHANNELS[channel]).decode(message)


class Bus:
    """A place on the bus, for one thread. See docs/services.md for URLs and channels.

        bus = hedgehop.Bus()
        bus.subscribe("VEHICLE_STATE", lambda state: print(state.flight_time_s))
        while True:
            bus.poll(0.5)
    """

    def __init__(self, url: str = "", channel_prefix: str = "") -> None:
        self._native = _native.Bus(url, channel_prefix)

    def publish(self, channel: str, message: Any) -> None:
        """Sends a message of the channel's type; sender and number are filled in, and `utime` if it is 0.

        Raises MessageError for what no service would take.
        """
        if channel in CHANNELS and type(message).__name__ != CHANNELS[channel]:
            raise UsageError(f"{channel} carries {CHANNELS[channel]}, not {type(message).__name__}")
        kept = message.utime, message.sender_id, message.seq, message.version
        message.utime = message.utime or self._native.utime
        message.sender_id, message.seq, message.version = message.sender_id or 1, message.seq or 1, type(message).VERSION
        try:
            encoded = message.encode()
        except Exception as error:
            raise MessageError(f"{type(message).__name__} cannot be encoded: {error}") from error
        finally:
            message.utime, message.sender_id, message.seq, message.version = kept
        self._native.publish(channel, encoded)

    def subscribe(self, channel: str, handler: Callable[[Any], object]) -> None:
        """Calls `handler` with each message of the channel, inside poll(). What the services would refuse does not come."""
        if channel not in CHANNELS:
            raise UsageError(f"there is no channel '{channel}': hedgehop.CHANNELS lists them")
        type_of_channel = getattr(messages, CHANNELS[channel])
        self._native.subscribe(channel, lambda message: handler(type_of_channel.decode(message)))

    def poll(self, timeout_s: float) -> int:
        """Waits for a first message and hands over what is there. The number of messages seen."""
        return self._native.poll(timeout_s)

    @property
    def url(self) -> str:
        return self._native.url

    @property
    def utime(self) -> int:
        """[us] Now; in a log, the time of its newest message."""
        return self._native.utime

    @property
    def is_finished(self) -> bool:
        """True once a log (file://) has been read to its end."""
        return self._native.is_finished

    @property
    def counters(self) -> dict[str, int]:
        return self._native.counters


@dataclass(frozen=True)
class LogEvent:
    """One message of a log."""

    number: int
    utime: int  #: [us] of receiving
    channel: str
    message: bytes

    def decode(self, channel_prefix: str = "") -> Any:
        """The message itself. Raises UsageError for a channel that is none of hedgehop's, MessageError for damage."""
        return decode(self.channel.removeprefix(channel_prefix), self.message)


def read_log(file: Path) -> Iterator[LogEvent]:
    """The events of an LCM log, whole ones; damage is left out. Raises DataError for a file that is no log."""
    reader = _native.LogReader(os.fspath(file))

    def events() -> Iterator[LogEvent]:
        while (event := reader.next()) is not None:
            yield LogEvent(*event)

    return events()
