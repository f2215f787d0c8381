"""What `massid inspect` found, as data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from massid.audit import Prepared
    from massid.log import LogSummary
    from massid.result.verdict import Verdict
    from massid.weighing import Weighing


class Inspection:
    """Gathers what is printed, for a program to read.

    Args:
        logs: their names.
        summaries: what each holds, topic by topic.
    """

    def __init__(self, logs: Sequence[str], summaries: Sequence[LogSummary]) -> None:
        self._document: dict[str, Any] = {
            "logs": [
                {
                    "log": log,
                    "duration_s": summary.duration_s,
                    "topics": [
                        {
                            "topic": topic.info.topic,
                            "type": topic.info.message_type,
                            "messages": topic.messages,
                            "rate_hz": topic.rate_hz,
                            "gaps": topic.gaps,
                            "longest_gap_s": topic.longest_gap_s,
                            "jumps_back": topic.jumps,
                        }
                        for topic in summary.topics
                    ],
                    "damage": list(summary.warnings),
                }
                for log, summary in zip(logs, summaries, strict=True)
            ]
        }

    def judge(self, job: Weighing, verdict: Verdict, doubts: Sequence[str]) -> None:
        """Add what the checks of the logs found, and to what each mass could be known."""
        for entry, prepared in zip(self._document["logs"], job.prepared, strict=True):
            entry.update(_checks(prepared))
        self._document |= {"links": _links(verdict), "doubts": list(doubts), "verdict": verdict.lines()}

    def judge_all(self, verdict: Verdict) -> None:
        """Add to what every link's mass could be known if all were asked for."""
        self._document["all_links"] = _links(verdict)

    def write(self, path: Path, exit_code: int) -> None:
        """Write it as JSON; what is no finite number becomes null.

        Raises:
            BadInputError: it cannot be written.
        """
        from massid.cli.console import say
        from massid.result.file import write_json

        document = _finite({**self._document, "exit_code": exit_code})
        write_json(document, path)
        say(f"\nfound: {path}")


def _links(verdict: Verdict) -> list[dict[str, Any]]:
    from massid.result.posterior import INTERVAL_95

    return [
        {"link": link, "nominal_kg": float(nominal), "known_to_kg": INTERVAL_95 * float(std), "identifiable": seen}
        for link, nominal, std, seen in zip(
            verdict.links, verdict.space.nominal, verdict.std, verdict.identifiable.tolist(), strict=True
        )
    ]


def _checks(prepared: Prepared) -> dict[str, Any]:
    audit, walk = prepared.audit, prepared.walk
    return {
        "walk": {
            "samples": len(walk),
            "rate_hz": 1.0 / walk.timestep_s,
            "usable_s": walk.duration_s,
            "segments": len(walk.segments),
            "base": walk.root_body,
            "joints": list(walk.joint_names),
            "contacts": list(walk.contact_bodies),
        },
        "ground_carries_kg": audit.weight.measured_kg,
        "model_weighs_kg": audit.weight.nominal_kg,
        "base_position_mismatch": audit.kinematics.position,
        "base_attitude_mismatch": audit.kinematics.attitude,
        "joint_mismatch": audit.kinematics.joints,
        "lag_s": None if audit.lag is None else {"effort": audit.lag.effort_s, "wrench": audit.lag.wrench_s},
        "unexplained_force": None if audit.rest is None else audit.rest.share,
        "warnings": list(walk.warnings),
    }


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
