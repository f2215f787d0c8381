"""The result document: the same on disk and in memory, and what is wrong with another is said entry by entry."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from massid.errors import BadInputError
from massid.result.document import Document
from massid.result.file import plain, read_document, write_json
from massid.score import Score, with_score
from tests.result.samples import HIDDEN, JUNK, changed, document, entries

SCORE = Score(
    true_kg={"torso": 4.41, HIDDEN: 2.2},
    error_kg={"torso": -0.01, HIDDEN: 0.1},
    l2_error_initial_kg=0.46,
    l2_error_kg=np.array([0.2, 0.1]),
    true_quantities={"com/torso/x": 0.125, "com/torso/y": 0.0},
    quantity_errors={"com/torso/x": -0.005, "com/torso/y": 0.0},
)


def _clean() -> Document:
    """A result of a log without noise, that nobody judged and that has no other method beside it."""
    links = {link: replace(entry, std_kg=None, interval95_kg=None) for link, entry in document().links.items()}
    iterations = [replace(entry, chi2=None, std_kg=None) for entry in document().iterations]
    return replace(
        document(),
        links=links,
        quantities={},
        together=None,
        verdict=None,
        validation=None,
        uncertainty=None,
        iterations=iterations,
        reference=None,
        options=None,
    )


@pytest.mark.parametrize(
    "written", [document(), _clean(), with_score(document(), SCORE), replace(document(), sidecar_sha256="0" * 64)]
)
def test_what_is_written_is_read_back(written: Document, tmp_path: Path) -> None:
    write_json(written, tmp_path / "r.json")
    assert read_document(tmp_path / "r.json") == written
    assert json.loads((tmp_path / "r.json").read_text()) == plain(written)


def test_what_is_unknown_is_null_or_left_out() -> None:
    """Scripts read the file: an estimate that could not be made is null, an entry that makes no sense is not there."""
    noisy, clean = plain(document()), plain(_clean())
    assert noisy["links"][HIDDEN] == {
        "nominal_kg": 2.0,
        "estimate_kg": None,
        "identifiable": False,
        "verdict": "not identifiable",
    }
    assert noisy["iterations"][0]["std_kg"] is None
    assert not {"sidecar_sha256", "l2_error_kg", "l2_error_initial_kg"} & noisy.keys()
    assert not {"std_kg", "interval95_kg", "true_kg", "error_kg"} & clean["links"]["torso"].keys()
    assert [name for name, value in clean.items() if value is None] == [
        "together",
        "verdict",
        "validation",
        "uncertainty",
        "reference",
    ]
    scored = plain(with_score(document(), SCORE))
    assert scored["links"]["torso"]["error_kg"] == -0.01
    assert scored["links"][HIDDEN]["error_kg"] is None
    assert scored["links"][HIDDEN]["true_kg"] == 2.2
    assert scored["quantities"]["com/torso/y"]["error"] is None


def test_a_later_version_may_say_more(tmp_path: Path) -> None:
    written = plain(document())
    written["surprise"] = {"depth": [1]}
    written["uncertainty"]["nuisances"]["effort_offset/knee"] |= {"drift": 0.1}
    write_json(written, tmp_path / "r.json")
    assert read_document(tmp_path / "r.json") == document()


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_number_that_is_not_finite_is_never_written(value: float, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(replace(document(), log_s=value), tmp_path / "r.json")
    assert not (tmp_path / "r.json").exists()


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    write_json(replace(document(), log_s=np.float64(0.1)), tmp_path / "r.json")
    assert read_document(tmp_path / "r.json").log_s == 0.1


def _refusal(path: Path) -> str:
    with pytest.raises(BadInputError) as refused:
        read_document(path)
    message = str(refused.value)
    assert str(path) in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    "text",
    [
        "nonsense",
        "[1, 2]",
        "3",
        '{"links": {}}',
        "",
        "[" * 100_000,
        '{"links":' * 100_000,
        "9" * 5_000,
        b"\xff",
        b"\x00",
    ],
    ids=lambda text: str(text[:12]),
)
def test_what_is_not_a_result_is_refused(text: str | bytes, tmp_path: Path) -> None:
    (tmp_path / "r.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    assert "massid identify --json" in _refusal(tmp_path / "r.json")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 7}, "has schema 7; expected schema 1"),
        ({"schema": None}, "has no schema; expected schema 1"),
        ({"schema": True}, "/schema is true; expected a whole number"),
        ({"log_s": math.nan}, "holds the number NaN; expected finite ones"),
        ({"log_s": "long"}, "/log_s is 'long'; expected a finite number"),
        ({"log_s": None}, "/log_s is null; expected a finite number"),
        ({"log_s": True}, "/log_s is true; expected a finite number"),
        ({"log_s": 10**400}, "/log_s is 1000000000000000000000000000000000000000; expected a finite number"),
        ({"links": {"torso": {"estimate_kg": 4.0, "identifiable": True}}}, "has no entry /links/torso/nominal_kg"),
        ({"links": []}, "/links is a list; expected an object"),
        ({"links": {"torso": None}}, "/links/torso is null; expected an object"),
        (
            {"iterations": [{"window": 0, "time_s": 0.5, "mu": 1.0}]},
            "no entry /iterations/0/estimate_kg; it has: window",
        ),
        ({"uncertainty": {"noise": {}, "inflation": 1.0, "chi2_per_sample": 1.0}}, "no entry /uncertainty/nuisances"),
        ({"together": 3.0}, "/together is 3.0; expected an object or null"),
        ({"options": {"search": {"radius": {}}}}, "/options/search/radius is an object; expected "),
        ({"options": {"search": {"scan": [1]}}}, "/options/search/scan/0 is 1; expected a text"),
        ({"warnings": "none"}, "/warnings is 'none'; expected a list"),
        ({"sidecar_sha256": 5}, "/sidecar_sha256 is 5; expected a text or null"),
    ],
)
def test_a_document_that_lacks_something_is_refused(changes: dict[str, object], message: str, tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(json.dumps(plain(document()) | changes))
    assert message in _refusal(tmp_path / "r.json")


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("links", HIDDEN, "nominal_kg"), 0, f"/links/{HIDDEN}/nominal_kg is 0; expected a finite number above 1e-12"),
        (("links", "torso", "interval95_kg"), [4.2], "/links/torso/interval95_kg is a list; expected a list of length"),
        (("links", "torso", "interval95_kg", 1), "x", "/links/torso/interval95_kg/1 is 'x'; expected a finite number"),
        (
            ("iterations", 1, "estimate_kg"),
            {"torso": 4.0},
            f"/iterations/1/estimate_kg/{HIDDEN}; it has: torso",
        ),
        (("iterations", 1, "std_kg"), {"torso": 4.0}, f"no entry /iterations/1/std_kg/{HIDDEN}"),
        (("verdict", "predicted_std_kg"), {}, "no entry /verdict/predicted_std_kg/torso; it has: none"),
        (("reference", "estimate_kg"), {HIDDEN: 2.0}, "no entry /reference/estimate_kg/torso"),
        (("verdict", "sums", 0, "links", 1), 3, "/verdict/sums/0/links/1 is 3; expected a text"),
        (
            ("uncertainty", "nuisances", "wrench_offset/sole/2@2", "unit"),
            1,
            "/wrench_offset/sole/2@2/unit is 1; expected",
        ),
    ],
)
def test_the_entry_that_is_wrong_is_named(
    where: tuple[str | int, ...], value: object, message: str, tmp_path: Path
) -> None:
    (tmp_path / "r.json").write_text(json.dumps(changed(plain(document()), where, value)))
    assert message in _refusal(tmp_path / "r.json")


def test_numbers_too_large_are_not_finite(tmp_path: Path) -> None:
    text = json.dumps(plain(document())).replace('"wall_s": 1.0', '"wall_s": 1e999')
    (tmp_path / "r.json").write_text(text)
    assert "holds the number 1e999" in _refusal(tmp_path / "r.json")


@pytest.mark.parametrize("junk", JUNK, ids=lambda junk: str(junk)[:8])
def test_whatever_entry_is_wrong_it_is_the_one_that_is_named(junk: object, tmp_path: Path) -> None:
    path, whole = tmp_path / "r.json", plain(with_score(document(), SCORE))
    refused = 0
    for where in entries(whole):
        path.write_text(json.dumps(changed(whole, where, junk)))
        try:
            read_document(path)
        except BadInputError as error:
            refused += 1
            assert re.search(r"/" + re.escape("/".join(map(str, where))) + r"[/ ]", str(error)) or where == ("schema",)
    assert refused > 20
