"""The paper's small systems (Section V-A and V-B), dynamic sampling (V-C), and systems of one's own."""
