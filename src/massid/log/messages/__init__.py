"""Messages: bytes of CDR and protobuf to columns of numbers, by field path."""
