"""The container: MCAP files read and written record by record. The only door to `mcap`."""
