"""Protobuf messages as dictionaries, by the descriptors that the file embeds. The only door to `google.protobuf`."""

from __future__ import annotations

from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message, message_factory

_MAX_DEPTH = 32


class ProtobufError(ValueError):
    """A schema or a message that is not protobuf."""


class ProtobufMessages:
    """Messages of one type.

    Args:
        message_type: full name of the type.
        schema: a serialised FileDescriptorSet that holds the type and all it depends on.

    Raises:
        ProtobufError: the schema is damaged or lacks the type.
    """

    def __init__(self, message_type: str, schema: bytes) -> None:
        try:
            files = descriptor_pb2.FileDescriptorSet.FromString(schema)
            pool = descriptor_pool.DescriptorPool()
            for file in files.file:
                pool.Add(file)
            self._class = message_factory.GetMessageClass(pool.FindMessageTypeByName(message_type))
        except (message.DecodeError, KeyError, TypeError, ValueError, RuntimeError) as error:
            text = " ".join(str(error).split())
            raise ProtobufError(f"its protobuf schema does not define '{message_type}': {text[:200]}") from error

    def parse(self, data: bytes) -> dict[str, Any]:
        """Decode one message.

        Raises:
            ProtobufError: it is not a message of this type.
        """
        try:
            return _tree(self._class.FromString(data))
        except (message.DecodeError, RuntimeError) as error:
            raise ProtobufError(f"not a protobuf message of this type: {error}") from error


def _tree(value: Any, above: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return all fields of a message, also those that are not set and so have their default."""
    if len(above) > _MAX_DEPTH:
        raise ProtobufError(f"nested more than {_MAX_DEPTH} levels deep")
    above = (*above, value.DESCRIPTOR.full_name)
    tree: dict[str, Any] = {}
    for field in value.DESCRIPTOR.fields:
        is_message = field.message_type is not None
        if field.is_repeated:
            if is_message and field.message_type.GetOptions().map_entry:
                continue
            items = getattr(value, field.name)
            tree[field.name] = [_tree(item, above) for item in items] if is_message else list(items)
        elif not is_message:
            tree[field.name] = getattr(value, field.name)
        elif value.HasField(field.name) or field.message_type.full_name not in above:
            tree[field.name] = _tree(getattr(value, field.name), above)
    return tree
