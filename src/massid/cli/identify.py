"""massid identify: link masses from a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import tyro

from massid.assets import find_model_by_hash, resolve_model
from massid.cli.arguments import OptionalFile, OptionalLinks, OptionalModel, OptionalTopics
from massid.errors import BadInputError, LogError
from massid.identify.options import IdentifyOptions
from massid.identify.result import Result, Status
from massid.log.walk import Walk
from massid.robot import Robot

EXIT_CODES = {Status.CONVERGED: 0, Status.NOT_IDENTIFIABLE: 3, Status.NOT_CONVERGED: 4}


@dataclass(frozen=True)
class Identify:
    """Find the masses of a robot's links from the log of a walk, or from several logs of the same robot.

    Examples:
      massid identify walk.mcap --model robot.xml --links torso,l_thigh,r_thigh
      massid identify monday.mcap tuesday.mcap --model robot.xml --mode offline
      massid identify walk.mcap --truth walk.truth.json --rerun walk.rrd
      massid identify walk.mcap --direction gradient --mode offline --json result.json
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """MCAP logs of walks of one robot; online they follow each other, offline their scores are added."""
    model: OptionalModel = None
    """MJCF file of the robot, or the name of a shipped one; default the shipped model that made the log."""
    links: OptionalLinks = None
    """Links to weigh, separated by commas; default torso, thighs, calves and feet."""
    topics: OptionalTopics = None
    """Topic map: a YAML file, or a preset such as ros2 or unitree_g1; default what massid records."""
    mode: Literal["online", "offline"] = "online"
    """online sees every dwell window once; offline replays the log and sums over all windows."""
    truth: OptionalFile = None
    """NAME.truth.json of a simulated walk: adds true masses and errors to what is printed, nothing else."""
    json: OptionalFile = None
    """Write the result as JSON."""
    save_model: OptionalFile = None
    """Write the robot's MJCF with the identified masses and inertias."""
    rerun: OptionalFile = None
    """Write a Rerun recording of the walk and of the search."""
    png: OptionalFile = None
    """Write a picture that sums up the search."""
    options: IdentifyOptions = field(default_factory=IdentifyOptions)

    def run(self) -> int:
        """Identify, print the table, write what was asked for."""
        from massid.audit import prepare_walks
        from massid.cli.console import print_result, progress_bar, say, warn
        from massid.identify import identify_offline, identify_online
        from massid.identify.result import write_json
        from massid.log import TopicMap, load_topics, read_walk
        from massid.score import Truth, score, with_score

        for path in (self.json, self.save_model, self.rerun, self.png):
            if path is not None and not path.parent.is_dir():
                raise BadInputError(f"Cannot write {path}: the folder {path.parent} does not exist.")
        truth = Truth.load(self.truth) if self.truth else None
        topics = load_topics(self.topics) if self.topics else TopicMap()
        if not self.logs:
            raise BadInputError("No log given: massid identify LOG [LOG ...].")
        read = [read_walk(log, topics) for log in self.logs]
        complete = Robot.load(self._model_path(read))
        prepared = prepare_walks(self.logs, complete, topics, read)
        walks, robot = [one.walk for one in prepared], prepared[0].robot
        options = self.options
        if options.noise == "auto" and all(one.audit.clean for one in prepared):
            options = replace(options, noise="clean")
        known = [warning for walk in walks for warning in walk.warnings]
        for warning in known:
            warn(warning)
        space = robot.mass_space(self._links(robot))
        identify = identify_online if self.mode == "online" else identify_offline
        with progress_bar("identifying") as progress:
            result = identify(walks, robot, space, options, progress)
        scored = score(result, truth) if truth else None
        print_result(result, scored)
        for warning in result.warnings[len(known) :]:
            warn(warning)
        if result.status is Status.NOT_IDENTIFIABLE:
            warn(self._hidden(result))
        shows = f", the motion is that of {walks[0].source}" if len(walks) > 1 else ""
        document = result.to_json()
        if self.json:
            write_json(with_score(document, scored) if scored else document, self.json)
            say(f"result: {self.json}")
        if self.save_model:
            complete.write_mjcf(space, result.estimate, self.save_model)
            say(f"model: {self.save_model}")
        if self.rerun:
            from massid.view import write_recording

            write_recording(self.rerun, walks[0], robot, result, scored)
            say(f"recording: {self.rerun} (massid view {self.rerun}){shows}")
        if self.png:
            from massid.view import write_summary_png

            write_summary_png(self.png, walks[0], robot, result, scored)
            say(f"picture: {self.png}{shows}")
        return EXIT_CODES[result.status]

    def _model_path(self, walks: Sequence[Walk]) -> Path:
        if self.model is not None:
            return resolve_model(self.model)
        paths: list[Path] = []
        for walk in walks:
            path = find_model_by_hash(walk.metadata.get("model_sha256", ""))
            if path is None:
                made_with = walk.metadata.get("model_file", "an unknown model")
                raise LogError(f"{walk.source} was made with {made_with}, which is not shipped: name it with --model.")
            if paths and path != paths[0]:
                raise LogError(
                    f"{walk.source} was made with {path.name}, {walks[0].source} with {paths[0].name}: several logs "
                    "must be of one robot."
                )
            paths.append(path)
        return paths[0]

    def _links(self, robot: Robot) -> list[str]:
        if self.links is not None:
            return [link.strip() for link in self.links.split(",") if link.strip()]
        links = robot.walking_links()
        if not links:
            raise BadInputError(
                f"{robot.source} has no links named like torso, l_thigh, l_calf or l_foot: name the links to weigh "
                f"with --links. It has: {', '.join(robot.links)}."
            )
        return list(links)

    @staticmethod
    def _hidden(result: Result) -> str:
        rows = zip(
            result.space.parameters, result.excitation.identifiable, result.excitation.reference_std, strict=True
        )
        hidden = ", ".join(f"{parameter.target} (+-{std:.2g} kg)" for parameter, revealed, std in rows if not revealed)
        return (
            f"this walk does not reveal {hidden}: with ordinary encoders the mass would not even be known to half of "
            "its nominal value. A longer walk with more motion of these links would help."
        )
