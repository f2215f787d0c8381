"""massid inspect: what is in a log, whether it makes sense for a robot, and what it can reveal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from massid.assets import find_model_by_hash, resolve_model
from massid.cli.arguments import OptionalFile, OptionalLinks, OptionalModel, OptionalTopics, parse_names, topics_file
from massid.model.unknowns.spaces import mass_space
from massid.outputs import check_outputs

if TYPE_CHECKING:
    from massid.audit import Audit, Prepared
    from massid.cli.report_page import Page
    from massid.log import LogSummary
    from massid.model.robot import Robot
    from massid.walk import Walk
    from massid.weighing import Weighing

_LEAST_LOAD = 0.05
"""Share of the weight below which the direction of the mean force means nothing."""


@dataclass(frozen=True)
class Inspect:
    """Show what a log holds and whether it makes sense for a robot, before masses are identified from it.

    Topics, rates, gaps and damage; with a model also position against velocity, the weight, stance phases, the lag
    between streams, the one-step residual, and to what each link's mass could be known from this log.

    Examples:
      massid inspect walk.mcap
      massid inspect lowstate.mcap --model g1.xml --topics unitree_g1 --html report.html
    """

    log: tyro.conf.Positional[Path]
    """MCAP log of a walk."""
    model: OptionalModel = None
    """MJCF or URDF file of the robot, or the name of a shipped one; default the shipped model that made the log."""
    topics: OptionalTopics = None
    """Topic map: a YAML file, or a preset such as ros2 or unitree_g1; default what massid records."""
    links: OptionalLinks = None
    """Links to judge, separated by commas; default all that move by themselves."""
    html: OptionalFile = None
    """Write the same as a page with pictures."""

    def run(self) -> int:
        """Print, section by section."""
        from massid.cli.report_page import Page
        from massid.log import TopicMap, load_topics, summarise_log
        from massid.model.robot import Robot

        model = None if self.model is None else resolve_model(self.model)
        topics = load_topics(self.topics) if self.topics else TopicMap()
        inputs = [("the log", self.log), ("the model (--model)", model), topics_file(self.topics)]
        check_outputs(inputs, [("--html", self.html)])
        page = Page(f"massid inspect {self.log}")
        summary = summarise_log(self.log)
        path = model or find_model_by_hash(dict(summary.metadata.get("massid", {})).get("model_sha256", ""))
        robot = None if path is None else Robot.load(path)
        links = None if robot is None else self._links(robot)
        if robot is not None and links is not None:
            mass_space(robot, links)  # a name that does not exist is told at once
        self._print_topics(page, summary)
        if robot is None:
            page.section("Robot", ["no model given (--model), so the log was not checked against any physics"])
        else:
            from massid.weighing import Weighing

            job = Weighing.prepare(self.log, robot, links, topics=topics, held_out=0.0, thorough=True)
            self._print_audit(page, job.prepared[0], robot)
            self._print_verdict(page, job)
            if self.html:
                page.plot_walk(job.prepared[0].walk)
        if self.html:
            page.write(self.html)
        return 0

    @staticmethod
    def _print_topics(page: Page, summary: LogSummary) -> None:
        rows = []
        for topic in summary.topics:
            gaps = f"{topic.gaps}, longest {topic.longest_gap_s:.4g} s" if topic.gaps else "0"
            jumps = str(topic.jumps)
            rate = f"{topic.rate_hz:.6g}" if topic.rate_hz else "-"
            rows.append((topic.info.topic, topic.info.message_type, str(topic.messages), rate, gaps, jumps))
        page.table("Topics", ("topic", "type", "messages", "rate [Hz]", "gaps", "jumps back"), rows)
        page.section("File", [f"{summary.duration_s:.3f} s", *(summary.warnings or ("no damage",))])

    @staticmethod
    def _print_audit(page: Page, prepared: Prepared, robot: Robot) -> None:
        audit, walk = prepared.audit, prepared.walk
        weight, kinematics = audit.weight, audit.kinematics
        page.section(
            "Walk",
            [
                f"{len(walk)} samples at {1 / walk.timestep_s:.6g} Hz, {walk.duration_s:.3f} s usable in "
                f"{len(walk.segments)} segments; base {walk.root_body}, {len(walk.joint_names)} joints",
                *(
                    f"{body}: loaded {weight.loaded[body]:.0%} of the time, {weight.stances[body]} stances"
                    for body in weight.loaded
                ),
            ],
        )
        page.section("Physics", _physics_lines(audit, weight.measured_kg, weight.nominal_kg))
        worst = max(kinematics.joints.items(), key=lambda item: item[1], default=None)
        page.section(
            "Position against velocity (share of the motion that disagrees)",
            [
                f"base position {_share(kinematics.position)}, base attitude {_share(kinematics.attitude)}",
                f"joints: worst {worst[0]} {worst[1]:.2%}" if worst else "joints: none moves",
            ],
        )
        page.section("Warnings", [*robot.notes, *walk.warnings] or ["none"])

    @staticmethod
    def _print_verdict(page: Page, job: Weighing) -> None:
        """To what each link's mass could be known, and what would help: what `massid identify` says before it fits."""
        from massid.cli.console import progress_bar
        from massid.result.posterior import INTERVAL_95

        with progress_bar("judging") as progress:
            verdict = job.foresee(progress)
        rows = [
            (link, f"{nominal:.3f}", f"{INTERVAL_95 * std:.2g}", "identifiable" if seen else "not identifiable")
            for link, nominal, std, seen in zip(
                verdict.links, verdict.space.nominal, verdict.std, verdict.identifiable, strict=True
            )
        ]
        page.table("Links", ("link", "nominal [kg]", "known to, 95 % [kg]", "verdict"), rows)
        page.section("Verdict", verdict.lines())

    def _links(self, robot: Robot) -> list[str]:
        """The links that were named, or all that move by themselves."""
        if self.links is not None:
            return parse_names("--links", self.links)
        return [link for link in robot.links if robot.welded_to(link) is None]


