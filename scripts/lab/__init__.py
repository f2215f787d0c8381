"""A second plant, which shares nothing with the first but the engine: robots of others, and logs by another writer."""
