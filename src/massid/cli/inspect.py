"""massid inspect: what is in a log, whether it makes sense for a robot, and what it can reveal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from massid.assets import find_model_by_hash, resolve_model
from massid.cli import CONTRADICTED, NOT_IDENTIFIABLE
from massid.cli.arguments import OptionalFile, OptionalLinks, OptionalModel, OptionalTopics, parse_names, topics_file
from massid.errors import BadInputError
from massid.model.unknowns.spaces import mass_space
from massid.outputs import check_outputs, check_suffix

if TYPE_CHECKING:
    from massid.audit import Audit, Prepared
    from massid.cli.inspection import Inspection
    from massid.cli.report_page import Page
    from massid.log import LogSummary, TopicMap
    from massid.model.robot import Robot
    from massid.result.verdict import Verdict
    from massid.walk import Walk
    from massid.weighing import Weighing

_LEAST_LOAD = 0.05
"""Share of the weight below which the direction of the mean force means nothing."""


@dataclass(frozen=True)
class Inspect:
    """Show what logs hold and whether they make sense for a robot, before masses are identified from them.

    Topics, rates, gaps and damage; with a model also position against velocity, the weight, stance phases, the lag
    between streams, the one-step residual, and to what each link's mass could be known from this log.

    Examples:
      massid inspect walk.mcap
      massid inspect lowstate.mcap --model g1.xml --topics unitree_g1 --html report.html
      massid inspect monday/ tuesday/ --model robot.xml --json found.json
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """Logs of walks of one robot: MCAP files, folders of ros2 bag record, rosbag2 SQLite files, ROS 1 bags, or tables
    (CSV, NumPy .npz, Parquet) with a topic map."""
    model: OptionalModel = None
    """MJCF or URDF file of the robot, or the name of a shipped one; default the shipped model that made the log."""
    topics: OptionalTopics = None
    """Topic map: a YAML file, or a preset such as ros2 or unitree_g1; default what massid records."""
    links: OptionalLinks = None
    """Links to judge, separated by commas; default those of massid identify, which also set the exit code, and below
    them all that move by themselves."""
    html: OptionalFile = None
    """Write the same as a page with pictures."""
    json: OptionalFile = None
    """Write the same as JSON."""

    def run(self) -> int:
        """Print, section by section."""
        from massid.cli.inspection import Inspection
        from massid.cli.report_page import Page
        from massid.log import TopicMap, load_topics, summarise_log
        from massid.model.robot import Robot

        if not self.logs:
            raise BadInputError("No log given: name at least one.")
        model = None if self.model is None else resolve_model(self.model)
        topics = load_topics(self.topics) if self.topics else TopicMap()
        inputs = [*(("the log", log) for log in self.logs), ("the model (--model)", model), topics_file(self.topics)]
        check_outputs(inputs, [("--html", self.html), ("--json", self.json)])
        check_suffix("--html", self.html, ".html")
        check_suffix("--json", self.json, ".json")
        page = Page(f"massid inspect {' '.join(map(str, self.logs))}")
        summaries = [summarise_log(log, topics.time) for log in self.logs]
        made_with = dict(summaries[0].metadata.get("massid", {})).get("model_sha256", "")
        path = model or find_model_by_hash(made_with)
        robot = None if path is None else Robot.load(path)
        if robot is None and self.links is not None:
            raise BadInputError("--links are those of a robot: name it (--model).")
        named = parse_names("--links", self.links) if self.links is not None else None
        if robot is not None and named is not None:
            mass_space(robot, named)  # a name that does not exist is told at once
        found = Inspection([str(log) for log in self.logs], summaries)
        for log, summary in zip(self.logs, summaries, strict=True):
            self._print_topics(page, summary, f" of {log}" if len(self.logs) > 1 else "")
        code = 0
        if robot is None:
            page.section("Robot", ["no model given (--model), so the log was not checked against any physics"])
        else:
            code = self._judge(page, robot, named, topics, found)
        if self.html:
            page.write(self.html)
        if self.json:
            found.write(self.json, code)
        return code

    def _judge(self, page: Page, robot: Robot, named: Sequence[str] | None, topics: TopicMap, found: Inspection) -> int:
        """Check the logs against a robot; returns the exit code."""
        from massid.weighing import Weighing

        moving, usual = _moving(robot), robot.default_links()
        job = Weighing.prepare(self.logs, robot, named or usual or moving, topics=topics, thorough=True)
        for prepared in job.prepared:
            self._print_audit(page, prepared, robot)
        job.require_windows()
        code = self._print_verdict(page, job, found)
        if named is None and usual and set(moving) != set(usual):
            self._print_all(page, job, moving, found)
        if named is None and not usual:
            page.section("To weigh", ["massid identify wants --links: this robot has no two legs to find them in"])
            code = BadInputError.exit_code
        if self.html:
            for prepared in job.prepared:
                page.plot_walk(prepared.walk)
        return code

    @staticmethod
    def _print_topics(page: Page, summary: LogSummary, of: str) -> None:
        rows = []
        for topic in summary.topics:
            gaps = f"{topic.gaps}, longest {topic.longest_gap_s:.4g} s" if topic.gaps else "0"
            jumps = str(topic.jumps)
            rate = f"{topic.rate_hz:.6g}" if topic.rate_hz else "-"
            rows.append((topic.info.topic, topic.info.message_type, str(topic.messages), rate, gaps, jumps))
        page.table(f"Topics{of}", ("topic", "type", "messages", "rate [Hz]", "gaps", "jumps back"), rows)
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
        page.section("Physics", _physics_lines(audit))
        worst = max(kinematics.joints.items(), key=lambda item: item[1], default=None)
        page.section(
            "Position against velocity (share of the motion that disagrees)",
            [
                f"base position {_share(kinematics.position)}, base attitude {_share(kinematics.attitude)}",
                f"joints: worst {worst[0]} {worst[1]:.2%}" if worst else "joints: none moves",
            ],
        )
        page.section("Warnings", [*robot.notes, *walk.warnings] or ["none"])

    def _print_verdict(self, page: Page, job: Weighing, found: Inspection) -> int:
        """To what each link's mass could be known, and what would help: what `massid identify` says before it fits.

        Returns:
            The exit code: that of `massid identify` if it would refuse, or weigh with a log that contradicts itself.
        """
        verdict = _foresee(job)
        doubts = job.doubts
        page.table("Links", _LINK_COLUMNS, _link_rows(verdict, doubts))
        first = ["no mass found from this log means anything before these are settled: " + " ".join(doubts)]
        page.section("Verdict", [*(first if doubts else ()), *verdict.lines(), _known_to(verdict)])
        found.judge(job, verdict, doubts)
        if job.denied:
            return CONTRADICTED
        return NOT_IDENTIFIABLE if verdict.hidden else 0

    @staticmethod
    def _print_all(page: Page, job: Weighing, moving: tuple[str, ...], found: Inspection) -> None:
        """To what every link's mass could be known if all were asked for; nothing is refused for that."""
        verdict = _foresee(job.asking_for(moving))
        page.table("If all links were asked for (--links)", _LINK_COLUMNS, _link_rows(verdict, job.doubts))
        found.judge_all(verdict)


