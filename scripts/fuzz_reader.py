"""Damage logs, topic maps and results at random and see that each is refused in one line or its loss is stated.

    python scripts/fuzz_reader.py --inputs 50000

Logs of several writers, encodings and compressions have bytes flipped, cut out, inserted, blanked or repeated; topic
maps have lines changed; results have entries and arrays of their sidecars changed, and checksums that agree. What comes
out of a damaged log is compared with what was written. Inputs that crash the reader, keep it busy or give a wrong
number are kept in --keep, and the exit code is 1.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.fuzz.fuzzing import BAD, damage, damage_text, judge_log, judge_map, make_seeds, map_texts
from tests.fuzz.pairs import judge_pair, write_pair


@dataclass(frozen=True)
class Fuzz:
    """Feed the reader with damaged inputs."""

    inputs: int = 50_000
    """How many."""
    maps: float = 0.2
    """Share of topic maps among them."""
    pairs: float = 0.2
    """Share of results with their sidecars among them."""
    seed: int = 0
    """Seeds the damage."""
    keep: Path = Path("fuzz_failures")
    """Where inputs that fail are kept."""


def main(fuzz: Fuzz) -> int:
    """Run, count, print."""
    rng = np.random.default_rng(fuzz.seed)
    counts: dict[str, Counter[str]] = {"log": Counter(), "map": Counter(), "pair": Counter()}
    started, failures = time.perf_counter(), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seeds, texts = make_seeds(folder), map_texts()
        sound = folder / "own.mcap"
        for k in range(fuzz.inputs):
            drawn = rng.random()
            if drawn < fuzz.pairs:
                kind, path = "pair", write_pair(folder, rng)
                outcome = judge_pair(path)
            elif drawn < fuzz.pairs + fuzz.maps:
                kind, path = "map", folder / "damaged.yaml"
                path.write_bytes(damage_text(texts[int(rng.integers(len(texts)))], rng))
                outcome = judge_map(path, sound)
            else:
                kind, path = "log", folder / "damaged.mcap"
                seed = seeds[int(rng.integers(len(seeds)))]
                path.write_bytes(damage(seed.content, rng))
                outcome = judge_log(path, seed)
            counts[kind][outcome.kind] += 1
            if outcome.kind in BAD:
                failures += 1
                fuzz.keep.mkdir(exist_ok=True)
                (fuzz.keep / f"{k}{path.suffix}").write_bytes(path.read_bytes())
                sys.stdout.write(
                    f"{k}: {kind} ({seed.name if kind == 'log' else ''}): {outcome.kind}: {outcome.detail}\n"
                )
    for kind, counted in counts.items():
        listed = ", ".join(f"{name} {count}" for name, count in counted.most_common())
        sys.stdout.write(f"{kind}s: {counted.total()} ({listed})\n")
    sys.stdout.write(f"{fuzz.inputs} inputs in {time.perf_counter() - started:.0f} s, {failures} failures\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Fuzz, description=__doc__)))
