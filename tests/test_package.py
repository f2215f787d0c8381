"""The package as a user gets it: installed from a wheel, with no clone around; and which room may import what."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from numba.core import caching

from massid.compiled import kernel

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "massid"

ONLY_IN = {
    "mcap": {"log"},
    "rerun": {"view"},
    "matplotlib": {"view", "paper"},
    "tyro": {"cli"},
    "rich": {"cli"},
    "dm_control": {"plant"},
    "daqp": {"walking"},
    "ruamel": {"log"},
    "google": {"log"},
    "rosbags": {"log"},
    "pyarrow": {"log"},
    "msgspec": {"result", "score"},
}
"""Libraries that one room keeps to itself."""

EVERYBODY = {"compiled", "errors", "inputs", "lazy", "memory", "typing"}
"""What every room may know."""

SEES: dict[str, set[str]] = {
    "ranges": set(),
    "outputs": set(),
    "assets": set(),
    "markup": set(),
    "walk": set(),
    "search": {"ranges"},
    "log": {"outputs", "walk"},
    "model": {"outputs", "search", "walk"},
    "audit": {"log", "model", "walk"},
    "observer": {"model", "search", "walk"},
    "result": {"markup", "model", "outputs", "search", "walk"},
    "identify": {"audit", "model", "observer", "ranges", "result", "search", "walk"},
    "compare": {"model", "search", "walk"},
    "judge": {"compare", "identify", "model", "observer", "result", "search", "walk"},
    "score": {"result"},
    "systems": {"search"},
    "walking": set(),
    "plant": {"log", "model", "outputs", "search", "walk", "walking"},
    "view": {"markup", "model", "outputs", "result", "score", "search", "walk"},
    "paper": {
        *("assets", "identify", "log", "markup", "model", "observer", "outputs", "plant", "result", "score", "search"),
        *("systems", "view", "walk", "walking", "weighing"),
    },
}
"""What each room may know of those before it: data flows one way, and truth never reaches identification."""

DOORS = {"__init__", "__main__", "cli", "weighing"}
"""They may know every room."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which a freshly built wheel was unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--quiet", str(ROOT)]
    subprocess.run([*build, "--wheel-dir", str(folder)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["links", "atlas"], "torso"),
        (["links", "models/atlas.xml"], "torso"),
        (["identify", "SAMPLE"], "converged"),
    ],
)
def test_the_wheel_works_from_another_folder(
    arguments: list[str], expected: str, installed: Path, tmp_path: Path
) -> None:
    sample = str(installed / "massid" / "_assets" / "data" / "atlas_walk.mcap")
    environment = os.environ | {"PYTHONPATH": str(installed)}
    code = "import massid, sys; assert 'site/massid' in massid.__file__; from massid.cli import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", code, *(sample if word == "SAMPLE" else word for word in arguments)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert expected in done.stdout
    assert not list(tmp_path.iterdir())  # nothing is left behind where the user stands


def _imports(path: Path) -> set[str]:
    """Every module name that a file imports, at its top or inside a function."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def _room(path: Path) -> str:
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", sorted(SOURCE.rglob("*.py")), ids=lambda path: str(path.relative_to(SOURCE)))
def test_every_room_imports_only_what_it_may(path: Path) -> None:
    room = _room(path)
    for name in _imports(path):
        parts = name.split(".")
        assert room in ONLY_IN.get(parts[0], {room}), f"{name} belongs to {ONLY_IN.get(parts[0])}"
        if parts[0] == "massid" and len(parts) > 1 and room not in DOORS | EVERYBODY:
            assert parts[1] in SEES[room] | {room} | EVERYBODY, f"{room} must not know {name}"


def test_rooms_know_each_other_in_one_direction() -> None:
    order = list(SEES)
    for room, known in SEES.items():
        assert all(other in DOORS or order.index(other) < order.index(room) for other in known), (
            f"{room} knows a room after it"
        )


def test_only_the_score_reads_the_truth() -> None:
    readers = [
        str(path.relative_to(SOURCE))
        for path in SOURCE.rglob("*.py")
        if "true_kg" in path.read_text() and "json.loads" in path.read_text()
    ]
    assert readers == ["score.py"]


def test_identification_does_not_open_the_truth_file(tmp_path: Path) -> None:
    """The truth lies beside the log; an audit hook sees every file that `massid identify` opens."""
    code = (
        "import sys\n"
        "opened = []\n"
        "sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == 'open' else None)\n"
        "from massid.assets import sample_walk\n"
        "from massid.cli import main\n"
        "assert main(['identify', str(sample_walk())]) == 0\n"
        "assert any('atlas_walk.mcap' in name for name in opened)\n"
        "assert not [name for name in opened if 'truth' in name]\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path, capture_output=True)


def test_the_readmes_python_runs(capsys: pytest.CaptureFixture[str]) -> None:
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len(blocks) >= 2
    names: dict[str, object] = {}
    for block in blocks:  # a later block goes on from an earlier one, as a reader does
        exec(block, names)
    assert "'torso': 67.86" in capsys.readouterr().out


def test_help_loads_no_engine() -> None:
    """Whoever asks what there is need not wait for MuJoCo, SciPy and compilers."""
    code = (
        "import sys\n"
        "from massid.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'mujoco', 'scipy', 'numba', 'numpy', 'rerun', 'matplotlib', 'mcap'} & set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or 0)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_kernels_run_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine whose package folder and home folder are read-only."""
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])

    def twice(x: float) -> float:
        return 2.0 * x

    assert kernel(twice)(21.0) == 42.0


def test_pictures_and_recordings_are_made_where_there_is_no_home(tmp_path: Path) -> None:
    """Not even root can write into /proc: there is no place for anybody's settings and caches."""
    homes = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"), "/proc")
    environment = {name: value for name, value in os.environ.items() if name != "MPLCONFIGDIR"} | homes
    code = (
        "from pathlib import Path\n"
        "import rerun\n"
        "from massid.paper.figures import page\n"
        "stream = rerun.RecordingStream('massid')\n"
        "memory = stream.memory_recording()\n"
        "stream.log('a', rerun.TextDocument('b'))\n"
        "assert memory.drain_as_bytes()\n"
        "with page(Path('figure.png'), 1, 1, (3.0, 2.0)) as axes: axes.plot([0, 1], label='a')\n"
    )
    command = [sys.executable, "-B", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figure.png"]