def _share(value: float | None) -> str:
    return "hardly moves" if value is None else f"{value:.2%}"


def _lag(lag_s: float, walk: Walk) -> str:
    """A lag in words; one that ends at the border of the search was not found."""
    from massid.audit.lag import lag_margin

    is_inside = abs(lag_s) < (lag_margin(walk) - 1) * walk.timestep_s
    return f"{lag_s * 1e3:+.2f} ms" if is_inside else "not measurable"


def _physics_lines(audit: Audit, measured_kg: float, nominal_kg: float) -> list[str]:
    leaning = f"the mean force leans {audit.weight.tilt_rad * 57.29578:.1f} degrees"
    if abs(measured_kg) < _LEAST_LOAD * nominal_kg:
        leaning = "too little for a direction"
    lines = [f"the ground carries {measured_kg:.2f} kg on average, the model weighs {nominal_kg:.2f} kg; {leaning}"]
    contact = audit.self_contact
    lines.append(f"links touch each other in {int(contact.samples.sum())} of {len(contact.samples)} samples")
    if audit.lag is not None:
        lines.append(
            f"lag against the state: torques {_lag(audit.lag.effort_s, audit.walk)}, wrenches "
            f"{_lag(audit.lag.wrench_s, audit.walk)} ({'compensated' if audit.lag.believed else 'not compensated'})"
        )
    if audit.rest is not None:
        lines.append(f"force that neither the log nor any link masses explain: {audit.rest.share:.2%}")
    if audit.one_step is not None:
        step = audit.one_step
        lines.append(
            f"one-step residual of joint velocities: {step.nominal:.3g} rad/s with the model's masses, "
            f"{step.fitted:.3g} rad/s with masses fitted to the log (worst at {step.worst}); "
            f"velocities change by {step.change:.3g} rad/s"
        )
    return lines
