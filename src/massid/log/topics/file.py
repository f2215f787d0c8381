"""Read a topic map from a YAML file or a preset, and say what is wrong with it and where."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    MappingEndEvent,
    MappingStartEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from massid.errors import LogError, unknown_name
from massid.inputs import problem_of
from massid.log.topics.map import (
    BASE_STATE,
    JOINT_STATE,
    WRENCH,
    BaseMap,
    Clock,
    ContactMap,
    Frame,
    JointMap,
    On,
    Order,
    Rate,
    Seldom,
    Silence,
    Source,
    TextField,
    TimeColumn,
    TopicMap,
)

_LARGEST_BYTES = 1 << 18
_DEEPEST = 12
_ROLES = {"base": BASE_STATE, "joints": JOINT_STATE, "contacts": WRENCH}
_DERIVED = "derived"
_STREAMS = ("joints", "effort", "wrench")
_Choice = TypeVar("_Choice", bound=enum.StrEnum)


FROM_A_PRESET = (
    "A map that changes only some of what a preset says begins with its name, such as `preset: massid` for topics as "
    "massid records them."
)


def preset_names() -> tuple[str, ...]:
    """Topic maps that come with massid."""
    folder = resources.files("massid.log.topics") / "presets"
    return tuple(sorted(entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")))


def load_topics(name_or_path: str | Path) -> TopicMap:
    """Read a topic map.

    Args:
        name_or_path: a YAML file, or the name of a preset.

    Raises:
        LogError: there is no such file or preset, or the file is no topic map; says where and what was expected.
    """
    name = str(name_or_path)
    if name in preset_names():
        return _build(_Node(_preset(name), name), name)
    path = Path(name_or_path)
    problem = problem_of(path, _LARGEST_BYTES)
    if problem and path.exists():
        raise LogError(f"The topic map {path} {problem}.")
    if problem:
        raise LogError(
            unknown_name("topic map", name, preset_names(), "massid") + " A path to a YAML file works as well."
        )
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from error
    given = _parse(content, name)
    try:
        return _build(_Node(_with_preset(_Node(given, name)), name), name)
    except LogError as error:
        if "is missing" in str(error) and isinstance(given, dict) and "preset" not in given:
            raise LogError(f"{error} {FROM_A_PRESET}") from error
        raise


def _preset(name: str) -> dict[str, Any]:
    text = (resources.files("massid.log.topics") / "presets" / f"{name}.yaml").read_bytes()
    return _with_preset(_Node(_parse(text, name), name))


def _with_preset(node: _Node) -> dict[str, Any]:
    """Lay a map over the preset that it starts from: settings of the map replace the preset's, one by one."""
    content = dict(node.mapping())
    if "preset" not in content:
        return content
    name = node.child("preset").text()
    if name not in preset_names():
        raise LogError(unknown_name("preset", name, preset_names(), node.where))
    del content["preset"]
    return _merged(_preset(name), content)


