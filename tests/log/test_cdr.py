"""The layout of a message, found from its definition, agrees with another ROS 2 library."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from massid.log.mcap.schemas import JOINT_STATE, ODOMETRY, TYPE_HASHES, definition_text
from massid.log.messages.cdr import CdrError, encode, parse_schema, trace

MIXED = """# every kind of field
uint8 KIND=3
string LABEL = "a # b"
bool flag
int16 small 4
string text "hello"
float32[3] three
geometry_msgs/Point[2] points
char[] letters
Inner[] inner
int64 wide
string<=20[<=3] names
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: test_msgs/Inner
uint8 a
float64 b
"""


@pytest.fixture(scope="module")
def store():
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(MIXED, "test_msgs/msg/Mixed"))
    return store


@settings(max_examples=50, deadline=None)
@given(
    text=st.text(max_size=9).filter(lambda t: "\0" not in t),
    letters=st.binary(max_size=5),
    inner=st.lists(st.tuples(st.integers(0, 255), st.floats(allow_nan=False)), max_size=3),
    names=st.lists(st.text("abc", max_size=4), max_size=3),
    little=st.booleans(),
)
def test_every_field_is_found_where_another_library_puts_it(store, text, letters, inner, names, little):
    point, inner_type = store.types["geometry_msgs/msg/Point"], store.types["test_msgs/msg/Inner"]
    message = store.types["test_msgs/msg/Mixed"](
        flag=True,
        small=-7,
        text=text,
        three=np.array([1, 2, 3], dtype=np.float32),
        points=[point(1.0, 2.0, 3.0), point(4.0, 5.0, 6.0)],
        letters=np.frombuffer(letters, dtype=np.uint8),
        inner=[inner_type(a, b) for a, b in inner],
        wide=-(2**40),
        names=names,
    )
    data = bytes(store.serialize_cdr(message, "test_msgs/msg/Mixed", little_endian=little))
    layout = trace(parse_schema("test_msgs/msg/Mixed", MIXED), data)
    row = np.frombuffer(data, dtype=layout.record_dtype(list(layout.leaves)))[0]
    assert (row["flag"], row["small"], row["wide"]) == (1, -7, -(2**40))
    assert layout.strings == {"text": (text,), "names": tuple(names)}
    assert row["three"].tolist() == [1, 2, 3]
    assert [row[f"points[{k}].{a}"] for k in range(2) for a in "xyz"] == [1, 2, 3, 4, 5, 6]
    assert bytes(row["letters"].tolist()) == letters
    assert [(row[f"inner[{k}].a"], row[f"inner[{k}].b"]) for k in range(len(inner))] == inner
    assert layout.holds_for(data * 3, 3)


def test_a_layout_does_not_hold_when_a_name_changes():
    schema = parse_schema(JOINT_STATE, definition_text(JOINT_STATE))
    one = encode(schema, {"name": ["ab", "c"], "position": [1.0, 2.0]})
    other = encode(schema, {"name": ["a", "bc"], "position": [1.0, 2.0]})
    layout = trace(schema, one)
    assert layout.holds_for(encode(schema, {"name": ["ab", "c"], "position": [3.0, 4.0]}), 1)
    assert len(one) == len(other)
    assert not layout.holds_for(one + other, 2)


@pytest.mark.parametrize("message_type", list(TYPE_HASHES))
def test_definitions_and_hashes_are_those_of_ros(message_type):
    ros = get_typestore(Stores.ROS2_JAZZY)
    assert ros.hash_rihs01(message_type) == TYPE_HASHES[message_type]
    ours = get_typestore(Stores.EMPTY)
    ours.register(get_types_from_msg(definition_text(message_type), message_type))
    assert ours.hash_rihs01(message_type) == TYPE_HASHES[message_type]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data[:100], "ends inside field 'pose.covariance'"),
        (lambda data: data + bytes(8), "8 bytes remain after the last field of nav_msgs/Odometry"),
        (lambda data: b"\x00\x07" + data[2:], "encapsulation header 00 07 00 00 is not plain CDR"),
        (lambda data: data[:12] + b"\xff\xff\xff\x7f" + data[16:], "'header.frame_id' claims 2147483647 elements"),
        (lambda data: b"", "is not plain CDR"),
    ],
)
def test_a_message_that_does_not_fit_its_definition_is_refused(spoil, message):
    schema = parse_schema(ODOMETRY, definition_text(ODOMETRY))
    with pytest.raises(CdrError, match=message):
        trace(schema, spoil(encode(schema, {})))


def test_padding_at_the_end_is_allowed():
    schema = parse_schema(ODOMETRY, definition_text(ODOMETRY))
    assert "twist.covariance" in trace(schema, encode(schema, {}) + bytes(3)).leaves


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("float64", "has the line 'float64', which is not a field"),
        ("Thing a", "field 'a' of a/B has type 'Thing', which the schema does not define"),
        ("float64 a\n====\nfloat64 b", "'float64 b' where 'MSG: package/Type' was expected"),
    ],
)
def test_a_definition_that_makes_no_sense_is_refused(text, message):
    with pytest.raises(CdrError, match=message):
        parse_schema("a/msg/B", text)