_LINK_COLUMNS = ("link", "nominal [kg]", "known to, 95 % [kg]", "verdict")


def _foresee(job: Weighing) -> Verdict:
    from massid.cli.console import progress_bar

    with progress_bar("judging") as progress:
        return job.foresee(progress)


def _known_to(verdict: Verdict) -> str:
    """What the column of that name means."""
    return (
        f"known to: half the 95 % interval that massid identify would end with, foreseen with {verdict.sensors} and "
        "the model file's masses, before anything is fitted; beyond half of the nominal mass a link gets no estimate"
    )


def _link_rows(verdict: Verdict, doubts: Sequence[str]) -> list[tuple[str, ...]]:
    from massid.result.posterior import INTERVAL_95

    yes = "shown, but see the warnings" if doubts else "identifiable"
    return [
        (link, f"{nominal:.3f}", f"{INTERVAL_95 * std:.2g}", yes if seen else "not identifiable")
        for link, nominal, std, seen in zip(
            verdict.links, verdict.space.nominal, verdict.std, verdict.identifiable, strict=True
        )
    ]


def _moving(robot: Robot) -> tuple[str, ...]:
    """Links that move by themselves."""
    return tuple(link for link in robot.links if robot.welded_to(link) is None)


def _share(value: float | None) -> str:
    return "hardly moves" if value is None else f"{value:.2%}"


def _lag(lag_s: float, walk: Walk) -> str:
    """A lag in words; one that ends at the border of the search was not found."""
    from massid.audit.lag import lag_margin

    is_inside = abs(lag_s) < (lag_margin(walk) - 1) * walk.timestep_s
    return f"{lag_s * 1e3:+.2f} ms" if is_inside else "not measurable"


def _physics_lines(audit: Audit) -> list[str]:
    measured_kg, nominal_kg = audit.weight.measured_kg, audit.weight.nominal_kg
    leaning = f"the mean force leans {audit.weight.tilt_rad * 57.29578:.1f} degrees"
    if measured_kg is not None and abs(measured_kg) < _LEAST_LOAD * nominal_kg:
        leaning = "too little for a direction"
    if measured_kg is None:
        walk = audit.walk
        blind = [body for body, axes in zip(walk.contact_bodies, walk.measured, strict=True) if not axes.all()]
        lines = [f"no sensor reads what {', '.join(blind)} carry; the model weighs {nominal_kg:.2f} kg"]
    else:
        carried = f"the ground carries {measured_kg:.2f} kg on average"
        lines = [f"{carried}, the model weighs {nominal_kg:.2f} kg; {leaning}"]
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