def _merged(under: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = {**under, **over}
    for key, value in over.items():
        if isinstance(value, dict) and isinstance(under.get(key), dict):
            merged[key] = _merged(under[key], value)
    return merged


def _parse(content: bytes, name: str) -> Any:
    """Parse YAML without what could make a small text large: aliases and deep nesting."""
    if len(content) > _LARGEST_BYTES:
        raise LogError(f"{name}: {len(content)} bytes are too many for a topic map (at most {_LARGEST_BYTES}).")
    try:
        text = content.decode("utf-8")
        depth = 0
        for event in YAML(typ="safe", pure=True).parse(text):
            if isinstance(event, AliasEvent):
                raise LogError(f"{name}: line {event.start_mark.line + 1}: aliases (*name) are not allowed here.")
            if isinstance(event, (MappingStartEvent, SequenceStartEvent)):
                depth += 1
            elif isinstance(event, (MappingEndEvent, SequenceEndEvent)):
                depth -= 1
            if depth > _DEEPEST:
                raise LogError(f"{name}: nested more than {_DEEPEST} levels deep; a topic map has 3.")
        return YAML(typ="safe", pure=True).load(text)
    except UnicodeDecodeError as error:
        raise LogError(f"{name}: is not text (byte {error.start}), expected YAML.") from error
    except (YAMLError, ValueError, TypeError, AttributeError, KeyError, IndexError, OverflowError) as error:
        raise LogError(f"{name}: not YAML: {' '.join(str(error).split())[:300]}") from error


class _Node:
    """A value of the file and where it stands; every access checks its type."""

    def __init__(self, value: Any, where: str) -> None:
        self.value = value
        self.where = where

    def mapping(self, known: tuple[str, ...] | None = None) -> Mapping[str, Any]:
        if not isinstance(self.value, dict):
            raise self.wrong("settings (key: value)")
        for key in self.value:
            if known is not None and key not in known:
                raise LogError(unknown_name("setting", _shown(key), known, self.where))
        return self.value

    def child(self, key: str) -> _Node:
        return _Node(self.mapping().get(key), f"{self.where}: {key}")

    def has(self, key: str) -> bool:
        return self.mapping().get(key) is not None

    def items(self) -> list[_Node]:
        if not isinstance(self.value, list):
            raise self.wrong("a list")
        return [_Node(value, f"{self.where}[{k}]") for k, value in enumerate(self.value)]

    def text(self) -> str:
        if not isinstance(self.value, str) or not self.value.strip():
            raise self.wrong("a name")
        return " ".join(self.value.split())

    def texts(self) -> tuple[str, ...]:
        """Several names, or one."""
        if isinstance(self.value, str):
            return (self.text(),)
        return tuple(node.text() for node in self.items())

    def number(self) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, (int, float)):
            raise self.wrong("a number")
        number = float(self.value) if abs(self.value) < 1e300 else float("inf")
        if not abs(number) < 1e12:
            raise self.wrong("a finite number")
        return number

    def numbers(self, count: int) -> tuple[float, ...]:
        found = tuple(node.number() for node in self.items())
        if len(found) != count:
            raise self.wrong(f"{count} numbers")
        return found

    def choice(self, kind: type[_Choice], default: _Choice) -> _Choice:
        if self.value is None:
            return default
        if self.value not in list(kind):
            raise LogError(unknown_name("choice", _shown(self.value), [str(item) for item in kind], self.where))
        return kind(self.value)

    def wrong(self, expected: str) -> LogError:
        return LogError(f"{self.where} is {_shown(self.value)}, expected {expected}.")


def _shown(value: Any) -> str:
    if value is None:
        return "missing"
    text = " ".join(str(value).split())
    return text if len(text) <= 60 else f"{text[:60]}..."


def _build(node: _Node, name: str) -> TopicMap:
    node.mapping(("description", "time", "clock", "rate", "lag_s", "base", "joints", "contacts", "supply"))
    lag = node.child("lag_s")
    lags = {key: lag.child(key).number() for key in lag.mapping(_STREAMS)} if lag.value is not None else {}
    supply = node.child("supply")
    advice = {_ROLES[key]: supply.child(key).text() for key in supply.mapping(tuple(_ROLES))} if supply.value else {}
    return TopicMap(
        base=_base(node.child("base")) if node.has("base") else None,
        joints=_joints(node.child("joints")) if node.has("joints") else None,
        contacts=tuple(_contact(item) for item in node.child("contacts").items()) if node.has("contacts") else (),
        clock=node.child("clock").choice(Clock, Clock.AUTO),
        rate=node.child("rate").choice(Rate, Rate.AUTO),
        lag_s=lags,
        time=_time(node.child("time")) if node.has("time") else None,
        supply=advice,
        name=name,
    )


def _time(node: _Node) -> TimeColumn:
    if not isinstance(node.value, dict):
        return TimeColumn(node.text())
    node.mapping(("field", "scale"))
    return TimeColumn(node.child("field").text(), node.child("scale").number() if node.has("scale") else 1.0)


def _source(group: _Node, key: str, *more: str) -> Source:
    """Read where a quantity comes from: a field of the group's topic, or a topic and a field of its own."""
    node = group.child(key)
    topic = group.child("topic")
    if not isinstance(node.value, dict):
        return Source(topic.text(), _fields(node))
    node.mapping(("topic", "field", "scale", *more))
    if node.has("topic"):
        topic = node.child("topic")
    scale = node.child("scale").number() if node.has("scale") else 1.0
    return Source(topic.text(), _fields(node.child("field")), scale)


def _fields(node: _Node) -> tuple[str, ...]:
    fields = node.texts()
    if not fields:
        raise node.wrong("at least one field")
    return fields


def _name(node: _Node) -> str | TextField:
    if isinstance(node.value, dict):
        node.mapping(("field",))
        return TextField(node.child("field").text())
    return node.text()


def _convention(group: _Node, key: str, setting: str) -> _Node:
    node = group.child(key)
    return node.child(setting) if isinstance(node.value, dict) else _Node(None, f"{node.where}: {setting}")


def _unless_derived(node: _Node, key: str) -> Source | None:
    return None if node.child(key).value == _DERIVED else _source(node, key, "frame")


def _base(node: _Node) -> BaseMap:
    node.mapping(("topic", "body", "position", "orientation", "linear_velocity", "angular_velocity"))
    return BaseMap(
        body=_name(node.child("body")),
        position=_source(node, "position"),
        orientation=_source(node, "orientation", "order"),
        linear_velocity=_unless_derived(node, "linear_velocity"),
        angular_velocity=_unless_derived(node, "angular_velocity"),
        order=_convention(node, "orientation", "order").choice(Order, Order.XYZW),
        linear_frame=_convention(node, "linear_velocity", "frame").choice(Frame, Frame.BODY),
        angular_frame=_convention(node, "angular_velocity", "frame").choice(Frame, Frame.BODY),
    )


def _joints(node: _Node) -> JointMap:
    keys = (
        "topic",
        "names",
        "position",
        "velocity",
        "effort",
        "rename",
        "ignore",
        "locked",
        "passive",
        "gears",
        "seldom",
    )
    node.mapping(keys)
    names = node.child("names")
    rename, locked, gears = node.child("rename"), node.child("locked"), node.child("gears")
    return JointMap(
        names=TextField(names.child("field").text()) if isinstance(names.value, dict) else names.texts(),
        position=_source(node, "position"),
        velocity=_source(node, "velocity"),
        effort=_source(node, "effort"),
        rename={str(key): rename.child(key).text() for key in rename.mapping()} if rename.value is not None else {},
        ignore=node.child("ignore").texts() if node.has("ignore") else (),
        locked={str(key): locked.child(key).number() for key in locked.mapping()} if locked.value is not None else {},
        passive=node.child("passive").texts() if node.has("passive") else (),
        gears={str(key): gears.child(key).number() for key in gears.mapping()} if gears.value is not None else {},
        seldom=node.child("seldom").choice(Seldom, Seldom.LEAVE),
    )


def _scaled_fields(group: _Node, key: str, fresh: tuple[str, ...]) -> tuple[tuple[str, ...], float]:
    """Read the fields of a vector and what to multiply them by; a scale alone leaves the usual fields."""
    node = group.child(key)
    if not isinstance(node.value, dict):
        return (node.texts() if group.has(key) else fresh), 1.0
    node.mapping(("field", "scale"))
    fields = _fields(node.child("field")) if node.has("field") else fresh
    return fields, node.child("scale").number() if node.has("scale") else 1.0


def _contact(node: _Node) -> ContactMap:
    node.mapping(("topic", "body", "force", "torque", "on", "frame", "position", "rotation", "silence"))
    fresh = ContactMap()
    x, y, z = node.child("position").numbers(3) if node.has("position") else fresh.position
    rotation = node.child("rotation").numbers(4) if node.has("rotation") else fresh.rotation
    norm = sum(value * value for value in rotation) ** 0.5
    if not abs(norm - 1.0) < 1e-3:
        raise LogError(f"{node.where}: rotation has norm {norm:.4g}, expected a unit quaternion (wxyz).")
    w, i, j, k = (value / norm for value in rotation)
    if set(node.mapping()) == {"body"}:  # it touches the ground and has no sensor
        return ContactMap(topic="", body=node.child("body").text())
    force, force_scale = _scaled_fields(node, "force", fresh.force)
    torque, torque_scale = _scaled_fields(node, "torque", fresh.torque)
    return ContactMap(
        topic=node.child("topic").text(),
        body=_name(node.child("body")) if node.has("body") else fresh.body,
        force=force,
        torque=torque,
        force_scale=force_scale,
        torque_scale=torque_scale,
        on=node.child("on").choice(On, On.ROBOT),
        frame=node.child("frame").choice(Frame, Frame.BODY),
        position=(x, y, z),
        rotation=(w, i, j, k),
        silence=node.child("silence").choice(Silence, Silence.AUTO),
    )
